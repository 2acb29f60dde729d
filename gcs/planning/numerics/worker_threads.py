"""Work in threads: for kernels and libraries that run without the interpreter lock."""

from __future__ import annotations

import os
from concurrent.futures import FIRST_EXCEPTION, ThreadPoolExecutor, wait
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

Item = TypeVar("Item")
Result = TypeVar("Result")

POLL_S = 0.1


def workers() -> int:
    """How many processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def in_threads(
    work: Callable[[Item], Result], items: Iterable[Item], poll: Callable[[float], None] | None = None
) -> list[Result]:
    """Results of some work on every item, in the order of the items.

    Args:
        work: called from several threads at once.
        items: what is worked on.
        poll: called from this thread every 0.1 s with the share that is done; may raise, and then what has not begun
            is not begun any more.

    Raises:
        Exception: the first one that the work raised.
    """
    with ThreadPoolExecutor(workers()) as pool:
        jobs = [pool.submit(work, item) for item in items]
        try:
            left = set(jobs)
            while left:
                done, left = wait(left, timeout=POLL_S, return_when=FIRST_EXCEPTION)
                for job in done:
                    job.result()
                if poll is not None:
                    poll(1 - len(left) / len(jobs))
        finally:
            for job in jobs:
                job.cancel()
    return [job.result() for job in jobs]
