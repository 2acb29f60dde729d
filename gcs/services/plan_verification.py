"""`gcs verify`: a written plan checked again from its files alone, without the planner's intermediate results."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gcs.core.progress import SilentProgress
from gcs.planning.certificates import Check, recheck
from gcs.planning.coverage import verify_coverage
from gcs.planning.energy import energy_wh, require_battery
from gcs.planning.point_distance import SceneDistance
from gcs.storage.plan_files import read_plan, read_structure

if TYPE_CHECKING:
    from pathlib import Path

    from gcs.core.plan import Plan
    from gcs.core.structure import Structure

OTHER_SEED = 20_011
"""The surface is sampled anew: with another seed than any planner option has."""

COVERAGE_TOLERANCE = 0.01
ENERGY_TOLERANCE = 0.01


def verify_plan(directory: Path) -> list[Check]:
    """Check a written plan again.

    Raises:
        InputError: there is no plan, or its files are damaged.
    """
    plan, structure = read_plan(directory), read_structure(directory)
    distance = SceneDistance(structure, plan.scenario.ground_m)
    return [*recheck(plan, distance), _energy(plan), *_coverage(plan, structure, distance)]


def _energy(plan: Plan) -> Check:
    needed = energy_wh(plan.trajectory, plan.scenario.vehicle.mass_kg)
    told = plan.certificates.energy_wh
    require_battery(needed, plan.scenario.vehicle.battery)
    ok = abs(needed - told) <= ENERGY_TOLERANCE * max(told, 1.0)
    return Check("energy_wh", ok, needed, told, f"energy: {needed:.1f} Wh, reported {told:.1f} Wh")


def _coverage(plan: Plan, structure: Structure, distance: SceneDistance) -> list[Check]:
    told = plan.certificates.coverage
    if told is None:
        return []
    seen = verify_coverage(plan.scenario, structure, plan.viewpoints, distance, OTHER_SEED, SilentProgress())
    share = seen.share_seen
    ok = share >= told - COVERAGE_TOLERANCE
    return [Check("coverage", ok, share, told, f"coverage: {share:.2%} of what is coverable, reported {told:.2%}")]
