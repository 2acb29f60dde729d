"""Tables of points of a surface, with outward normals: CSV on disk to arrays."""

from __future__ import annotations

import csv
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.errors import InputError

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

COLUMNS = ("x_m", "y_m", "z_m", "normal_x", "normal_y", "normal_z")


def read_point_table(path: Path) -> tuple[list[str], NDArray[np.float64], NDArray[np.float64]]:
    """Read a CSV with the columns `x_m,y_m,z_m,normal_x,normal_y,normal_z` and, if there are names, `name`.

    Returns:
        Names (`line 7` for those without one), places and unit normals, shape (N, 3) each, as they stand in the table.

    Raises:
        InputError: there is no such table, or a line of it is no point with a normal.
    """
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
