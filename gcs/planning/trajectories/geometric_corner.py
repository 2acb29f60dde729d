"""Geometric optimisation of corners: one large turn becomes four equal ones (equations 11-14 of the yard paper).

The corner D of A-D-G with interior angle alpha is replaced: A-B-H-I-F-G, BD = DF = l. C on BD and E on DF have
BC = EF, H and I divide CE into three, and BC = CH = HI = IE = EF. That gives BC = 2 l s / (3 + 2 s) with
s = sin(alpha / 2), and four turns of (180 deg - alpha) / 4 at B, H, I and F. The new path passes the corner at
3 l cos(alpha / 2) / (3 + 2 s): a right angle with l = 5 m gives up 2.4 m.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gcs.planning.trajectories.corner_cutting import CutPath, replace_corners

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from gcs.planning.trajectories.corner_cutting import SegmentFree


def four_turns(before: NDArray[np.float64], after: NDArray[np.float64]) -> NDArray[np.float64]:
    """B, H, I and F for a corner in the origin and l = 1 m.

    Args:
        before: unit vector from the corner to the point before it, shape (D,).
        after: unit vector to the point after it, shape (D,).

    Returns:
        Shape (4, D).
    """
    half_sine = float(np.linalg.norm(after - before)) / 2
    to_c = 1 - 2 * half_sine / (3 + 2 * half_sine)
    c, e = to_c * before, to_c * after
    return np.stack([before, (2 * c + e) / 3, (c + 2 * e) / 3, after])


def four_turn_corners(
    path_m: ArrayLike,
    must_visit: ArrayLike,
    max_deviation_m: float,
    segment_free: SegmentFree,
) -> CutPath:
    """Split every corner into four equal turns, with l as large as the legs, the deviation and the clearance allow.

    l is at most half the shorter leg; B-H-I-F, which runs outside BF, keeps the clearance itself.

    Args:
        path_m: polyline, shape (N, D), D = 2 or 3; its legs are taken to be free.
        must_visit: points that are never cut away, shape (N,); both ends never are.
        max_deviation_m: how far the new path may pass a corner; infinity for no limit.
        segment_free: whether the straight between two points of shape (D,) keeps the clearance.

    Returns:
        The path with four points in the place of each corner; a corner that cannot be replaced stays.

    Raises:
        InputError: fewer than two points, repeated points, numbers that are not finite, or a deviation that is not
            positive; it names the leg.
    """
    return replace_corners(path_m, must_visit, max_deviation_m, segment_free, four_turns)
