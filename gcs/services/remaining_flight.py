"""Which flight comes next: a sortie of a plan, or the rest of one that was cut short, from home on a fresh battery."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from gcs.core.errors import GcsError, InputError
from gcs.core.progress import SilentProgress
from gcs.services.resumed_plan import write_plan_from_home
from gcs.storage.plan_files import part_directories, read_plan
from gcs.storage.plan_group_files import SortiesDocument, has_group, read_group
from gcs.storage.records import ImageState

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from gcs.core.plan import Plan
    from gcs.services.plan_service import PlanService
    from gcs.storage.database import Database

SAME_PLACE_M = 0.05
SAME_DIRECTION = 0.9999
"""Cosine between view directions that are the same."""


class NextFlight(NamedTuple):
    """What is flown next.

    Attributes:
        directory: the plan's folder.
        said: one line for the operator; empty when the plan is flown as it is.
    """

    directory: Path
    said: str


def next_flight(
    out: Path, sortie: int | None, rest: bool, database: Database, plans: PlanService, scratch: Path
) -> NextFlight:
    """Choose what is flown of a plan.

    Args:
        out: the plan's folder.
        sortie: its number from 1; None for the first one with a viewpoint that has no picture yet.
        rest: leave out the viewpoints that have their picture from earlier flights.
        database: of the station, for flights and pictures.
        plans: of the station.
        scratch: an empty folder, for the plan of a rest.

    Raises:
        InputError: there is no plan, no such sortie, or nothing is left to picture.
        InfeasibleError: there is no plan for the rest.
    """
    group = read_group(out) if has_group(out) else None
    if group is not None and not isinstance(group, SortiesDocument):
        raise InputError("these are the plans of several vehicles: give one of them, such as vehicle-1", field=str(out))
    folders = part_directories(out) if out.is_dir() else []
    if sortie is not None and not 1 <= sortie <= len(folders):
        has = f"this plan has {len(folders)} sorties" if folders else "this plan is one flight"
        raise InputError(f"there is no sortie {sortie}: {has}", field="--sortie")
    chosen, said = out, ""
    if folders:
        number = sortie or _first_unfinished(folders, database, plans)
        chosen, said = folders[number - 1], f"sortie {number} of {len(folders)}"
        if group is not None:
            said += f", {group.sorties[number - 1].where}"
    if not rest:
        return NextFlight(chosen, said)
    plan = read_plan(chosen)
    pictured = pictured_before(plan, database, plans)
    left = [v for v in plan.viewpoints if v.id not in pictured]
    if not left:
        raise InputError("every viewpoint has its picture: nothing is left to fly", field="--rest")
    if len(left) == len(plan.viewpoints):
        return NextFlight(chosen, said)
    target = scratch / "rest"
    write_plan_from_home(SilentProgress(), chosen, [v.id for v in left], target)
    rest_of = f"{said}: " if said else ""
    return NextFlight(target, f"{rest_of}the {len(left)} viewpoints from {left[0].name} on that have no picture yet")


def _first_unfinished(folders: list[Path], database: Database, plans: PlanService) -> int:
    """Number of the first sortie that has viewpoints without a picture."""
    for number, folder in enumerate(folders, start=1):
        plan = read_plan(folder)
        if len(pictured_before(plan, database, plans)) < len(plan.viewpoints):
            return number
    raise InputError(
        "all sorties of this plan are flown and have their pictures: name one with --sortie to fly it again",
        field="--sortie",
    )


def pictured_before(plan: Plan, database: Database, plans: PlanService) -> frozenset[int]:
    """Ids of the viewpoints that have a stored picture from an earlier flight of this plan, or of its rest."""
    mine = _asked(plan.scenario.model_dump(mode="json", exclude_none=True))
    found: set[int] = set()
    for overview in database.flights.summaries():
        flight = overview.flight
        if _asked(database.plans.get(flight.plan_id).scenario) != mine:
            continue
        try:
            flown = {v.id: v for v in plans.read(flight.plan_id).viewpoints}
        except GcsError:
            continue  # its files are gone or damaged: what it pictured is not known
        for image in database.images.of_flight(flight.id):
            view = None if image.viewpoint_id is None else flown.get(image.viewpoint_id)
            if image.state is ImageState.STORED and view is not None:
                found |= {
                    v.id
                    for v in plan.viewpoints
                    if np.linalg.norm(v.position_m - view.position_m) < SAME_PLACE_M
                    and float(v.direction @ view.direction) > SAME_DIRECTION
                }
    return frozenset(found)


def _asked(scenario: Mapping[str, object]) -> dict[str, object]:
    """What is to be pictured, without the error budget: a flight that went on from a hover has a smaller one."""
    return {key: value for key, value in scenario.items() if key != "safety"}
