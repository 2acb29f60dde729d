"""Axis-aligned boxes about a straight, within the corridor's reach, and proved clear where the space is tight.

Straights are cut into sub-legs, and every sub-leg gets its bounding box grown by a margin on all sides. The box of a
slanting sub-leg reaches further from the leg than the box of one along an axis, so slanting sub-legs are cut short and
their margin is taken smaller.

In the tight space a box grows from the sub-leg's bounding box towards the box it would have had, on every side as far
as it stays clear, and a sub-leg whose bounding box is not clear is halved.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from gcs.planning.numerics.compiled import compiled

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from gcs.planning.scene.free_space import FreeSpace

COLUMN_HALF_WIDTH_M = 0.1
"""Half-width of the boxes of the vertical take-off and landing column: it keeps the curve over home near the ground."""

SMALLEST_MARGIN = 0.55
"""Sub-legs are cut so short that their margin is at least this share of the corridor's half-width."""

LEAST_MARGIN_M = 0.003
"""Smallest margin of a box in a tight place."""

SHORTEST_CUT_M = 0.02
"""Sub-legs are not halved below this length; what is not clear then is left to the certificates."""


def box_parts(
    a: NDArray[np.float64],
    b: NDArray[np.float64],
    half_width_m: float,
    reach_m: float,
    longest_m: float,
    *,
    column: bool = False,
    space: FreeSpace | None = None,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Cut a straight into sub-legs and box them.

    Args:
        a: where the straight starts, shape (3,).
        b: where it ends.
        half_width_m: margin of the boxes at most.
        reach_m: no point of a box is further from its sub-leg than this.
        longest_m: longest sub-leg.
        column: whether it is the vertical column over home: slim, never under its lower end, exempt from the ground.
        space: where it is tight; without it, or where the straight keeps the reach, all boxes are of full size.

    Returns:
        Ends of the sub-legs, shape (n, 3), and low and high corners of their boxes, shape (n, 2, 3).
    """
    ends = _cut(a, b, half_width_m, reach_m, longest_m)
    low, high = np.minimum(ends[:-1], ends[1:]), np.maximum(ends[:-1], ends[1:])
    margin = np.full(3, _margin(np.abs(ends[1] - ends[0]), half_width_m, reach_m))
    if column:
        margin[:2] = min(COLUMN_HALF_WIDTH_M, margin[0])
    low, high = low - margin, high + margin
    if column:
        low[:, 2] = np.maximum(low[:, 2], min(a[2], b[2]))
    boxes = np.stack([low, high], axis=1)
    if space is None or column or space.segment_free(a, b, model=space.wide_model):
        return ends[1:], boxes
    parts = [_fitted(c, d, box, space) for c, d, box in zip(ends[:-1], ends[1:], boxes, strict=True)]
    return np.concatenate([part[0] for part in parts]), np.concatenate([part[1] for part in parts])


def stop_box(stop_m: NDArray[np.float64], half_width_m: float, space: FreeSpace | None = None) -> NDArray[np.float64]:
    """The box about a stop (3,), smaller where the space is tight; shape (2, 3)."""
    box = np.stack([stop_m - half_width_m, stop_m + half_width_m])
    if space is None or space.is_wide(stop_m)[0] or not space.is_free(stop_m)[0]:
        return box
    (found,) = _fitted(stop_m, stop_m, box, space)[1]
    return np.asarray(found)


def _fitted(
    a: NDArray[np.float64], b: NDArray[np.float64], box: NDArray[np.float64], space: FreeSpace
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Cut a sub-leg until a clear box can be had about each part, within the box it would have had.

    Returns:
        Ends of the parts, shape (n, 3), and their boxes, shape (n, 2, 3).
    """
    if space.box_free(*box):
        return b[None], box[None]
    low, high = np.minimum(a, b) - LEAST_MARGIN_M, np.maximum(a, b) + LEAST_MARGIN_M
    if space.box_free(low, high):
        return b[None], space.grown_box(low, high, *box)[None]
    if math.dist(a, b) < 2 * SHORTEST_CUT_M:
        return b[None], box[None]
    middle = (a + b) / 2
    first, second = _fitted(a, middle, box, space), _fitted(middle, b, box, space)
    return np.concatenate([first[0], second[0]]), np.concatenate([first[1], second[1]])


def _cut(
    a: NDArray[np.float64], b: NDArray[np.float64], half_width_m: float, reach: float, longest_m: float
) -> NDArray[np.float64]:
    """Ends of equal sub-legs of a straight, shape (n + 1, 3), each short enough for its margin."""
    span = np.abs(b - a)
    count = max(1, math.ceil(float(np.linalg.norm(b - a)) / longest_m - 1e-9))
    margin = SMALLEST_MARGIN * half_width_m
    too_few = count - 1
    while _reach(span / count, margin) > reach:
        too_few, count = count, 2 * count
    while count - too_few > 1:
        middle = (count + too_few) // 2
        if _reach(span / middle, margin) > reach:
            too_few = middle
        else:
            count = middle
    share = np.linspace(0.0, 1.0, count + 1)[:, None]
    return (1 - share) * a + share * b


def _margin(span: NDArray[np.float64], half_width_m: float, reach: float) -> float:
    """Largest margin (m), at most the half-width, with which the box of a sub-leg stays within the reach.

    Args:
        span: absolute components of the sub-leg (m), shape (3,).
        half_width_m: of the corridor.
        reach: largest distance (m) of the box from the sub-leg.
    """
    if _reach(span, half_width_m) <= reach + 1e-9:
        return half_width_m
    low, high = SMALLEST_MARGIN * half_width_m, half_width_m
    for _ in range(20):
        middle = (low + high) / 2
        low, high = (middle, high) if _reach(span, middle) <= reach else (low, middle)
    return low


def _reach(span: NDArray[np.float64], margin_m: float) -> float:
    """Largest distance (m) from a sub-leg to a point of its bounding box grown by a margin.

    The distance from a straight is convex, so it is largest at a corner; opposite corners are alike.
    """
    return _corner_distance(float(span[0]), float(span[1]), float(span[2]), margin_m)


@compiled
def _corner_distance(x: float, y: float, z: float, margin: float) -> float:
    """See `_reach`."""
    square = x * x + y * y + z * z
    worst = 0.0
    for high_y in (False, True):
        for high_z in (False, True):
            px = x + margin
            py = y + margin if high_y else -margin
            pz = z + margin if high_z else -margin
            along = min(max((px * x + py * y + pz * z) / square, 0.0), 1.0) if square > 0.0 else 0.0
            away = math.sqrt((px - along * x) ** 2 + (py - along * y) ** 2 + (pz - along * z) ** 2)
            worst = max(worst, away)
    return worst
