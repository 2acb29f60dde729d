"""Plans for several vehicles that share an inspection: written, and checked again from their files."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.errors import InputError
from gcs.core.progress import SilentProgress
from gcs.planning.certificates import Check
from gcs.planning.flights.separation import TOLERANCE_M, TimedCurve, least_separation
from gcs.services.plan_writing import account
from gcs.storage.fleet_files import FleetDocument, FleetVehicle, read_fleet, write_fleet
from gcs.storage.plan_files import part_directories, plan_hash, read_plan

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from gcs.core.plan import Plan
    from gcs.core.progress import Progress
    from gcs.core.scenario import Scenario
    from gcs.core.structure import Structure
    from gcs.planning.fleet import Fleet

SAME_M = 1e-3
SEPARATION_TOLERANCE_M = 2 * TOLERANCE_M


def write_fleet_plan(
    scenario: Scenario, fleet: Fleet, structure: Structure, out: Path, progress: Progress
) -> FleetDocument:
    """Write the plans of a fleet.

    Args:
        scenario: of the whole.
        fleet: as it was planned.
        structure: the placed structure.
        out: folder to make; one that holds earlier plans is replaced.
        progress: told of the stages `ways_home` and `write`; may cancel.

    Raises:
        InputError: `out` is not ours to replace.
        StorageError: the disk did not take it.
    """
    plans = [account(plan, structure, progress) for plan in fleet.plans]
    progress.report("write", 0.0)
    contents = {f"vehicle-{number}": plan.contents(structure) for number, plan in enumerate(plans, start=1)}
    vehicles = [
        FleetVehicle(
            directory=name,
            home_m=plan.scenario.home_m,
            viewpoints=[v.name for v in plan.viewpoints],
            start_s=start,
            end_s=start + plan.trajectory.duration_s,
            energy_wh=plan.certificates.energy_wh,
            plan_hash=hashlib.sha256(files["plan.json"]).hexdigest(),
        )
        for (name, files), plan, start in zip(contents.items(), fleet.plans, fleet.starts_s, strict=True)
    ]
    a, b = fleet.separation.pair
    document = FleetDocument(
        name=scenario.name,
        vehicles=vehicles,
        viewpoints=sum(len(plan.viewpoints) for plan in fleet.plans),
        duration_s=fleet.end_s,
        duration_lower_bound_s=fleet.lower_bound_s,
        length_m=sum(plan.certificates.length_m for plan in fleet.plans),
        energy_wh=sum(plan.certificates.energy_wh for plan in fleet.plans),
        coverage=None if fleet.coverage is None else fleet.coverage.share_seen,
        coverable=None if fleet.coverage is None else fleet.coverage.share_coverable,
        separation_m=scenario.safety.separation_m,
        apart_m=scenario.safety.apart_m,
        min_separation_m=fleet.separation.distance_m,
        nearest_at_s=fleet.separation.time_s,
        nearest=(a + 1, b + 1),
    )
    write_fleet(document, contents, out)
    progress.report("write", 1.0)
    return document


def verify_fleet(directory: Path, verify: Callable[[Path], list[Check]]) -> list[Check]:
    """Check the plans of a fleet, and that the vehicles stay apart.

    Args:
        directory: as `gcs plan` wrote it.
        verify: checks a written plan.
    """
    try:
        document = read_fleet(directory)
        folders = part_directories(directory)
        plans = [read_plan(folder) for folder in folders]
    except InputError as error:
        return [Check(error.field or "files", False, 0.0, 1.0, error.message)]
    if [folder.name for folder in folders] != [vehicle.directory for vehicle in document.vehicles]:
        return [Check("fleet.json", False, 0.0, 1.0, "the vehicles' folders are not those that it names")]
    checks = [_separation(document, plans), _as_told(document, plans, folders)]
    for folder in folders:
        checks.extend(replace(check, name=f"{folder.name}: {check.name}") for check in verify(folder))
    return checks


def _separation(document: FleetDocument, plans: list[Plan]) -> Check:
    curves = [
        TimedCurve(plan.trajectory, vehicle.start_s) for plan, vehicle in zip(plans, document.vehicles, strict=True)
    ]
    found = least_separation(curves, SilentProgress())
    asked = max(plan.scenario.safety.apart_m for plan in plans)
    told = document.min_separation_m
    ok = found.distance_m >= asked - 1e-9 and abs(found.distance_m - told) <= SEPARATION_TOLERANCE_M
    a, b = found.pair
    message = (
        f"vehicles {a + 1} and {b + 1} come as near as {found.distance_m:.3f} m at t = {found.time_s:.1f} s, "
        f"reported {told:.3f} m, asked {asked:.2f} m"
    )
    return Check("min_separation_m", ok, found.distance_m, asked, message)


def _as_told(document: FleetDocument, plans: list[Plan], folders: list[Path]) -> Check:
    """`fleet.json` says what the plans say."""
    off = [
        folder.name
        for vehicle, plan, folder in zip(document.vehicles, plans, folders, strict=True)
        if vehicle.plan_hash != plan_hash(folder)
        or vehicle.viewpoints != [v.name for v in plan.viewpoints]
        or float(np.abs(np.subtract(vehicle.home_m, plan.scenario.home_m)).max()) > SAME_M
        or abs(vehicle.end_s - vehicle.start_s - plan.trajectory.duration_s) > SAME_M
        or vehicle.energy_wh != plan.certificates.energy_wh
    ]
    whole = (
        abs(document.duration_s - max(vehicle.end_s for vehicle in document.vehicles)) <= SAME_M
        and document.duration_lower_bound_s <= document.duration_s
        and document.viewpoints == sum(len(plan.viewpoints) for plan in plans)
    )
    ok = whole and not off
    message = f"is not what the plans say: {', '.join(off) or 'sums'}" if not ok else "says what the plans say"
    return Check("fleet.json", ok, float(ok), 1.0, message)
