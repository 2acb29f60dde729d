"""How far a straight line goes before it comes too near to something, by sphere tracing (Hart 1996)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

_MOST_STEPS = 400


def free_lengths(
    origins_m: NDArray[np.float64],
    directions: NDArray[np.float64],
    wanted_m: NDArray[np.float64],
    keep_m: NDArray[np.float64],
    distance: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    close_m: float,
) -> NDArray[np.float64]:
    """Lengths along which lines keep their distance.

    A step of `distance - keep` cannot pass anything, because distance changes by at most the distance moved.

    Args:
        origins_m: shape (N, 3).
        directions: unit, shape (N, 3).
        wanted_m: tracing ends here, shape (N,).
        keep_m: distance to be kept, shape (N,).
        distance: of points (M, 3), shape (M,).
        close_m: tracing ends where no more than this is left above what is to be kept.

    Returns:
        Shape (N,): at least `wanted_m` where the whole line is clear; else a length up to which it is; 0 where it is
        not clear from the start.
    """
    length = np.zeros(len(origins_m))
    open_ = np.arange(len(origins_m))
    for _ in range(_MOST_STEPS):
        if not len(open_):
            break
        points = origins_m[open_] + length[open_, None] * directions[open_]
        room = distance(points) - keep_m[open_]
        going = room > close_m
        length[open_[going]] += room[going]
        open_ = open_[going & (length[open_] < wanted_m[open_])]
    return length
