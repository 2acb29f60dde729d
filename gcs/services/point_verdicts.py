"""Points of one's own: which of them a written plan sees as its surface task asks, and why not the others."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.errors import InputError
from gcs.core.progress import SilentProgress
from gcs.core.surface_coverage import Verdict
from gcs.planning.scene.fence import fence_volume
from gcs.planning.scene.point_distance import SceneDistance
from gcs.planning.views.coverage import judge_targets
from gcs.storage.plan_files import read_plan, read_structure

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

COLUMNS = ("x_m", "y_m", "z_m", "normal_x", "normal_y", "normal_z")
LIFT_M = 0.01
"""Points are looked at this far above their surface: they may lie that deep in it."""

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
    names, places, normals = _read(points)
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
        lift_m=LIFT_M,
    )
    return [PointVerdict(name, Verdict(v)) for name, v in zip(names, verdicts.tolist(), strict=True)]


def _read(path: Path) -> tuple[list[str], NDArray[np.float64], NDArray[np.float64]]:
    """Names, places and unit normals."""
    try:
        with path.open(newline="", encoding="utf-8") as file:
            reader = csv.DictReader(file)
            missing = [c for c in COLUMNS if c not in (reader.fieldnames or ())]
            if missing:
                raise InputError(f"the column {missing[0]} is missing", field=str(path))
            lines = list(reader)
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"cannot be read: {error}", field=str(path)) from None
    names, values = [], []
    for number, line in enumerate(lines, start=2):
        try:
            values.append([float(line[c]) for c in COLUMNS])
        except (TypeError, ValueError):
            raise InputError(f"line {number} is not six numbers", field=str(path)) from None
        names.append(line.get("name") or f"line {number}")
    table = np.array(values, dtype=np.float64).reshape(-1, 6)
    length = np.linalg.norm(table[:, 3:], axis=1)
    wrong = np.flatnonzero(~np.isfinite(table).all(axis=1) | ~(length > 0))
    if not len(table) or len(wrong):
        where = f"line {wrong[0] + 2} has no normal or is not finite" if len(wrong) else "there are no points in it"
        raise InputError(where, field=str(path))
    return names, table[:, :3], table[:, 3:] / length[:, None]
