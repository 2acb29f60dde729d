"""A new plan for the rest of an inspection, from where the vehicle hovers now."""

from __future__ import annotations

import asyncio
import time
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

from gcs.core.errors import RefusedError
from gcs.core.progress import SilentProgress
from gcs.planning.flights.flight_scene import prepare_scene
from gcs.planning.planner import plan_rest
from gcs.services.image_account import scene_position
from gcs.services.plan_writing import write_certified
from gcs.storage.plan_files import read_plan, read_structure

if TYPE_CHECKING:
    from collections.abc import Collection

    from gcs.core.plan import Plan
    from gcs.core.progress import Progress
    from gcs.core.structure import Structure
    from gcs.mavlink.vehicle import Vehicle
    from gcs.planning.flights.flight_scene import Scene
    from gcs.services.plan_writing import WrittenPlan

FRESH_S = 2.0


async def plan_from_here(plan: Plan, directory: Path, vehicle: Vehicle, pictured: Collection[int]) -> Plan:
    """Plan from the vehicle's position through the viewpoints that have no picture yet, and home.

    Args:
        plan: what was being flown.
        directory: its folder, for the structure.
        vehicle: hovering.
        pictured: ids of the viewpoints that need no second visit.

    Raises:
        RefusedError: its position is not known, or it is where it must not be: it has to be flown clear by hand.
        InfeasibleError: there is no plan from there.
    """
    place = vehicle.telemetry.position
    if place is None or place.age_s(time.monotonic()) > FRESH_S:
        raise RefusedError("its position is not known, so nothing can be planned from it", field=vehicle.identity.name)
    start = scene_position(plan, place.value)
    rest = [v for v in plan.viewpoints if v.id not in pictured]
    if start is None or not rest:
        raise RefusedError("every viewpoint has its picture: return or land instead", field=vehicle.identity.name)
    return await asyncio.to_thread(_plan, str(directory), start, tuple(v.id for v in rest))


def write_plan_from_home(progress: Progress, directory: Path, viewpoints: Collection[int], out: Path) -> WrittenPlan:
    """Plan from home through some viewpoints of a plan, in their order, and write it: how it goes on another time.

    Args:
        progress: told of every stage; may cancel.
        directory: of the plan that was not flown to its end.
        viewpoints: ids of those that have no picture yet.
        out: folder to make.

    Raises:
        InputError: there is no plan.
        InfeasibleError: there is no plan for the rest.
        StorageError: the disk did not take it.
        OperationCancelled: the progress said so.
    """
    plan, structure, scene = _scene(str(directory))
    rest = [v for v in plan.viewpoints if v.id in viewpoints]
    made = plan_rest(plan.scenario, structure, scene, rest, plan.scenario.home_m, progress)
    return write_certified(made, structure, out, progress)


def _plan(directory: str, start_m: tuple[float, float, float], rest: tuple[int, ...]) -> Plan:
    plan, structure, scene = _scene(directory)
    remaining = [v for v in plan.viewpoints if v.id in rest]
    return plan_rest(plan.scenario, structure, scene, remaining, start_m, SilentProgress())


@lru_cache(maxsize=2)
def _scene(directory: str) -> tuple[Plan, Structure, Scene]:
    plan, structure = read_plan(Path(directory)), read_structure(Path(directory))
    return plan, structure, prepare_scene(plan.scenario, structure, SilentProgress())
