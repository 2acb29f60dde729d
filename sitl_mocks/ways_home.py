"""How the two kinds of vehicle return by themselves: straight up, straight to the nearest place, down.

The place is home or a rally point, whichever is nearer; it is the nearest along the ground. Heights count from home at
either.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np

from sitl_mocks.fence_rally import RALLY
from sitl_mocks.flight_tasks import ReturnHome
from sitl_mocks.mission_items import StoredItem
from sitl_mocks.plan_id import sent_frame
from sitl_mocks.scene_frame import Array

if TYPE_CHECKING:
    from sitl_mocks.ardupilot import ArduPilotVehicle
    from sitl_mocks.px4 import Px4Vehicle
    from sitl_mocks.vehicle import SimulatedVehicle

_PX4_FRAMES = {0, 3}
"""Rally points that came in other frames are taken and told, but PX4 does not return to them."""


def px4_return(vehicle: Px4Vehicle) -> ReturnHome:
    """Within RTL_MIN_DIST of the place it climbs no higher than a cone of half angle RTL_CONE_ANG."""
    p = vehicle.parameters
    points = (point for point in vehicle.missions.others[RALLY].items if sent_frame(point) in _PX4_FRAMES)
    place, aside_m = _nearest_place(vehicle, points)
    height, angle = p["RTL_RETURN_ALT"], p["RTL_CONE_ANG"]
    if angle > 0.0 and aside_m <= p["RTL_MIN_DIST"]:
        cone = 0.0 if angle >= 90.0 else aside_m / math.tan(math.radians(angle))
        height = min(height, max(cone, 2.0 * p["NAV_ACC_RAD"]))
    return ReturnHome(vehicle.airframe, vehicle.base_limits(), vehicle.descent(), place, height)


def ardupilot_return(vehicle: ArduPilotVehicle) -> ReturnHome:
    """Within a cone about the place it climbs by 2.5 m only; slopes under 0.5 do not count."""
    p = vehicle.parameters
    place, aside_m = _nearest_place(vehicle, vehicle.missions.others[RALLY].items)
    height = float((vehicle.airframe.position_m - place)[2])
    target = max(p["RTL_ALT"] * 0.01, height + max(p["RTL_CLIMB_MIN"], 0.0) * 0.01)
    if p["RTL_CONE_SLOPE"] >= 0.5:
        target = min(target, max(aside_m * p["RTL_CONE_SLOPE"], height + 2.5))
    return ReturnHome(
        vehicle.airframe,
        vehicle.base_limits(),
        vehicle.descent(),
        place,
        max(target, height),
        p["RTL_LOIT_TIME"] * 1e-3,
    )


def _nearest_place(vehicle: SimulatedVehicle, points: Iterable[StoredItem]) -> tuple[Array, float]:
    """Where a return from here ends, at the height of home, and how far aside that is."""
    home = vehicle.home_m
    places = [home, *(np.array([*vehicle.frame.scene_e7(p.x, p.y, p.z)[:2], home[2]]) for p in points)]
    away = [float(np.hypot(*(place - vehicle.airframe.position_m)[:2])) for place in places]
    nearest = int(np.argmin(away))
    return places[nearest], away[nearest]
