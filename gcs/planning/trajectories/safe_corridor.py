"""Flight corridor: a chain of overlapping convex sets around a collision-free polyline.

The sets are axis-aligned boxes (`box_corridor`), tubes or polytopes (`tube_corridor`). No point of any is further than
`corridor_reach` from its leg. A search that keeps the clearance plus that reach on the legs has therefore cleared the
sets whole; where a leg runs nearer than that, in the tight space, each set is proved clear by itself.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Literal

import numpy as np

from gcs.core.errors import InputError
from gcs.planning.trajectories.box_corridor import box_parts
from gcs.planning.trajectories.convex_set import box_planes, room_m
from gcs.planning.trajectories.passing import PASSED_WITHIN_M
from gcs.planning.trajectories.tube_corridor import convex_parts

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from gcs.planning.scene.free_space import FreeSpace
    from gcs.planning.trajectories.passing import Passing

CorridorKind = Literal["boxes", "tubes", "polytopes"]

SHORTEST = 0.2
"""Corners nearer to each other than this share of the half-width become one: tiny pieces make stiff problems."""


@dataclass(frozen=True, eq=False)
class LegCorridor:
    """One leg from stop to stop, cut into segments, with the box of each.

    Attributes:
        joints_m: ends of the segments, shape (n + 1, 3); the first and the last are the stops.
        boxes_m: low and high corner of each segment's box, shape (n, 2, 3); joint k lies in boxes k - 1 and k.
        passing: joints that the curve has to pass exactly; None without any.
        planes: of each segment's set (`convex_set`), which its box holds; empty where the boxes are the sets.
    """

    joints_m: NDArray[np.float64]
    boxes_m: NDArray[np.float64]
    passing: Passing | None = None
    planes: tuple[NDArray[np.float64], ...] = ()

    @property
    def lengths_m(self) -> NDArray[np.float64]:
        """Lengths of the segments' straight sub-legs, shape (n,)."""
        return np.asarray(np.linalg.norm(np.diff(self.joints_m, axis=0), axis=1))

    def sets(self) -> tuple[NDArray[np.float64], ...]:
        """Planes of each segment's set, those of the boxes where these are the sets."""
        return self.planes or tuple(box_planes(box) for box in self.boxes_m)

    @cached_property
    def joint_room_m(self) -> NDArray[np.float64]:
        """Distance of each inner joint to the border of what its two sets share, shape (n - 1,); negative outside."""
        inner = self.joints_m[1:-1]
        if not self.planes:
            low, high = self._overlaps()
            return np.asarray(np.minimum(inner - low, high - inner).min(axis=1))
        pairs = zip(inner, self.planes[:-1], self.planes[1:], strict=True)
        return np.array([min(room_m(left, joint), room_m(right, joint)) for joint, left, right in pairs])

    @property
    def shared_m(self) -> NDArray[np.float64]:
        """Low and high corner of where each inner joint may be, in both of its boxes, shape (n - 1, 2, 3)."""
        low, high = self._overlaps()
        if self.passing is not None:
            inner, place = self.passing.joints - 1, self.joints_m[self.passing.joints]
            low[inner] = np.maximum(low[inner], place - PASSED_WITHIN_M)
            high[inner] = np.minimum(high[inner], place + PASSED_WITHIN_M)
        return np.stack([low, high], axis=1)

    def _overlaps(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Low and high corner of what neighbouring boxes share, shape (n - 1, 3) each."""
        return (
            np.maximum(self.boxes_m[:-1, 0], self.boxes_m[1:, 0]),
            np.minimum(self.boxes_m[:-1, 1], self.boxes_m[1:, 1]),
        )


def joined_corridor(legs: Sequence[LegCorridor], passing: Passing) -> LegCorridor:
    """Legs one after the other as one, each starting where the one before ends.

    Args:
        legs: one or more.
        passing: what is asked at the joints between them.
    """
    joints = [legs[0].joints_m, *(leg.joints_m[1:] for leg in legs[1:])]
    planes = [part for leg in legs for part in leg.sets()] if any(leg.planes for leg in legs) else []
    return LegCorridor(np.concatenate(joints), np.concatenate([leg.boxes_m for leg in legs]), passing, tuple(planes))


def corridor_reach(half_width_m: float) -> float:
    """Largest distance (m) of any point of any set from its leg.

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
    kind: CorridorKind = "boxes",
) -> LegCorridor:
    """Cut a leg into segments and put a convex set about each.

    Args:
        leg_m: polyline of the leg, shape (K, 3), K >= 2; corners close together become one.
        half_width_m: of the corridor about the leg, on each axis.
        longest_m: longest sub-leg; it bounds what one polynomial has to do.
        column_at_start: the leg starts on the ground with a vertical take-off: slim boxes, never under the start.
        column_at_end: the same for a vertical landing at the end.
        space: where the leg is free; without it the leg keeps the reach everywhere.
        kind: of the sets; columns are boxes always.

    Returns:
        The corridor; all its sets lie within `corridor_reach(half_width_m)` of the leg, and those about free sub-legs
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
    if space is not None and not space.segments_free(leg_m[kept[:-1]], leg_m[kept[1:]]).all():
        kept = _merge_corners(leg_m, fixed, 1e-9)
    corners = leg_m[kept]
    if len(corners) < 2 or np.linalg.norm(np.diff(corners, axis=0), axis=1).min() < 1e-9:
        raise InputError("a leg needs two different points", field="leg_m")
    joints, boxes, planes = [corners[:1]], [], []
    for index, (a, b) in enumerate(itertools.pairwise(corners)):
        column = (column_start and index == 0) or (column_end and index == len(corners) - 2)
        # Where corners were merged, the straight leaves the leg by at most `merged_m`.
        whole = kept[index + 1] - kept[index] == 1
        reach = corridor_reach(half_width_m) - (0.0 if whole else merged_m)
        if kind != "boxes" and not column:
            convex = convex_parts(a, b, reach, longest_m, polytopes=kind == "polytopes", space=space)
            joints.append(np.stack([part.end_m for part in convex]))
            boxes.append(np.stack([part.box_m for part in convex]))
            planes += [part.planes for part in convex]
            continue
        ends, part_boxes = box_parts(a, b, half_width_m, reach, longest_m, column=column, space=space)
        joints.append(ends)
        boxes.append(part_boxes)
        planes += [box_planes(box) for box in part_boxes] if kind != "boxes" else []
    return LegCorridor(np.concatenate(joints), np.concatenate(boxes), planes=tuple(planes))


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
