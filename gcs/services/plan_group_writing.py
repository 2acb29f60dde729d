"""Several plans of one inspection put into a folder: those of a fleet, or of sorties from several bases."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from gcs.planning.fleet import Fleet
from gcs.services.plan_writing import account
from gcs.storage.plan_group_files import FleetDocument, SortiesDocument, write_group

if TYPE_CHECKING:
    from pathlib import Path

    from gcs.core.progress import Progress
    from gcs.core.scenario import Scenario
    from gcs.core.structure import Structure
    from gcs.planning.flights.plan_group import PlanGroup, SortieSeries
    from gcs.services.plan_writing import AccountedPlan


@dataclass(frozen=True)
class WrittenGroup:
    """Plans whose folder is in place.

    Attributes:
        document: how they are flown together.
        notes: what was ignored or left out of the mesh files, and what each vehicle's return needs.
    """

    document: FleetDocument | SortiesDocument
    notes: tuple[str, ...]


def write_plan_group(
    scenario: Scenario, group: Fleet | SortieSeries, structure: Structure, out: Path, progress: Progress
) -> WrittenGroup:
    """Write the plans of a fleet, or of sorties from several bases.

    Args:
        scenario: of the whole.
        group: as it was planned.
        structure: the placed structure.
        out: folder to make; one that holds earlier plans is replaced.
        progress: told of the stages `ways_home` and `write`; may cancel.

    Raises:
        InputError: `out` is not ours to replace.
        StorageError: the disk did not take it.
    """
    plans = [account(plan, structure, progress) for plan in group.plans]
    progress.report("write", 0.0)
    kind = FleetDocument.KIND if isinstance(group, Fleet) else SortiesDocument.KIND
    contents = {f"{kind}-{number}": plan.contents(structure) for number, plan in enumerate(plans, start=1)}
    flights = [
        _flight(name, plan, start, files["plan.json"])
        for (name, files), plan, start in zip(contents.items(), plans, group.starts_s, strict=True)
    ]
    document = _fleet(scenario, group, flights) if isinstance(group, Fleet) else _sorties(scenario, group, flights)
    write_group(document, contents, out)
    progress.report("write", 1.0)
    ways = (f"{plan.plan.scenario.name}: {plan.own_ways_note}" for plan in plans)
    return WrittenGroup(document, (*structure.notes, *ways))


def _flight(directory: str, accounted: AccountedPlan, start_s: float, plan_json: bytes) -> dict[str, Any]:
    plan = accounted.plan
    return {
        "directory": directory,
        "home_m": plan.scenario.home_m,
        "viewpoints": [v.name for v in plan.viewpoints],
        "start_s": start_s,
        "end_s": start_s + plan.trajectory.duration_s,
        "energy_wh": plan.certificates.energy_wh,
        "plan_hash": hashlib.sha256(plan_json).hexdigest(),
    }


def _together(scenario: Scenario, group: PlanGroup) -> dict[str, Any]:
    return {
        "name": scenario.name,
        "viewpoints": sum(len(plan.viewpoints) for plan in group.plans),
        "duration_s": group.end_s,
        "length_m": sum(plan.certificates.length_m for plan in group.plans),
        "energy_wh": sum(plan.certificates.energy_wh for plan in group.plans),
        "coverage": None if group.coverage is None else group.coverage.share_seen,
        "coverable": None if group.coverage is None else group.coverage.share_coverable,
    }


def _fleet(scenario: Scenario, fleet: Fleet, flights: list[dict[str, Any]]) -> FleetDocument:
    a, b = fleet.separation.pair
    return FleetDocument.model_validate(
        {
            **_together(scenario, fleet),
            "vehicles": flights,
            "duration_lower_bound_s": fleet.lower_bound_s,
            "separation_m": scenario.safety.separation_m,
            "apart_m": scenario.safety.apart_m,
            "min_separation_m": fleet.separation.distance_m,
            "nearest_at_s": fleet.separation.time_s,
            "nearest": (a + 1, b + 1),
        }
    )


def _sorties(scenario: Scenario, series: SortieSeries, flights: list[dict[str, Any]]) -> SortiesDocument:
    return SortiesDocument.model_validate(
        {
            **_together(scenario, series),
            "sorties": [{**flight, "rally": rally} for flight, rally in zip(flights, series.rally, strict=True)],
            "tour_cost": series.tour_cost,
            "tour_lower_bound": series.tour_lower_bound,
            "tour_metric": scenario.planner.metric,
        }
    )
