"""A certified plan put into its folder, with all that is written beside it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from gcs.planning.flights.own_ways import describe_own_ways, find_own_ways
from gcs.planning.scene.point_distance import SceneDistance
from gcs.services.mission_files import mission_files
from gcs.services.mission_fitting import predict_usual_flights
from gcs.services.report_page import report_page
from gcs.services.tracking_forecast import forecast_tracking
from gcs.storage.plan_files import plan_contents, plan_report, write_plan

if TYPE_CHECKING:
    from pathlib import Path

    from gcs.core.plan import Plan
    from gcs.core.progress import Progress
    from gcs.core.structure import Structure


@dataclass(frozen=True)
class WrittenPlan:
    """A plan whose folder is in place.

    Attributes:
        plan: as it was certified.
        plan_hash: SHA-256 of plan.json.
        report: content of report.json.
        notes: what was ignored or left out of the mesh files, and what the vehicle's return needs.
    """

    plan: Plan
    plan_hash: str
    report: dict[str, Any]
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class AccountedPlan:
    """A plan with what is written beside `plan.json` and what follows from it."""

    plan: Plan
    report: dict[str, Any]
    extra_files: dict[str, bytes]

    def contents(self, structure: Structure) -> dict[str, bytes]:
        """All files, name -> content."""
        return plan_contents(self.plan, structure, report=self.report, extra_files=self.extra_files)

    @property
    def own_ways_note(self) -> str:
        """What the vehicle can do by itself, in a line."""
        ways = self.plan.own_ways
        return "" if ways is None else describe_own_ways(ways, self.plan.trajectory.duration_s)


def account(plan: Plan, structure: Structure, progress: Progress) -> AccountedPlan:
    """Find out what the vehicle can do by itself on a plan, and make its missions and reports."""
    scene = SceneDistance(structure, plan.scenario.ground_m)
    ways = find_own_ways(plan, scene, progress)
    plan = replace(plan, own_ways=ways)
    missions = mission_files(plan)
    report = plan_report(plan, mission_items=missions.items)
    report["predictions"] = [prediction.as_json() for prediction in predict_usual_flights(plan, scene)]
    tracking = None if plan.sorties else forecast_tracking(plan)
    report["tracking"] = None if tracking is None else tracking.as_json()
    page = report_page(plan, structure, report, tracking)
    return AccountedPlan(plan, report, {**missions.files, "report.html": page.encode()})


def write_certified(plan: Plan, structure: Structure, out: Path, progress: Progress) -> WrittenPlan:
    """Write a plan, and its sorties as complete plans in folders of their own.

    Args:
        plan: as the planner made it.
        structure: the placed structure.
        out: folder to make; one that holds an earlier plan is replaced.
        progress: told of the stages `ways_home` and `write`; may cancel.

    Raises:
        InputError: `out` is not ours to replace.
        StorageError: the disk did not take it; nothing half-written stays.
        OperationCancelled: the progress said so.
    """
    whole = account(plan, structure, progress)
    parts = [account(part, structure, progress) for part in plan.parts]
    progress.report("write", 0.0)
    plan_hash = write_plan(
        whole.plan,
        structure,
        out,
        report=whole.report,
        extra_files=whole.extra_files,
        parts={f"sortie-{number}": part.contents(structure) for number, part in enumerate(parts, start=1)},
    )
    progress.report("write", 1.0)
    ways = [f"{part.plan.scenario.name}: {part.own_ways_note}" for part in parts] or [whole.own_ways_note]
    return WrittenPlan(whole.plan, plan_hash, whole.report, (*structure.notes, *ways))
