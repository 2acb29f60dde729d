"""A plan's mission, and the files that carry it to other ground stations.

`mission.plan` is QGroundControl's JSON, `mission.waypoints` the tab-separated list of Mission Planner ("QGC WPL 110").
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from gcs.core.errors import RefusedError
from gcs.core.frames import GeoPoint, geodetic_from_enu
from gcs.core.mission import PLACE_COMMANDS, Mission, MissionItem
from gcs.core.vehicle import Autopilot
from gcs.mavlink.mission_items import MissionLimits, build_mission
from gcs.planning.trajectories.mission_sampling import CHORD_ERROR_M, sample_mission_path

if TYPE_CHECKING:
    from gcs.core.plan import Plan

_MAV_AUTOPILOT = {Autopilot.PX4: 12, Autopilot.ARDUPILOT: 3, Autopilot.GENERIC: 0}
_MAV_TYPE_QUADROTOR = 2
_FILE_FRAME = {5: 0, 6: 3}
"""Files have degrees, not integers: their frames are the plain ones."""
_ABSOLUTE_ALTITUDE = 2


@dataclass(frozen=True)
class MissionFiles:
    """The files of a plan's mission.

    Attributes:
        items: number of items in PX4's words; None for a plan of several sorties, each of which has its own mission.
        files: name -> content.
    """

    items: int | None
    files: dict[str, bytes]


def mission_files(plan: Plan) -> MissionFiles:
    """`mission.plan` for QGroundControl (PX4's words) and `mission.waypoints` for Mission Planner (ArduPilot's)."""
    if plan.sorties:
        return MissionFiles(None, {})
    home, speed_m_s = home_of_plan(plan), plan.scenario.vehicle.max_speed_m_s
    px4 = mission_of_plan(plan, Autopilot.PX4)
    ardupilot = mission_of_plan(plan, Autopilot.ARDUPILOT)
    return MissionFiles(
        len(px4.items),
        {
            "mission.plan": qgroundcontrol_plan(px4, Autopilot.PX4, home, speed_m_s).encode(),
            "mission.waypoints": mission_planner_waypoints(ardupilot, Autopilot.ARDUPILOT, home).encode(),
        },
    )


def mission_of_plan(
    plan: Plan,
    autopilot: Autopilot,
    limits: MissionLimits | None = None,
    chord_error_m: float = CHORD_ERROR_M,
) -> Mission:
    """The mission that flies a plan.

    Args:
        plan: the plan.
        autopilot: whose words to use.
        limits: speeds that it commands at most; the plan's own when not given.
        chord_error_m: how far the plan's curve may lie from the straight legs between waypoints.

    Raises:
        RefusedError: the plan is several sorties.
    """
    if plan.sorties:
        raise RefusedError(
            f"this plan is {len(plan.sorties)} sorties with a battery each: fly one of them (`--sortie`)",
            field="sortie",
        )
    path = sample_mission_path(plan.trajectory, [v.time_s for v in plan.viewpoints], chord_error_m)
    return build_mission(plan, path.takeoff_m, path.legs_m, autopilot, limits)


def home_of_plan(plan: Plan) -> GeoPoint:
    """Where the vehicle starts, as latitude, longitude and altitude."""
    latitude, longitude, altitude = geodetic_from_enu(plan.scenario.home_m, plan.scenario.anchor.point)
    return GeoPoint(float(latitude), float(longitude), float(altitude))


def qgroundcontrol_plan(mission: Mission, autopilot: Autopilot, home: GeoPoint, speed_m_s: float) -> str:
    """Content of a `.plan` file.

    Args:
        mission: the items; ArduPilot's item 0 becomes the planned home position.
        autopilot: whose words the items are in.
        home: planned home position.
        speed_m_s: shown as cruise and hover speed.
    """
    items = mission.items[1:] if autopilot is Autopilot.ARDUPILOT else mission.items
    content = {
        "fileType": "Plan",
        "groundStation": "QGroundControl",
        "version": 1,
        "mission": {
            "version": 2,
            "firmwareType": _MAV_AUTOPILOT[autopilot],
            "vehicleType": _MAV_TYPE_QUADROTOR,
            "globalPlanAltitudeMode": _ABSOLUTE_ALTITUDE,
            "cruiseSpeed": speed_m_s,
            "hoverSpeed": speed_m_s,
            "plannedHomePosition": [home.latitude_deg, home.longitude_deg, home.altitude_m],
            "items": [_simple_item(number, item) for number, item in enumerate(items, start=1)],
        },
        "geoFence": {"version": 2, "circles": [], "polygons": []},
        "rallyPoints": {"version": 2, "points": []},
    }
    return json.dumps(content, indent=2, allow_nan=False) + "\n"


def mission_planner_waypoints(mission: Mission, autopilot: Autopilot, home: GeoPoint) -> str:
    """Content of a `.waypoints` file: one line an item, the first of them home.

    Args:
        mission: the items; a home line is put before those that have none.
        autopilot: whose words the items are in.
        home: planned home position.
    """
    has_home = autopilot is Autopilot.ARDUPILOT
    first = f"0\t1\t0\t16\t0\t0\t0\t0\t{home.latitude_deg:.8f}\t{home.longitude_deg:.8f}\t{home.altitude_m:.6f}\t1"
    lines = ["QGC WPL 110", first]
    for number, item in enumerate(mission.items[1:] if has_home else mission.items, start=1):
        # The format has no word for "unset".
        params = "\t".join(f"{0.0 if math.isnan(p) else p:.8f}" for p in item.params)
        x, y = _coordinates(item)
        frame = _FILE_FRAME.get(item.frame, item.frame)
        lines.append(
            f"{number}\t0\t{frame}\t{int(item.command)}\t{params}\t{x:.8f}\t{y:.8f}\t{item.z:.6f}\t{item.autocontinue}"
        )
    return "\n".join(lines) + "\n"


def _coordinates(item: MissionItem) -> tuple[float, float]:
    if item.command in PLACE_COMMANDS:
        return item.x / 1e7, item.y / 1e7
    return float(item.x), float(item.y)


def _simple_item(number: int, item: MissionItem) -> dict[str, object]:
    values = [*item.params, *_coordinates(item), item.z]
    content: dict[str, object] = {
        "type": "SimpleItem",
        "autoContinue": bool(item.autocontinue),
        "command": int(item.command),
        "doJumpId": number,
        "frame": int(_FILE_FRAME.get(item.frame, item.frame)),
        "params": [None if math.isnan(v) else v for v in values],
    }
    if item.command in PLACE_COMMANDS:
        content |= {"Altitude": item.z, "AltitudeMode": _ABSOLUTE_ALTITUDE, "AMSLAltAboveTerrain": None}
    return content
