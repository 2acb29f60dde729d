"""Where the vehicles of a fleet stand."""

from __future__ import annotations

import itertools
import math
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.errors import InputError
from gcs.planning.scene.fence import fence_volume, room_in_fence

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from gcs.core.scenario import Scenario
    from gcs.planning.scene.point_distance import SceneDistance

BETWEEN_PADS_M = 0.5
"""Pads of a row are this much further apart than the vehicles have to be."""

DIRECTIONS = 8
"""Directions from home in which a row is tried."""

OVER_PADS_M = 10.0
"""The air over the pads of a row is free up to this height."""


def pads_of_fleet(scenario: Scenario, distance: SceneDistance, work_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """The pads: home and those that are given, or a row beside home that is clear of the structure.

    Args:
        scenario: for home, pads, separation and fence.
        distance: exact distance to the scene.
        work_m: about where the work is, shape (3,); a row is rather across the way there than along it.

    Returns:
        Shape (count, 3).

    Raises:
        InputError: pads are nearer to each other than the vehicles may be, or no row has room.
    """
    vehicle, apart = scenario.vehicle, scenario.safety.apart_m
    home = np.asarray(scenario.home_m, dtype=np.float64)
    if vehicle.pads_m:
        pads = np.array([scenario.home_m, *vehicle.pads_m], dtype=np.float64)
        for a, b in itertools.combinations(range(len(pads)), 2):
            away = float(np.linalg.norm(pads[a] - pads[b]))
            if away < apart + BETWEEN_PADS_M / 2:
                raise InputError(
                    f"the pads of vehicles {a + 1} and {b + 1} are {away:.1f} m apart, and separation and errors ask "
                    f"for {apart + BETWEEN_PADS_M / 2:.1f} m: move them further apart",
                    field="vehicle.pads_m",
                )
        return pads
    steps = np.arange(vehicle.count)[:, None] * (apart + BETWEEN_PADS_M)
    angles = 2 * math.pi * np.arange(DIRECTIONS) / DIRECTIONS
    rows = np.stack([np.cos(angles), np.sin(angles), np.zeros(DIRECTIONS)], axis=1)
    along = np.abs(rows @ (work_m - home))
    for number in np.argsort(along.round(6), kind="stable"):
        pads = home + steps * rows[number]
        if _is_free(pads, scenario, distance):
            return np.asarray(pads)
    raise InputError(
        f"no row of {vehicle.count} pads beside home_m is clear of the structure and inside the fence: give places",
        field="vehicle.pads_m",
    )


def _is_free(pads: NDArray[np.float64], scenario: Scenario, distance: SceneDistance) -> bool:
    column = np.arange(0.0, OVER_PADS_M, 0.25)[:, None] * np.array([0.0, 0.0, 1.0])
    points = (pads[1:, None] + column[None]).reshape(-1, 3)
    asked = scenario.centre_clearance_m + scenario.safety.corridor_half_width_m
    fence = fence_volume(scenario.fence, scenario.vehicle, scenario.safety)
    clear = distance.distance(points, ground=False) >= asked
    return bool(clear.all() and (room_in_fence(points, fence) >= 0).all())
