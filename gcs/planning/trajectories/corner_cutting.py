"""Trajectory correction: a polyline's corner B is replaced by E on AB and F on BC with EB = BF (gantry-crane paper).

A smooth curve through a sharp corner swings wide of it; through the cut corner it does not. The same search for how
much may be cut serves other shapes that grow with EB, such as the four equal turns of `geometric_corner`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import ArrayLike, NDArray

    SegmentFree = Callable[[NDArray[np.float64], NDArray[np.float64]], bool]
    UnitShape = Callable[[NDArray[np.float64], NDArray[np.float64]], NDArray[np.float64]]

LEAST_ANGLE_RAD = 1e-3
"""Corners that turn by less are straight; those with a smaller interior angle double back, and no cut softens them."""

RESOLUTION_M = 0.01
"""The search for the largest free cut ends here; smaller cuts are not made."""

COINCIDENT_M = 1e-9
"""Two cuts that meet in the middle of a leg share one point."""


@dataclass(frozen=True, eq=False)
class CutPath:
    """A polyline with its corners replaced.

    Attributes:
        points_m: shape (M, D).
        must_visit: which of them are points of the original that have to be visited, shape (M,).
    """

    points_m: NDArray[np.float64]
    must_visit: NDArray[np.bool_]


def cut_corners(
    path_m: ArrayLike,
    must_visit: ArrayLike,
    max_deviation_m: float,
    segment_free: SegmentFree,
) -> CutPath:
    """Cut every corner once, as far as the legs, the deviation and the clearance allow.

    Args:
        path_m: polyline, shape (N, D), D = 2 or 3; its legs are taken to be free.
        must_visit: points that are never cut away, shape (N,); both ends never are.
        max_deviation_m: how far the new path may pass a corner; infinity for no limit.
        segment_free: whether the straight between two points of shape (D,) keeps the clearance.

    Returns:
        The path with E and F in the place of each corner; a corner that cannot be cut stays.

    Raises:
        InputError: fewer than two points, repeated points, numbers that are not finite, or a deviation that is not
            positive; it names the leg.
    """
    return replace_corners(path_m, must_visit, max_deviation_m, segment_free, _chord)


def replace_corners(
    path_m: ArrayLike,
    must_visit: ArrayLike,
    max_deviation_m: float,
    segment_free: SegmentFree,
    unit_shape: UnitShape,
) -> CutPath:
    """Replace every corner by the largest free copy of a shape.

    Args:
        path_m: as of `cut_corners`.
        must_visit: as of `cut_corners`.
        max_deviation_m: as of `cut_corners`.
        segment_free: as of `cut_corners`; asked about every straight of the shape.
        unit_shape: the shape that begins and ends 1 m from a corner in the origin, from the unit vectors to the points
            before and after it: shape (2 k, D), symmetric, its middle straight the nearest to the corner.

    Raises:
        InputError: as of `cut_corners`.
    """
    path, kept = _checked(path_m, must_visit, max_deviation_m)
    legs = np.diff(path, axis=0)
    lengths = np.linalg.norm(legs, axis=1)
    directions = legs / lengths[:, None]
    points, marks = [path[0]], [bool(kept[0])]
    for index in range(1, len(path) - 1):
        replacement = path[index][None]
        if not kept[index]:
            before, after = -directions[index - 1], directions[index]
            longest = min(lengths[index - 1], lengths[index]) / 2
            shape = _largest_free(path[index], before, after, longest, max_deviation_m, segment_free, unit_shape)
            replacement = replacement if shape is None else shape
        if np.linalg.norm(replacement[0] - points[-1]) <= COINCIDENT_M:
            replacement = replacement[1:]
        points.extend(replacement)
        marks.extend([bool(kept[index])] * len(replacement))
    points.append(path[-1])
    marks.append(bool(kept[-1]))
    return CutPath(np.array(points), np.array(marks))


def interior_angle(before: NDArray[np.float64], after: NDArray[np.float64]) -> float:
    """Angle (rad, 0 to pi) between two unit vectors, exact near both ends."""
    return 2 * math.atan2(float(np.linalg.norm(before - after)), float(np.linalg.norm(before + after)))


def _chord(before: NDArray[np.float64], after: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.stack([before, after])


def _largest_free(
    corner: NDArray[np.float64],
    before: NDArray[np.float64],
    after: NDArray[np.float64],
    longest_m: float,
    max_deviation_m: float,
    segment_free: SegmentFree,
    unit_shape: UnitShape,
) -> NDArray[np.float64] | None:
    """The largest copy of the shape that bisection finds free, or None."""
    if not LEAST_ANGLE_RAD <= interior_angle(before, after) <= math.pi - LEAST_ANGLE_RAD:
        return None
    shape = unit_shape(before, after)
    middle = len(shape) // 2
    given_up = float(np.linalg.norm(shape[middle - 1] + shape[middle])) / 2
    high = min(longest_m, max_deviation_m / given_up)
    low = 0.0
    if high < RESOLUTION_M:
        return None

    def placed(cut_m: float) -> NDArray[np.float64]:
        return np.asarray(corner + cut_m * shape)

    def free(points: NDArray[np.float64]) -> bool:
        return all(segment_free(a, b) for a, b in pairwise(points))

    if free(placed(high)):
        return placed(high)
    while high - low > RESOLUTION_M:
        cut = (low + high) / 2
        if free(placed(cut)):
            low = cut
        else:
            high = cut
    return placed(low) if low >= RESOLUTION_M else None


def _checked(
    path_m: ArrayLike, must_visit: ArrayLike, max_deviation_m: float
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    path = np.array(path_m, dtype=np.float64)
    if path.ndim != 2 or len(path) < 2:
        raise InputError(f"a path needs at least two points, shape (N, D), not {path.shape}", field="path_m")
    finite = np.isfinite(path).all(axis=1)
    if not finite.all():
        bad = int(np.argmin(finite))
        raise InputError(f"leg {max(bad - 1, 0)}: point {bad} is not a finite number", field="path_m")
    same = (path[1:] == path[:-1]).all(axis=1)
    if same.any():
        bad = int(np.argmax(same))
        raise InputError(
            f"leg {bad} has no length: points {bad} and {bad + 1} are one place; leave one out", field="path_m"
        )
    kept = np.asarray(must_visit, dtype=np.bool_)
    if kept.shape != (len(path),):
        raise InputError(f"there are {len(path)} points, but marks of shape {kept.shape}", field="must_visit")
    if not max_deviation_m > 0:
        raise InputError(f"the deviation must be positive, not {max_deviation_m:g} m", field="max_deviation_m")
    return path, kept
