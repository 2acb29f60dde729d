"""Several plans of one inspection checked again from their files, each by itself and all together."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.errors import InputError
from gcs.core.progress import SilentProgress
from gcs.planning.certificates import Check
from gcs.planning.flights.separation import TOLERANCE_M, TimedCurve, least_separation
from gcs.planning.flights.sorties import BATTERY_SWAP_S
from gcs.storage.plan_files import part_directories, plan_hash, read_plan
from gcs.storage.plan_group_files import FleetDocument, read_group

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from gcs.core.plan import Plan
    from gcs.storage.plan_group_files import GroupFlight, SortiesDocument

SAME_M = 1e-3
SAME_S = 1e-3
SEPARATION_TOLERANCE_M = 2 * TOLERANCE_M


def verify_group(directory: Path, verify: Callable[[Path], list[Check]]) -> list[Check]:
    """Check the plans of a fleet, and that the vehicles stay apart; or of sorties, and that they follow each other.

    Args:
        directory: as `gcs plan` wrote it.
        verify: checks a written plan.
    """
    try:
        document = read_group(directory)
        folders = part_directories(directory)
        plans = [read_plan(folder) for folder in folders]
    except InputError as error:
        return [Check(error.field or "files", False, 0.0, 1.0, error.message)]
    if [folder.name for folder in folders] != [flight.directory for flight in document.flights]:
        return [Check(document.FILE, False, 0.0, 1.0, "the flights' folders are not those that it names")]
    own = _separation(document, plans) if isinstance(document, FleetDocument) else _series(document, plans)
    checks = [own, _as_told(document, plans, folders)]
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


def _series(document: SortiesDocument, plans: list[Plan]) -> Check:
    """Each sortie has time for a fresh battery before it, and those from rally points start there."""
    sorties = document.sorties
    pauses = [after.start_s - before.end_s for before, after in itertools.pairwise(sorties)]
    pause = min(pauses, default=math.inf)
    ids = [v.id for plan in plans for v in plan.viewpoints]
    homes = {plan.scenario.home_m for plan, sortie in zip(plans, sorties, strict=True) if sortie.rally is None}
    astray = [
        sortie.directory
        for plan, sortie in zip(plans, sorties, strict=True)
        if sortie.rally is not None
        and (sortie.rally > len(rally := plan.scenario.rally_m) or not _same(rally[sortie.rally - 1], sortie.home_m))
    ]
    ok = pause >= BATTERY_SWAP_S - SAME_S and ids == list(range(len(ids))) and len(homes) <= 1 and not astray
    where = f", not from where it says: {', '.join(astray)}" if astray else ""
    return Check("sorties", ok, pause, BATTERY_SWAP_S, f"{len(sorties)} sorties, {pause:.1f} s between them{where}")


def _as_told(document: FleetDocument | SortiesDocument, plans: list[Plan], folders: list[Path]) -> Check:
    """The group's file says what the plans say."""
    flights = list(zip(document.flights, plans, folders, strict=True))
    off = [folder.name for flight, plan, folder in flights if not _flight_as_told(flight, plan, folder)]
    whole = (
        abs(document.duration_s - max(flight.end_s for flight in document.flights)) <= SAME_S
        and document.viewpoints == sum(len(plan.viewpoints) for plan in plans)
        and math.isclose(document.energy_wh, sum(plan.certificates.energy_wh for plan in plans))
        and math.isclose(document.length_m, sum(plan.certificates.length_m for plan in plans))
        and _least_not_above(document, plans)
    )
    ok = whole and not off
    message = f"is not what the plans say: {', '.join(off) or 'sums'}" if not ok else "says what the plans say"
    return Check(document.FILE, ok, float(ok), 1.0, message)


def _flight_as_told(flight: GroupFlight, plan: Plan, folder: Path) -> bool:
    return (
        flight.plan_hash == plan_hash(folder)
        and flight.viewpoints == [v.name for v in plan.viewpoints]
        and _same(flight.home_m, plan.scenario.home_m)
        and abs(flight.end_s - flight.start_s - plan.trajectory.duration_s) <= SAME_S
        and flight.energy_wh == plan.certificates.energy_wh
    )


def _least_not_above(document: FleetDocument | SortiesDocument, plans: list[Plan]) -> bool:
    """The lower bound is one, of a cost that is that of the plans."""
    if isinstance(document, FleetDocument):
        return document.duration_lower_bound_s <= document.duration_s
    cost = sum(plan.certificates.tour_cost for plan in plans)
    return document.tour_lower_bound <= document.tour_cost * (1 + 1e-9) and math.isclose(document.tour_cost, cost)


def _same(one_m: tuple[float, float, float], other_m: tuple[float, float, float]) -> bool:
    return float(np.abs(np.subtract(one_m, other_m)).max()) <= SAME_M
