"""`gcs verify`: a written plan checked again from its files alone, without the planner's intermediate results."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np

from gcs.core.errors import GcsError, InputError
from gcs.core.progress import SilentProgress
from gcs.planning.camera_footprint import faces_camera, in_image
from gcs.planning.certificates import Check, recheck
from gcs.planning.coverage import certify_coverage
from gcs.planning.energy import energy_wh
from gcs.planning.face_certificate import recheck_faces
from gcs.planning.fence import fence_volume
from gcs.planning.point_distance import SceneDistance
from gcs.planning.viewpoints import points_to_inspect
from gcs.planning.visibility import SightLines
from gcs.services.mission_files import mission_files
from gcs.storage.plan_document import face_entry
from gcs.storage.plan_files import plan_tables, read_plan, read_report, read_structure

if TYPE_CHECKING:
    from pathlib import Path

    from gcs.core.plan import Plan
    from gcs.core.structure import Structure

OTHER_SEED = 20_011
"""The surface is sampled anew: with another seed than any planner option has."""

COVERAGE_TOLERANCE = 0.01
POINT_INCIDENCE_RAD = math.radians(60.0)
GSD_SLACK = 1.001
LIFT_M = 0.02
"""Sight of a named point is tested to just above the surface it is on."""

ENERGY_TOLERANCE = 0.01


def verify_plan(directory: Path) -> list[Check]:
    """Check a written plan again.

    Returns:
        The checks; a file that cannot be read is one that does not hold, and the only one.

    Raises:
        InputError: there is no plan.
    """
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
        *_named_points(plan, structure),
        *recheck_faces(plan, SightLines(structure), distance),
        *_coverage(plan, structure, distance),
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
    told = {**asdict(plan.certificates), "mission_items": missions.items, "faces": faces}
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
    needed = energy_wh(plan.trajectory, plan.scenario.vehicle.mass_kg)
    told = plan.certificates.energy_wh
    battery = plan.scenario.vehicle.battery
    usable = math.inf if battery is None else battery.capacity_wh * (1 - battery.reserve)
    ok = abs(needed - told) <= ENERGY_TOLERANCE * max(told, 1.0) and needed <= usable
    more = "" if battery is None else f", usable {usable:.1f} Wh"
    return Check("energy_wh", ok, needed, told, f"energy: {needed:.1f} Wh, reported {told:.1f} Wh{more}")


def _coverage(plan: Plan, structure: Structure, distance: SceneDistance) -> list[Check]:
    told = plan.certificates.coverage
    if told is None:
        return []
    scenario = plan.scenario
    fence = fence_volume(scenario.fence, scenario.vehicle, scenario.safety)
    found = certify_coverage(scenario, structure, plan.viewpoints, fence, distance, SilentProgress(), seed=OTHER_SEED)
    share = 0.0 if found is None else found.share_seen
    ok = share >= told - COVERAGE_TOLERANCE
    return [Check("coverage", ok, share, told, f"coverage: {share:.2%} of what is coverable, reported {told:.2%}")]
