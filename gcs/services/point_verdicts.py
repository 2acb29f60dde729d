"""Points of one's own: which of them a written plan sees as its surface task asks, and why not the others."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.errors import InputError
from gcs.core.progress import SilentProgress
from gcs.core.surface_coverage import Verdict
from gcs.planning.scene.fence import fence_volume
from gcs.planning.scene.point_distance import SceneDistance
from gcs.planning.views.coverage import judge_targets
from gcs.planning.views.viewpoints_spots import SPOT_LIFT_M
from gcs.storage.plan_files import read_plan, read_structure
from gcs.storage.point_table import read_point_table

if TYPE_CHECKING:
    from pathlib import Path

SEED = 20_011


@dataclass(frozen=True)
class PointVerdict:
    """A point's name, or the number of its line, and what becomes of it."""

    name: str
    verdict: Verdict


def judge_points(directory: Path, points: Path) -> list[PointVerdict]:
    """Judge the points of a table.

    Args:
        directory: of a written plan with a surface task.
        points: CSV with the columns `x_m,y_m,z_m,normal_x,normal_y,normal_z` in the scene frame, outward normals, and
            `name` if there are names.

    Raises:
        InputError: there is no such plan or table, or a line of it is no point with a normal.
    """
    plan, structure = read_plan(directory), read_structure(directory)
    scenario = plan.scenario
    if scenario.inspection is None or scenario.inspection.surface is None:
        raise InputError("the plan asks for no surface: there is nothing to hold points against", field="--points")
    names, places, normals = read_point_table(points)
    verdicts = judge_targets(
        scenario,
        structure,
        plan.viewpoints,
        places,
        normals,
        fence_volume(scenario.fence, scenario.vehicle, scenario.safety),
        SceneDistance(structure, scenario.ground_m),
        SilentProgress(),
        rng=np.random.default_rng(SEED),
        lift_m=SPOT_LIFT_M,
    )
    return [PointVerdict(name, Verdict(v)) for name, v in zip(names, verdicts.tolist(), strict=True)]
