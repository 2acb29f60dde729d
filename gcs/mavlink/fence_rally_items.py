"""A scenario's fence and rally points as items for a vehicle.

One height datum: rally points carry their altitude above mean sea level, as the mission does. They go out in frame 0:
PX4 takes frames 5 and 6 but then does not use the point for its return. ArduPilot keeps whole metres, so it is sent
whole metres. The corners of a fence have no height. `fence.max_height_m` is not among the items: both autopilots have
it in a parameter (GF_MAX_VER_DIST, FENCE_ALT_MAX) that is counted from home and shapes the vehicle's own return too;
the plan keeps below it by itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.frames import geodetic_from_enu
from gcs.core.mission import Command, Frame, MissionItem
from gcs.core.vehicle import Autopilot

if TYPE_CHECKING:
    from gcs.core.frames import GeoPoint
    from gcs.core.scenario import Scenario


def fence_items(scenario: Scenario) -> tuple[MissionItem, ...]:
    """The polygons of a scenario's fence, the included ones first; empty without any.

    Each corner is an item whose param1 is the number of its polygon's corners. A corner that the next one repeats (as
    when a polygon is closed by its first corner) is left out: ArduPilot refuses such polygons.
    """
    if scenario.fence is None:
        return ()
    items: list[MissionItem] = []
    anchor = scenario.anchor.point
    for command, polygons in (
        (Command.NAV_FENCE_POLYGON_VERTEX_INCLUSION, scenario.fence.include),
        (Command.NAV_FENCE_POLYGON_VERTEX_EXCLUSION, scenario.fence.exclude),
    ):
        for polygon in polygons:
            corners = _corners([_place((*corner, 0.0), anchor)[:2] for corner in polygon])
            for x, y in corners:
                params = (float(len(corners)), 0.0, 0.0, 0.0)
                items.append(MissionItem(len(items), Frame.GLOBAL, command, params, x, y, 0.0, autocontinue=0))
    return tuple(items)


def rally_items(scenario: Scenario, autopilot: Autopilot) -> tuple[MissionItem, ...]:
    """The rally points of a scenario; empty without any."""
    items = []
    for k, point in enumerate(scenario.rally_m):
        x, y, altitude_m = _place(point, scenario.anchor.point)
        z = float(round(altitude_m)) if autopilot is Autopilot.ARDUPILOT else round(altitude_m, 2)
        params = (0.0, 0.0, 0.0, 0.0)
        items.append(MissionItem(k, Frame.GLOBAL, Command.NAV_RALLY_POINT, params, x, y, z, autocontinue=0))
    return tuple(items)


def _place(point_m: Sequence[float], anchor: GeoPoint) -> tuple[int, int, float]:
    latitude, longitude, altitude = geodetic_from_enu(np.asarray(point_m, dtype=np.float64), anchor)
    return round(float(latitude) * 1e7), round(float(longitude) * 1e7), float(altitude)


def _corners(places: Sequence[tuple[int, int]]) -> list[tuple[int, int]]:
    return [place for k, place in enumerate(places) if place != places[(k + 1) % len(places)]]
