"""A kernel's work on a range of numbers, shared between threads."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING

from gcs.planning.numerics.worker_threads import in_threads, workers

if TYPE_CHECKING:
    from collections.abc import Callable

PIECES_EACH = 8
"""Pieces for every thread, so that none waits long for the last one."""


def in_pieces(
    work: Callable[[int, int], None], count: int, least: int = 1, poll: Callable[[float], None] | None = None
) -> None:
    """Do `work(first, end)` for pieces that together make `range(count)`.

    Args:
        work: a call of a kernel that runs without the interpreter lock; its pieces must not depend on each other.
        count: how many numbers there are.
        least: smallest piece worth a thread.
        poll: as for `in_threads`; not called when all is done in one piece.
    """
    pieces = min(PIECES_EACH * workers(), count // least)
    if pieces < 2 or workers() == 1:
        work(0, count)
        return
    ends = [count * k // pieces for k in range(pieces + 1)]
    in_threads(lambda piece: work(*piece), itertools.pairwise(ends), poll)
