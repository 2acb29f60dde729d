"""`gcs verify`: a written plan checked again from its files alone, without the planner's intermediate results."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np

from gcs.core.errors import GcsError, InputError
from gcs.planning.certificates import Check, recheck
from gcs.planning.dynamics.energy import energy_wh, usable_wh
from gcs.planning.face_certificate import recheck_faces
from gcs.planning.flights.own_ways import find_own_ways
from gcs.planning.scene.point_distance import SceneDistance
from gcs.planning.scene.visibility import SightLines
from gcs.planning.views.camera_footprint import faces_camera, in_image
from gcs.planning.views.viewpoints import points_to_inspect
from gcs.services.coverage_verification import check_gimbal, recheck_coverage
from gcs.services.mission_files import mission_files
from gcs.services.mission_fitting import predict_usual_flights
from gcs.services.plan_group_verification import verify_group
from gcs.services.sortie_verification import verify_sorties
from gcs.services.tracking_forecast import forecast_tracking
from gcs.storage.plan_document import face_entry
from gcs.storage.plan_files import own_ways_report, plan_tables, read_plan, read_report, read_structure, sorties_report
from gcs.storage.plan_group_files import has_group

if TYPE_CHECKING:
    from pathlib import Path

    from gcs.core.plan import Plan
    from gcs.core.structure import Structure
    from gcs.planning.flights.ways_home import Intervals

POINT_INCIDENCE_RAD = math.radians(60.0)
GSD_SLACK = 1.001
LIFT_M = 0.02
"""Sight of a named point is tested to just above the surface it is on."""

ENERGY_TOLERANCE = 0.01
PREDICTION_TOLERANCE = 0.02
"""Of predicted times, deviations and clearances, relative above 1."""

TRACKING_TOLERANCE = 1e-3
"""Of predicted tracking errors, m or rad."""

OWN_WAYS_TOLERANCE = 1e-3
"""Of the times, heights and counts of what the vehicle can do by itself."""


def verify_plan(directory: Path) -> list[Check]:
    """Check a written plan again, or a group of plans.

    Returns:
        The checks; a file that cannot be read is one that does not hold, and the only one.

    Raises:
        InputError: there is no plan.
    """
    if has_group(directory):
        return verify_group(directory, verify_plan)
    if not (directory / "plan.json").is_file():
        read_plan(directory)
    try:
        plan, structure = read_plan(directory), read_structure(directory)
        report = read_report(directory)
    except InputError as error:
        return [Check(error.field or "files", False, 0.0, 1.0, error.message)]
    distance = SceneDistance(structure, plan.scenario.ground_m)
    return [
        *_files(plan, report, directory),
        *recheck(plan, distance),
        _energy(plan),
        *verify_sorties(plan, directory, verify_plan),
        *_own_ways(plan, distance),
        *_predictions(plan, report, distance),
        *_tracking(plan, report),
        *_named_points(plan, structure),
        *recheck_faces(plan, SightLines(structure), distance),
        check_gimbal(plan),
        *recheck_coverage(plan, structure, distance),
    ]


def _files(plan: Plan, report: dict[str, Any], directory: Path) -> list[Check]:
    """The tables, the missions and the report must say what `plan.json` says."""
    try:
        missions = mission_files(plan)
    except GcsError as error:
        return [Check("mission", False, 0.0, 1.0, f"cannot be made of plan.json: {error}")]
    checks = []
    for name, content in {**plan_tables(plan), **missions.files}.items():
        path = directory / name
        same = path.is_file() and path.read_bytes() == content
        message = "says what plan.json says" if same else "is not that of plan.json"
        checks.append(Check(name, same, float(same), 1.0, message))
    faces = [face_entry(face).model_dump() for face in plan.faces]
    told = {
        **asdict(plan.certificates),
        "mission_items": missions.items,
        "faces": faces,
        "own_ways": own_ways_report(plan),
        "sorties": sorties_report(plan),
    }
    other = sorted(key for key, value in told.items() if report.get(key) != value)
    message = f"differs from plan.json in {', '.join(other)}" if other else "says what plan.json says"
    return [*checks, Check("report.json", not other, float(not other), 1.0, message)]


def _named_points(plan: Plan, structure: Structure) -> list[Check]:
    """Every named point is in the picture of a viewpoint of its name, from its side, with clear sight."""
    scenario = plan.scenario
    points = points_to_inspect(scenario, structure)
    sight = SightLines(structure)
    checks = []
    for point in points:
        place, normal = np.array([point.position_m]), np.array([point.normal])
        reach = math.inf if point.gsd_mm is None else scenario.camera.distance_for_gsd(point.gsd_mm / 1000)
        seen = any(
            in_image(scenario.camera, v.position_m, v.direction, v.up, place, reach * GSD_SLACK)[0]
            and faces_camera(v.position_m, place, normal, POINT_INCIDENCE_RAD)[0]
            and sight.clear(v.position_m, place + LIFT_M * normal)[0]
            for v in plan.viewpoints
            if v.name == point.name
        )
        checks.append(Check(point.name, seen, float(seen), 1.0, "is seen from its side" if seen else "is not seen"))
    return checks


def _energy(plan: Plan) -> Check:
    flights = [(s.start_s, s.end_s) for s in plan.sorties] or [(0.0, plan.trajectory.duration_s)]
    needed = sum(energy_wh(plan.trajectory, plan.scenario.vehicle, start, end) for start, end in flights)
    told = plan.certificates.energy_wh
    battery = None if plan.sorties else plan.scenario.vehicle.battery
    usable = math.inf if battery is None else usable_wh(battery)
    ok = abs(needed - told) <= ENERGY_TOLERANCE * max(told, 1.0) and needed <= usable
    more = "" if battery is None else f", usable {usable:.1f} Wh"
    return Check("energy_wh", ok, needed, told, f"energy: {needed:.1f} Wh, reported {told:.1f} Wh{more}")


def _own_ways(plan: Plan, distance: SceneDistance) -> list[Check]:
    """What the vehicle can do by itself is what the plan says it can."""
    if plan.own_ways is None:
        return []
    found = find_own_ways(plan, distance)
    told, name = plan.own_ways, "own_ways"
    if found.action is not told.action:
        why = f"{told.action.value} is said to be safe from everywhere, {found.action.value} is"
        return [Check(name, False, 0.0, 1.0, why)]
    apart = max(
        _apart(found.return_blocked_s, told.return_blocked_s),
        _apart(found.landing_blocked_s, told.landing_blocked_s),
        _apart(found.hold_blocked_s, told.hold_blocked_s),
        _apart(found.rally_blocked_s or (), told.rally_blocked_s or ()),
        abs((found.rally_altitude_m or 0.0) - (told.rally_altitude_m or 0.0)),
        abs((found.return_altitude_m or 0.0) - (told.return_altitude_m or 0.0)),
        abs(found.retrace_accuracy_m - told.retrace_accuracy_m),
        float(abs(found.retrace_points - told.retrace_points)),
    )
    ok = apart <= OWN_WAYS_TOLERANCE
    message = f"{found.action.value} is safe from everywhere; difference from what the plan says {apart:.3g}"
    return [Check(name, ok, apart, OWN_WAYS_TOLERANCE, message)]


def _predictions(plan: Plan, report: dict[str, Any], distance: SceneDistance) -> list[Check]:
    """What the autopilots are predicted to make of the mission is what the report says; older reports say nothing."""
    told = report.get("predictions")
    if not told:
        return []
    found = [prediction.as_json() for prediction in predict_usual_flights(plan, distance)]
    if [p["autopilot"] for p in found] != [p.get("autopilot") for p in told]:
        return [Check("predictions", False, 0.0, 1.0, "the predicted flights are not those of the plan's missions")]
    try:
        apart = max(
            abs(float(f[way][figure]) - float(t[way][figure])) / max(abs(float(f[way][figure])), 1.0)
            for f, t in zip(found, told, strict=True)
            for way in ("mission", "offboard")
            for figure in ("time_s", "mean_deviation_m", "max_deviation_m", "min_clearance_m")
        )
        same = all(f["choice"] == t["choice"] for f, t in zip(found, told, strict=True))
    except (KeyError, TypeError, ValueError) as error:
        return [Check("predictions", False, 0.0, 1.0, f"the report's predictions are not whole: {error!r}")]
    message = f"predicted anew, they differ by {apart:.3g} at most, {'the same' if same else 'another'} way is chosen"
    return [Check("predictions", same and apart <= PREDICTION_TOLERANCE, apart, PREDICTION_TOLERANCE, message)]


def _tracking(plan: Plan, report: dict[str, Any]) -> list[Check]:
    """How closely the plan can be flown is what the report says; older reports say nothing."""
    told = report.get("tracking")
    if not told:
        return []
    found = forecast_tracking(plan).as_json()
    try:
        apart = max(abs(float(told[key]) - float(found[key])) for key in ("deviation_m", "mean_deviation_m", "yaw_rad"))
    except (KeyError, TypeError, ValueError) as error:
        return [Check("tracking", False, 0.0, 1.0, f"the report's tracking is not whole: {error!r}")]
    message = f"at most {found['deviation_m']:.2f} m beside the curve; the report is {apart:.2g} off"
    return [Check("tracking", apart <= TRACKING_TOLERANCE, apart, TRACKING_TOLERANCE, message)]


def _apart(found_s: Intervals, told_s: Intervals) -> float:
    """Largest difference of the ends of intervals (s); infinite when there are not as many."""
    if len(found_s) != len(told_s):
        return math.inf
    return max((abs(a - b) for f, t in zip(found_s, told_s, strict=True) for a, b in zip(f, t, strict=True)), default=0)
