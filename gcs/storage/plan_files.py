"""The folder of a plan: written whole or not at all, and read back."""

from __future__ import annotations

import csv
import hashlib
import io
import json
import math
import re
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import ValidationError

from gcs.core.errors import InputError
from gcs.core.structure import Structure
from gcs.storage.atomic_files import check_replaceable, new_directory
from gcs.storage.plan_document import PlanDocument, document_of, face_entry, own_ways_entry, plan_of, sortie_entry
from gcs.storage.ply_files import ply_bytes, read_ply

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping
    from pathlib import Path

    from numpy.typing import NDArray

    from gcs.core.plan import Plan

FILE_NAMES = (
    "plan.json",
    "viewpoints.csv",
    "path.csv",
    "structure.ply",
    "trajectory.csv",
    "mission.plan",
    "mission.waypoints",
    "report.json",
    "report.html",
)
SAMPLE_S = 0.02
"""Step of trajectory.csv: 50 Hz."""
SMALLEST_STEP_S = 1e-4

FLEET_FILE, SORTIES_FILE = "fleet.json", "sorties.json"
GROUP_FILES = (FLEET_FILE, SORTIES_FILE)
"""Say how several plans are flown that have no `plan.json` in common, only folders each (`plan_group_files`)."""

PART = re.compile(r"(sortie|vehicle)-([1-9]\d*)")
"""Name of the folder of a sortie or of a vehicle's plan."""

VIEWPOINT_COLUMNS = [
    *("id", "name", "x_m", "y_m", "z_m"),
    *("dir_x", "dir_y", "dir_z", "up_x", "up_y", "up_z"),
    *("gsd_mm", "time_s"),
]
TRAJECTORY_COLUMNS = [
    *("t_s", "x_m", "y_m", "z_m"),
    *("vx_m_s", "vy_m_s", "vz_m_s"),
    *("ax_m_s2", "ay_m_s2", "az_m_s2"),
    "yaw_rad",
]


def plan_report(plan: Plan, *, mission_items: int | None = None) -> dict[str, Any]:
    """Content of `report.json`.

    Args:
        plan: a finished plan.
        mission_items: how many items its mission has; None when no mission files are written.
    """
    faces = [face_entry(face).model_dump() for face in plan.faces]
    return {
        **asdict(plan.certificates),
        "faces": faces,
        "own_ways": own_ways_report(plan),
        "sorties": sorties_report(plan),
        "mission_items": mission_items,
        "stages_s": plan.stages_s,
    }


def own_ways_report(plan: Plan) -> dict[str, Any] | None:
    """What the vehicle can safely do by itself, as `report.json` has it."""
    entry = own_ways_entry(plan.own_ways)
    return None if entry is None else entry.model_dump(mode="json")


def sorties_report(plan: Plan) -> list[dict[str, Any]]:
    """The flights of a plan that one battery is not enough for, as `report.json` has them."""
    return [sortie_entry(sortie).model_dump() for sortie in plan.sorties]


def part_directories(directory: Path) -> list[Path]:
    """The folders of the sorties or vehicles in a plan's folder, in order; empty when it is one flight."""
    parts = [(match, entry) for entry in directory.iterdir() if (match := PART.fullmatch(entry.name))]
    return [entry for _, entry in sorted(parts, key=lambda part: int(part[0][2]))]


def check_output(directory: Path) -> None:
    """Tell before planning whether a plan may be written to a folder.

    Raises:
        InputError: something else is there.
    """
    check_replaceable(directory.absolute(), is_ours)


def is_ours(directory: Path) -> bool:
    """Whether a folder holds a plan or a group of plans, and nothing else."""
    return is_plan_directory(directory) or is_group_directory(directory)


def is_plan_directory(directory: Path) -> bool:
    """Whether a folder holds a plan, with the folders of its parts, and nothing else."""
    names = _names_beside_parts(directory)
    return "plan.json" in names and names <= set(FILE_NAMES)


def is_group_directory(directory: Path) -> bool:
    """Whether a folder holds a group of plans and nothing else."""
    return _names_beside_parts(directory) in ({name} for name in GROUP_FILES)


def _names_beside_parts(directory: Path) -> set[str]:
    """Names of all that is in a folder, without the folders of parts that hold plans."""
    parts = {part.name for part in part_directories(directory) if part.is_dir() and is_plan_directory(part)}
    return {entry.name for entry in directory.iterdir()} - parts


def write_plan(
    plan: Plan,
    structure: Structure,
    directory: Path,
    *,
    report: dict[str, Any] | None = None,
    extra_files: Mapping[str, bytes] | None = None,
    parts: Mapping[str, Mapping[str, bytes]] | None = None,
) -> str:
    """Write all files of a plan; the folder appears whole, or stays as it was.

    Args:
        plan: a finished plan.
        structure: the placed structure.
        directory: the folder; one that holds an earlier plan is replaced.
        report: content of `report.json`; `plan_report(plan)` when left out.
        extra_files: content of `mission.plan`, `mission.waypoints` and `report.html`.
        parts: folders such as `sortie-1` and what `plan_contents` gives for the plans in them.

    Returns:
        The plan's hash: SHA-256 of the bytes of `plan.json`.

    Raises:
        InputError: the folder holds something else.
        StorageError: the disk did not take it.
    """
    contents = plan_contents(plan, structure, report=report, extra_files=extra_files)
    with new_directory(directory, is_ours) as folder:
        write_contents(folder, contents)
        for name, files in (parts or {}).items():
            (folder / name).mkdir()
            write_contents(folder / name, files)
    return hashlib.sha256(contents["plan.json"]).hexdigest()


def write_contents(folder: Path, contents: Mapping[str, bytes]) -> None:
    """Write files into a folder that is there."""
    for name, content in contents.items():
        (folder / name).write_bytes(content)


def plan_contents(
    plan: Plan,
    structure: Structure,
    *,
    report: dict[str, Any] | None = None,
    extra_files: Mapping[str, bytes] | None = None,
) -> dict[str, bytes]:
    """All files of a plan, name -> content; arguments as of `write_plan`."""
    extra = dict(extra_files or {})
    unknown = extra.keys() - set(FILE_NAMES)
    if unknown:
        raise ValueError(f"not files of a plan: {', '.join(sorted(unknown))}")
    document = document_of(plan).model_dump_json(indent=None, exclude_none=False).encode() + b"\n"
    return {
        **plan_tables(plan),
        "structure.ply": ply_bytes(structure.vertices_m, structure.faces),
        "report.json": json.dumps(report or plan_report(plan), indent=2, allow_nan=False).encode() + b"\n",
        **extra,
        "plan.json": document,
    }


def plan_tables(plan: Plan) -> dict[str, bytes]:
    """The files that follow from `plan.json` to the letter: `viewpoints.csv`, `path.csv` and `trajectory.csv`."""
    return {
        "viewpoints.csv": _viewpoints_csv(plan),
        "path.csv": _csv(["x_m", "y_m", "z_m"], ([_number(c) for c in p] for p in plan.path_m)),
        "trajectory.csv": _trajectory_csv(plan),
    }


def read_plan(directory: Path) -> Plan:
    """Read a plan back.

    Raises:
        InputError: there is no plan, or it was damaged or made by another version.
    """
    path = directory / "plan.json"
    try:
        return plan_of(PlanDocument.model_validate_json(_read(path)))
    except ValidationError as error:
        first = error.errors()[0]
        what = ": ".join(part for part in (".".join(map(str, first["loc"])), first["msg"]) if part)
        raise InputError(f"damaged, or not a plan of this version ({what}): plan again", field=str(path)) from None


def read_structure(directory: Path) -> Structure:
    """Read the placed structure of a plan, with its cables.

    Raises:
        InputError: a file is missing or damaged.
    """
    vertices, faces = read_ply(directory / "structure.ply")
    return Structure(vertices_m=vertices, faces=faces, cables=read_plan(directory).cables)


def read_report(directory: Path) -> dict[str, Any]:
    """Content of `report.json`.

    Raises:
        InputError: it is missing or damaged.
    """
    path = directory / "report.json"
    try:
        report = json.loads(_read(path))
    except ValueError:
        raise InputError("not well-formed JSON: plan again", field=str(path)) from None
    if not isinstance(report, dict):
        raise InputError("not a report: plan again", field=str(path))
    return report


def plan_hash(directory: Path) -> str:
    """SHA-256 of the bytes of `plan.json`.

    Raises:
        InputError: there is no plan.
    """
    return hashlib.sha256(_read(directory / "plan.json")).hexdigest()


def plan_schema() -> str:
    """The published JSON Schema of `plan.json`, as it is kept in `plan.schema.json`."""
    schema = PlanDocument.model_json_schema(mode="serialization")
    schema = {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}
    return json.dumps(schema, indent=1) + "\n"


def sample_times(duration_s: float) -> NDArray[np.float64]:
    """Times of trajectory.csv: every 0.02 s and the exact end, strictly increasing, no step over 0.02 s."""
    count = max(1, math.ceil(duration_s / SAMPLE_S - 1e-9))
    times = np.append(np.arange(count) * SAMPLE_S, duration_s)
    if len(times) > 2 and times[-1] - times[-2] < SMALLEST_STEP_S:
        times[-2] = (times[-3] + times[-1]) / 2
    return times


def _read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except (FileNotFoundError, NotADirectoryError):
        if path.name == "plan.json" and any((path.parent / name).is_file() for name in GROUP_FILES):
            raise InputError(
                "these are several plans: give the folder of one of them", field=str(path.parent)
            ) from None
        if path.name == "plan.json":
            raise InputError("there is no such plan: give a folder that `gcs plan` wrote", field=str(path)) from None
        raise InputError("this file of the plan is missing: plan again", field=str(path)) from None
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", field=str(path)) from None


def _viewpoints_csv(plan: Plan) -> bytes:
    return _csv(
        VIEWPOINT_COLUMNS,
        (
            [
                str(v.id),
                v.name,
                *(_number(c) for c in (*v.position_m, *v.direction, *v.up)),
                _number(v.gsd_m * 1000),
                _number(v.time_s),
            ]
            for v in plan.viewpoints
        ),
    )


def _trajectory_csv(plan: Plan) -> bytes:
    times = sample_times(plan.trajectory.duration_s)
    columns = np.column_stack([*(plan.trajectory.value(times, order) for order in range(3)), plan.yaw.value(times)])
    lines = [",".join(TRAJECTORY_COLUMNS)]
    for t, row in zip(times.tolist(), columns.tolist(), strict=True):
        lines.append(f"{t:.9f}," + ",".join(f"{value:.8f}" for value in row))
    return ("\n".join(lines) + "\n").encode()


def _csv(columns: list[str], rows: Iterable[list[str]]) -> bytes:
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(rows)
    return out.getvalue().encode()


def _number(value: float) -> str:
    return f"{value:.9f}"
