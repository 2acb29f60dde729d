"""Flight corridor: a chain of overlapping axis-aligned boxes around a collision-free polyline.

Straights are cut into sub-legs, and every sub-leg gets its bounding box grown by a margin on all sides. The box of a
slanting sub-leg reaches further from the leg than the box of one along an axis, so slanting sub-legs are cut short and
their margin is taken smaller: no point of any box is further than `corridor_reach` from its leg. A search that keeps
the clearance plus that reach on the legs has therefore cleared the boxes whole.

Where a leg runs nearer than that, in the tight space, each box is proved clear by itself: it grows from the sub-leg's
bounding box towards the box it would have had, on every side as far as it stays clear, and a sub-leg whose bounding box
is not clear is halved.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.errors import InputError
from gcs.planning.numerics.compiled import compiled

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from gcs.planning.scene.free_space import FreeSpace

COLUMN_HALF_WIDTH_M = 0.1
"""Half-width of the boxes of the vertical take-off and landing column: it keeps the curve over home near the ground."""

SMALLEST_MARGIN = 0.55
"""Sub-legs are cut so short that their margin is at least this share of the corridor's half-width."""

SHORTEST = 0.2
"""Corners nearer to each other than this share of the half-width become one: tiny pieces make stiff problems."""

LEAST_MARGIN_M = 0.003
"""Smallest margin of a box in a tight place."""

SHORTEST_CUT_M = 0.02
"""Sub-legs are not halved below this length; what is not clear then is left to the certificates."""


@dataclass(frozen=True, eq=False)
class LegCorridor:
    """One leg from stop to stop, cut into segments, with the box of each.

    Attributes:
        joints_m: ends of the segments, shape (n + 1, 3); the first and the last are the stops.
        boxes_m: low and high corner of each segment's box, shape (n, 2, 3); joint k lies in boxes k - 1 and k.
    """

    joints_m: NDArray[np.float64]
    boxes_m: NDArray[np.float64]

    @property
    def lengths_m(self) -> NDArray[np.float64]:
        """Lengths of the segments' straight sub-legs, shape (n,)."""
        return np.asarray(np.linalg.norm(np.diff(self.joints_m, axis=0), axis=1))


def corridor_reach(half_width_m: float) -> float:
    """Largest distance (m) of any point of any box from its leg.

    It is the half-diagonal of a cube of that half-width: what a box around a single point reaches.
    """
    return math.sqrt(3.0) * half_width_m


def build_corridor(
    leg_m: NDArray[np.float64],
    half_width_m: float,
    longest_m: float = math.inf,
    *,
    column_at_start: bool = False,
    column_at_end: bool = False,
    space: FreeSpace | None = None,
) -> LegCorridor:
    """Cut a leg into segments and box them.

    Args:
        leg_m: polyline of the leg, shape (K, 3), K >= 2; corners close together become one.
        half_width_m: of the corridor about the leg, on each axis.
        longest_m: longest sub-leg; it bounds what one polynomial has to do.
        column_at_start: the leg starts on the ground with a vertical take-off: slim boxes, never under the start.
        column_at_end: the same for a vertical landing at the end.
        space: where the leg is free; without it the leg keeps the reach everywhere.

    Returns:
        The corridor; all its boxes lie within `corridor_reach(half_width_m)` of the leg, and those about free sub-legs
        keep the clearance.

    Raises:
        InputError: a leg of fewer than two different points, a number that is not finite, or a width or length that is
            not positive; it names the point.
    """
    _check(leg_m, half_width_m, longest_m)
    last = len(leg_m) - 1
    column_start = column_at_start and _is_vertical(leg_m[0], leg_m[1])
    column_end = column_at_end and _is_vertical(leg_m[last - 1], leg_m[last])
    fixed = {0, last} | ({1} if column_start else set()) | ({last - 1} if column_end else set())
    merged_m = SHORTEST * half_width_m
    kept = _merge_corners(leg_m, fixed, merged_m)
    if space is not None and not space.segments_free(leg_m[kept[:-1]], leg_m[kept[1:]], model=space.wide_model).all():
        kept = _merge_corners(leg_m, fixed, 1e-9)
    corners = leg_m[kept]
    if len(corners) < 2 or np.linalg.norm(np.diff(corners, axis=0), axis=1).min() < 1e-9:
        raise InputError("a leg needs two different points", field="leg_m")
    joints, boxes = [corners[:1]], []
    for index, (a, b) in enumerate(itertools.pairwise(corners)):
        column = (column_start and index == 0) or (column_end and index == len(corners) - 2)
        # Where corners were merged, the straight leaves the leg by at most `merged_m`.
        whole = kept[index + 1] - kept[index] == 1
        reach = corridor_reach(half_width_m) - (0.0 if whole else merged_m)
        ends = _cut(a, b, half_width_m, reach, longest_m)
        low, high = np.minimum(ends[:-1], ends[1:]), np.maximum(ends[:-1], ends[1:])
        margin = np.full(3, _margin(np.abs(ends[1] - ends[0]), half_width_m, reach))
        if column:
            margin[:2] = min(COLUMN_HALF_WIDTH_M, margin[0])
        low, high = low - margin, high + margin
        if column:
            low[:, 2] = np.maximum(low[:, 2], min(a[2], b[2]))
        if space is not None and not column and not space.segment_free(a, b, model=space.wide_model):
            parts = [
                _fitted(c, d, np.stack(box), space) for c, d, *box in zip(ends[:-1], ends[1:], low, high, strict=True)
            ]
            joints += [part[0] for part in parts]
            boxes += [part[1] for part in parts]
            continue
        joints.append(ends[1:])
        boxes.append(np.stack([low, high], axis=1))
    return LegCorridor(np.concatenate(joints), np.concatenate(boxes))


def _check(leg_m: NDArray[np.float64], half_width_m: float, longest_m: float) -> None:
    if leg_m.ndim != 2 or leg_m.shape[1] != 3 or len(leg_m) < 2:
        raise InputError(f"a leg is two or more points of three coordinates, not shape {leg_m.shape}", field="leg_m")
    finite = np.isfinite(leg_m).all(axis=1)
    if not finite.all():
        raise InputError(f"point {int(finite.argmin())} of the leg is not a finite number", field="leg_m")
    if not 0 < half_width_m < math.inf:
        raise InputError(f"a corridor's half-width must be positive, not {half_width_m:g}", field="half_width_m")
    if not longest_m > 0:
        raise InputError(f"the longest sub-leg must be positive, not {longest_m:g}", field="longest_m")


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


def _merge_corners(leg_m: NDArray[np.float64], fixed: set[int], merged_m: float) -> list[int]:
    """Indices of the corners that stay when corners nearer than `merged_m` to the one before become one with it."""
    kept = [0]
    for index in range(1, len(leg_m)):
        near = math.dist(leg_m[index], leg_m[kept[-1]]) < merged_m
        if near and index not in fixed:
            continue
        if near and kept[-1] not in fixed:
            kept.pop()
        kept.append(index)
    return kept


def _is_vertical(a: NDArray[np.float64], b: NDArray[np.float64]) -> bool:
    return bool(np.hypot(*(b - a)[:2]) < 1e-6)


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
