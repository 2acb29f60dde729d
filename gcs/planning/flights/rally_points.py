"""Rally points: places beside home where the vehicle may come down."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gcs.core.errors import InputError
from gcs.planning.scene.fence import fence_volume, room_in_fence
from gcs.planning.scene.free_length import free_lengths

if TYPE_CHECKING:
    from gcs.core.scenario import Scenario
    from gcs.planning.scene.point_distance import SceneDistance

ON_GROUND_M = 0.1
"""How far a rally point may be off the ground."""

_CLOSE_M = 0.01
_PROBE_M = 1e6


def check_rally_points(scenario: Scenario, distance: SceneDistance) -> None:
    """Hold the rally points against the scene: on the ground, inside the fence, clear, with a free column above.

    Args:
        scenario: with its rally points, fence and clearances.
        distance: exact distance to the scene.

    Raises:
        InputError: naming the first point that cannot be used, and why.
    """
    keep = scenario.centre_clearance_m
    fence = fence_volume(scenario.fence, scenario.vehicle, scenario.safety)
    for k, place in enumerate(scenario.rally_m):
        point, field = np.array([place], dtype=np.float64), f"rally_m.{k}"
        ground = scenario.ground_m
        if ground is not None and abs(point[0, 2] - ground) > ON_GROUND_M:
            raise InputError(f"is {point[0, 2] - ground:+.2f} m off the ground: put it on it", field=field)
        if room_in_fence(point, fence)[0] < 0.0:
            raise InputError(
                f"is outside the fence, or nearer to its edge than the {fence.margin_m:.2f} m that the vehicle's size "
                "and its errors take",
                field=field,
            )
        nearest = float(distance.distance(point, ground=False)[0])
        if nearest < keep:
            raise InputError(f"is {nearest:.2f} m from the structure, and {keep:.2f} m are kept", field=field)
        above = np.array([[*place[:2], _PROBE_M]])
        height = _PROBE_M - float(distance.distance(above, ground=False)[0]) + keep - point[0, 2]
        if height > 0.0:
            free = free_lengths(
                point,
                np.array([[0.0, 0.0, 1.0]]),
                np.array([height]),
                np.array([keep - _CLOSE_M]),
                lambda points: distance.distance(points, ground=False),
                _CLOSE_M,
            )[0]
            if free < height:
                raise InputError(f"something is above it from {free:.1f} m up: the way down must be free", field=field)
