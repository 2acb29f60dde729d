"""What is to be seen: surface, named points and faces."""

from __future__ import annotations

import math
from typing import Annotated, Self

from pydantic import Field, field_validator, model_validator

from gcs.core.fields import Point3, Positive, Strict

DEFAULT_POINT_FOOTPRINT_M = 3.0
"""Width of the picture of a named point when no GSD is asked (the gantry-crane paper's field of view)."""

MOST_CELLS = 10_000
"""Cells of all faces together; each is a stop of its own, and so many take a vehicle days."""

MOST_SPOTS = 20_000

MOST_HOLD_S = 600.0
"""Longest time at one viewpoint that can be asked for."""

SQUARE = math.sin(math.radians(0.5))
"""Sine of the largest error in the right angles of a face."""


class Region(Strict):
    """An axis-aligned box that selects surface."""

    min_m: Point3
    max_m: Point3

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if any(a >= b for a, b in zip(self.min_m, self.max_m, strict=True)):
            raise ValueError("min_m must be below max_m on every axis")
        return self


class Spot(Strict):
    """A place of the surface, with its outward normal, that the surface's pictures must not leave out."""

    name: str = Field(min_length=1, max_length=80)
    position_m: Point3
    normal: Point3

    @field_validator("normal")
    @classmethod
    def _unit(cls, normal: Point3) -> Point3:
        return _unit_vector(normal)


class SurfaceTask(Strict):
    """Everything that can be seen from outside, or what lies in `regions`.

    The pictures may leave out a little that would take many more of them, but no spot. In a scenario file `spots` may
    be the name of a table instead.
    """

    gsd_mm: Positive
    overlap: Annotated[float, Field(ge=0, lt=0.95)] = 0.3
    max_incidence_deg: Annotated[float, Field(gt=0, lt=90)] = 60.0
    regions: tuple[Region, ...] = ()
    spots: tuple[Spot, ...] = Field(default=(), max_length=MOST_SPOTS)


class NamedPoint(Strict):
    """A point to be photographed, with its outward normal; without a GSD the picture is 3 m wide.

    The vehicle stands still and looks at it for at least `hold_s`, also where it may fly through viewpoints.
    """

    name: str = Field(min_length=1, max_length=80)
    position_m: Point3
    normal: Point3
    gsd_mm: Positive | None = None
    hold_s: Annotated[float, Field(gt=0, le=MOST_HOLD_S)] | None = None

    @field_validator("normal")
    @classmethod
    def _unit(cls, normal: Point3) -> Point3:
        return _unit_vector(normal)


class FaceTask(Strict):
    """A rectangular face inspected on a fixed grid of cells, a picture each.

    The rectangle is spanned from `origin_m` by its sides `along_m` and `up_m`; `normal` says which side of it is looked
    at. Rows go up, columns along; where a side is no multiple of `cell_m` the last row or column is as much smaller.
    Without a GSD the pictures are taken from as near as the cell, the position error and the clearance allow.
    """

    name: str = Field(min_length=1, max_length=60)
    origin_m: Point3
    along_m: Point3
    up_m: Point3
    normal: Point3
    cell_m: Positive
    gsd_mm: Positive | None = None
    max_incidence_deg: Annotated[float, Field(gt=0, lt=90)] = 60.0

    @field_validator("normal")
    @classmethod
    def _unit(cls, normal: Point3) -> Point3:
        return _unit_vector(normal)

    @field_validator("along_m", "up_m")
    @classmethod
    def _has_length(cls, side: Point3) -> Point3:
        if _length(side) < 1e-6:
            raise ValueError("a side of the face must not be zero")
        return side

    @model_validator(mode="after")
    def _rectangle(self) -> Self:
        sides = {"along_m": self.along_m, "up_m": self.up_m, "normal": self.normal}
        for a, b in (("along_m", "up_m"), ("along_m", "normal"), ("up_m", "normal")):
            u, v = sides[a], sides[b]
            sine = sum(x * y for x, y in zip(u, v, strict=True)) / (_length(u) * _length(v))
            if abs(sine) > SQUARE:
                angle = math.degrees(math.acos(max(-1.0, min(1.0, sine))))
                raise ValueError(f"{a} and {b} must be at right angles, and are at {angle:.1f} degrees")
        return self

    @property
    def columns(self) -> int:
        """Cells along."""
        return _pieces(_length(self.along_m), self.cell_m)

    @property
    def rows(self) -> int:
        """Cells up."""
        return _pieces(_length(self.up_m), self.cell_m)

    def cell_name(self, row: int, column: int) -> str:
        """Name of a cell and of its viewpoint, such as `south-r03-c12`.

        Args:
            row: from 0, at `origin_m`.
            column: from 0, at `origin_m`.
        """
        high, wide = (max(2, len(str(n))) for n in (self.rows, self.columns))
        return f"{self.name}-r{row + 1:0{high}d}-c{column + 1:0{wide}d}"


class Inspection(Strict):
    """What is to be seen: one or more of surface, points and faces."""

    surface: SurfaceTask | None = None
    points: tuple[NamedPoint, ...] = ()
    faces: tuple[FaceTask, ...] = ()

    @model_validator(mode="after")
    def _something(self) -> Self:
        if self.surface is None and not self.points and not self.faces:
            raise ValueError("name at least one of surface, points and faces")
        for what, names in (("points", [p.name for p in self.points]), ("faces", [f.name for f in self.faces])):
            twice = sorted({n for n in names if names.count(n) > 1})
            if twice:
                raise ValueError(f"the names of {what} must differ; given twice: {', '.join(twice)}")
        return self

    @model_validator(mode="after")
    def _not_too_many_cells(self) -> Self:
        cells = {face.name: face.rows * face.columns for face in self.faces}
        if sum(cells.values()) > MOST_CELLS:
            each = ", ".join(f"{name}: {count:,}" for name, count in cells.items())
            raise ValueError(
                f"the faces have {sum(cells.values()):,} cells ({each}), and {MOST_CELLS:,} at most are planned: "
                "use a larger cell_m, or fewer faces at a time"
            )
        return self

    @model_validator(mode="after")
    def _points_are_no_cells(self) -> Self:
        points = {p.name for p in self.points}
        for face in self.faces:
            if any(name.startswith(f"{face.name}-r") for name in points):
                cells = {face.cell_name(r, c) for r in range(face.rows) for c in range(face.columns)}
                both = sorted(cells & points)
                if both:
                    raise ValueError(f"a point and a cell of face {face.name} are both named {both[0]}")
        return self


def _length(vector: Point3) -> float:
    return math.hypot(*vector)


def _unit_vector(vector: Point3) -> Point3:
    length = _length(vector)
    if length < 1e-9:
        raise ValueError("the normal must not be zero")
    return (vector[0] / length, vector[1] / length, vector[2] / length)


def _pieces(side_m: float, cell_m: float) -> int:
    """How many cells a side takes; a thousandth of a cell too long is a matter of rounding, not of one cell more."""
    return max(1, math.ceil(min(side_m / cell_m, 1e9) - 1e-3))
