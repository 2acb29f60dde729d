"""Structures: meshes brought in, and samples that come with the station."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field

from gcs.api.schemas.base import Box, CableLine, Point3, Sent


class StructureSummary(Sent):
    """One structure of the list."""

    id: str = Field(description="For a sample its name, such as `gantry-crane`.")
    kind: Literal["sample", "mesh"]
    name: str
    created_at: str | None


class NamedPointInfo(Sent):
    """A vulnerable point that belongs to a sample."""

    name: str
    position_m: Point3
    normal: Point3


class StructureDetail(StructureSummary):
    """A structure with what was found while loading it."""

    source: dict[str, Any] = Field(description="Goes as it is into `structure` of a scenario.")
    triangles: int
    bounds: Box
    cables: list[CableLine]
    named_points: list[NamedPointInfo]
    notes: list[str] = Field(description="What was found and done while loading, in plain words.")
