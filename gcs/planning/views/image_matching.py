"""Which picture belongs to which viewpoint: by sequence, position and heading.

Pictures and viewpoints are both in time order, so the match is an alignment of two sequences: pictures may be missing
(a capture failed), and pictures may be extra (a test shot), but the order is kept. The alignment of least cost is
found by dynamic programming, as in edit distance.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

MAX_DISTANCE_M = 1.5
"""A picture taken further from a viewpoint than this is not of that viewpoint (fix error and hold error together)."""

MAX_ANGLE_RAD = math.radians(25.0)
"""A picture whose heading is further off than this is not of that viewpoint."""


def match_images(
    positions_m: NDArray[np.float64],
    headings_rad: NDArray[np.float64],
    viewpoint_positions_m: NDArray[np.float64],
    viewpoint_headings_rad: NDArray[np.float64],
) -> list[int | None]:
    """Assign pictures, in the order they were taken, to viewpoints, in visiting order.

    Args:
        positions_m: where each picture was taken, scene ENU, shape (N, 3); NaN rows where not known.
        headings_rad: where each picture looks, as an angle in the plane, shape (N,); NaN where not known.
        viewpoint_positions_m: shape (M, 3).
        viewpoint_headings_rad: in the same sense, shape (M,); NaN where the view is too steep to have one.

    Returns:
        For every picture the viewpoint's index, or None for a picture of no viewpoint. A viewpoint is given to at most
        one picture, and the order is kept. A picture without a position can only be matched when counts leave no
        choice, that is when there are as many pictures as viewpoints.
    """
    n, m = len(positions_m), len(viewpoint_positions_m)
    if n == 0 or m == 0:
        return [None] * n
    distance = np.linalg.norm(positions_m[:, None] - viewpoint_positions_m[None], axis=2)
    turn = np.abs((headings_rad[:, None] - viewpoint_headings_rad[None] + np.pi) % (2 * np.pi) - np.pi)
    angle = np.where(np.isnan(turn), 0.0, turn)
    same_place = np.eye(n, m, dtype=bool) if n == m else np.zeros((n, m), dtype=bool)
    unknown = np.isnan(distance)
    allowed = np.where(unknown, same_place, (distance <= MAX_DISTANCE_M) & (angle <= MAX_ANGLE_RAD))
    # A match is worth 1 to 3, so that more matches always beat closer ones within reason; gaps are worth nothing.
    closeness = 1.0 - 0.5 * np.where(unknown, MAX_DISTANCE_M, distance) / MAX_DISTANCE_M - 0.5 * angle / MAX_ANGLE_RAD
    worth = np.where(allowed, 2.0 + closeness, -np.inf)
    best = np.zeros((n + 1, m + 1))
    for i in range(1, n + 1):
        for j in range(1, m + 1):
            best[i, j] = max(best[i - 1, j], best[i, j - 1], best[i - 1, j - 1] + worth[i - 1, j - 1])
    result: list[int | None] = [None] * n
    i, j = n, m
    while i > 0 and j > 0:
        if best[i, j] == best[i - 1, j]:
            i -= 1
        elif best[i, j] == best[i, j - 1]:
            j -= 1
        else:
            i, j = i - 1, j - 1
            result[i] = j
    return result
