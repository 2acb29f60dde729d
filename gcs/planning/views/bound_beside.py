"""The bound on the number of views, worked out in a thread while other stages run."""

from __future__ import annotations

import threading
from contextlib import contextmanager
from typing import TYPE_CHECKING

from gcs.core.errors import OperationCancelled
from gcs.planning.views.cover_bound import cover_bound

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from gcs.core.progress import Progress
    from gcs.planning.views.cover_bound import CoverBound
    from gcs.planning.views.cover_problem import CoverProblem

STAGE = "bound"
TIME_LIMIT_S = 10.0
"""From when it begins; what is proven by then is told."""

POLL_S = 0.1


@contextmanager
def bound_beside(problem: CoverProblem | None, progress: Progress) -> Iterator[Callable[[], CoverBound | None]]:
    """Begin to work out a bound; its kernels and its solver leave the interpreter to the caller.

    Args:
        problem: the cover; None when there is none.
        progress: told about the stage `bound` while its end is waited for.

    Yields:
        A function that waits for the bound; it gives None when there is no cover.
    """
    if problem is None:
        yield lambda: None
        return
    stop = threading.Event()
    found: list[CoverBound] = []
    failed: list[BaseException] = []

    def poll() -> None:
        if stop.is_set():
            raise OperationCancelled("the bound is not asked for any more")

    def work() -> None:
        try:
            found.append(cover_bound(problem, TIME_LIMIT_S, poll))
        except OperationCancelled:
            pass
        except BaseException as error:  # handed over to the thread that asks
            failed.append(error)

    thread = threading.Thread(target=work, name="cover bound", daemon=True)

    def wait() -> CoverBound:
        while thread.is_alive():
            progress.report(STAGE, 0.5)
            thread.join(POLL_S)
        if failed:
            raise failed[0]
        progress.report(STAGE, 1.0)
        return found[0]

    thread.start()
    try:
        yield wait
    finally:
        stop.set()
