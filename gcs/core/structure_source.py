"""Where a structure comes from: mesh files and how they stand in the scene, cables, or a sample."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import Field, model_validator

from gcs.core.fields import Finite, Point3, Positive, Strict


class MeshSource(Strict):
    """A mesh file and how it stands in the scene. Order: scale, up, rotation, position."""

    file: str = Field(min_length=1)
    scale: Positive = 1.0
    up: Literal["z", "y"] = "z"
    position_m: Point3 = (0.0, 0.0, 0.0)
    rotation_deg: Finite = 0.0
    sha256: str | None = None


class Cable(Strict):
    """A straight stay: a capsule."""

    from_m: Point3
    to_m: Point3
    radius_m: Positive


class StructureSource(Strict):
    """Meshes and cables, or a sample scene."""

    meshes: tuple[MeshSource, ...] = ()
    cables: tuple[Cable, ...] = ()
    sample: Literal["gantry-crane", "container-yard", "bridge-tower"] | None = None

    @model_validator(mode="after")
    def _one_source(self) -> Self:
        if bool(self.meshes) == (self.sample is not None):
            raise ValueError("give either meshes or a sample")
        return self
