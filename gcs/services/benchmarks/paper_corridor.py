"""A corridor through all viewpoints, to be flown in one curve as the papers fly: slim about each viewpoint.

Where the path bends so far at a viewpoint that the slim boxes before and after it meet in more than a small box, the
curve could pass beside it. There it stops, and a new curve begins.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gcs.planning.trajectories.safe_corridor import LegCorridor, build_corridor
from gcs.planning.trajectories.trajectory_builder import longest_segment_m

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from gcs.planning.scene.free_space import FreeSpace
    from gcs.planning.trajectories.time_allocation import FlightLimits

SLIM_M = 0.02
"""Half width of the boxes about a viewpoint."""

SLIM_LENGTH_M = 0.15
"""How far before and after a viewpoint the corridor is slim; at most a third of the straight."""

MISS_M = 0.05
"""The curve passes a viewpoint within this."""


def passing_corridors(
    legs_m: Sequence[NDArray[np.float64]], limits: FlightLimits, half_width_m: float, space: FreeSpace
) -> list[LegCorridor]:
    """Corridors from home through all viewpoints and home again, one for each curve between stops.

    Args:
        legs_m: polylines (K, 3) from viewpoint to viewpoint, home first and last; each has a length.
        limits: of the vehicle.
        half_width_m: of the corridor about the legs.
        space: where the legs are free.
    """
    last = len(legs_m) - 1
    longest = longest_segment_m(limits, half_width_m)
    corridors: list[LegCorridor] = []
    joints: list[NDArray[np.float64]] = [legs_m[0][:1]]
    boxes: list[NDArray[np.float64]] = []
    for index, leg in enumerate(legs_m):
        middle = leg.copy()
        if index:
            middle[0] = _beside(leg[0], leg[1])
            after = _slim_box(leg[0], middle[0])
            if _farthest(boxes[-1][-1], after[0], leg[0]) > MISS_M:
                corridors.append(LegCorridor(np.concatenate(joints), np.concatenate(boxes)))
                joints, boxes = [leg[:1]], []
            joints.append(middle[:1])
            boxes.append(after)
        if index < last:
            middle[-1] = _beside(leg[-1], leg[-2])
        between = build_corridor(
            middle, half_width_m, longest, column_at_start=index == 0, column_at_end=index == last, space=space
        )
        joints.append(between.joints_m[1:])
        boxes.append(between.boxes_m)
        if index < last:
            joints.append(leg[-1:])
            boxes.append(_slim_box(middle[-1], leg[-1]))
    return [*corridors, LegCorridor(np.concatenate(joints), np.concatenate(boxes))]


def _beside(viewpoint: NDArray[np.float64], neighbour: NDArray[np.float64]) -> NDArray[np.float64]:
    """The point on the way to a neighbour where the corridor stops being slim."""
    way = neighbour - viewpoint
    return np.asarray(viewpoint + way * min(SLIM_LENGTH_M / float(np.linalg.norm(way)), 1 / 3))


def _slim_box(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.stack([np.minimum(a, b) - SLIM_M, np.maximum(a, b) + SLIM_M])[None]


def _farthest(before: NDArray[np.float64], after: NDArray[np.float64], place: NDArray[np.float64]) -> float:
    """Largest distance of a place from any point that two boxes (2, 3) share."""
    low, high = np.maximum(before[0], after[0]), np.minimum(before[1], after[1])
    return float(np.linalg.norm(np.maximum(high - place, place - low)))
