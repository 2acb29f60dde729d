"""What is to be seen: surface, named points and faces."""

from __future__ import annotations

import math
from typing import Annotated, Self

from pydantic import Field, field_validator, model_validator

from gcs.core.fields import Point3, Positive, Strict

DEFAULT_POINT_FOOTPRINT_M = 3.0
"""Width of the picture of a named point when no GSD is asked (the gantry-crane paper's field of view)."""


class Region(Strict):
    """An axis-aligned box that selects surface."""

    min_m: Point3
    max_m: Point3

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if any(a >= b for a, b in zip(self.min_m, self.max_m, strict=True)):
            raise ValueError("min_m must be below max_m on every axis")
        return self


class SurfaceTask(Strict):
    """Everything that can be seen from outside, or what lies in `regions`."""

    gsd_mm: Positive
    overlap: Annotated[float, Field(ge=0, lt=0.95)] = 0.3
    max_incidence_deg: Annotated[float, Field(gt=0, lt=90)] = 60.0
    regions: tuple[Region, ...] = ()


class NamedPoint(Strict):
    """A point to be photographed, with its outward normal; without a GSD the picture is 3 m wide."""

    name: str = Field(min_length=1, max_length=80)
    position_m: Point3
    normal: Point3
    gsd_mm: Positive | None = None

    @field_validator("normal")
    @classmethod
    def _unit(cls, normal: Point3) -> Point3:
        length = math.sqrt(sum(c * c for c in normal))
        if length < 1e-9:
            raise ValueError("the normal must not be zero")
        return (normal[0] / length, normal[1] / length, normal[2] / length)


class FaceTask(Strict):
    """A rectangular face inspected on a fixed grid of cells."""

    name: str = Field(min_length=1, max_length=80)
    origin_m: Point3
    along_m: Point3
    up_m: Point3
    normal: Point3
    cell_m: Positive


class Inspection(Strict):
    """What is to be seen: one or more of surface, points and faces."""

    surface: SurfaceTask | None = None
    points: tuple[NamedPoint, ...] = ()
    faces: tuple[FaceTask, ...] = ()

    @model_validator(mode="after")
    def _something(self) -> Self:
        if self.surface is None and not self.points and not self.faces:
            raise ValueError("name at least one of surface, points and faces")
        if self.faces:
            raise ValueError("`faces` is not part of this version: use surface with a region, or points")
        names = [p.name for p in self.points]
        twice = sorted({n for n in names if names.count(n) > 1})
        if twice:
            raise ValueError(f"the names of points must differ; given twice: {', '.join(twice)}")
        return self
