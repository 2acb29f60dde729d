"""Where a structure comes from: mesh files and how they stand in the scene, cables, or a sample."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from gcs.core.fields import Finite, Point3, Positive, Strict

SampleName = Literal["gantry-crane", "container-yard", "bridge-tower"]


class SurveyedPoint(Strict):
    """A point of a mesh that was measured on site: `mesh` in the file's own units and axes, `world_m` in scene ENU."""

    mesh: Point3
    world_m: Point3


class Alignment(Strict):
    """Where a mesh stands, by three or more surveyed points that are not on one line.

    The mesh is turned and moved, in all three dimensions, to the least squares fit. `find_scale` lets the fit find the
    scale as well.
    """

    points: Annotated[tuple[SurveyedPoint, ...], Field(min_length=3)]
    find_scale: bool = False


class MeshSource(Strict):
    """A mesh file and how it stands in the scene.

    Either by hand, in the order scale, up, rotation, position, or by `align` after `scale`.
    """

    file: str = Field(min_length=1)
    scale: Positive = 1.0
    up: Literal["z", "y"] = "z"
    position_m: Point3 = (0.0, 0.0, 0.0)
    rotation_deg: Finite = 0.0
    align: Alignment | None = None
    sha256: str | None = None

    @model_validator(mode="after")
    def _placed_once(self) -> Self:
        if self.align is None:
            return self
        by_hand = {
            "up": self.up != "z",
            "position_m": any(self.position_m),
            "rotation_deg": self.rotation_deg != 0.0,
            "scale": self.align.find_scale and self.scale != 1.0,
        }
        given = [name for name, is_given in by_hand.items() if is_given]
        if given:
            raise ValueError(f"align already says how the mesh stands: leave out either align or {', '.join(given)}")
        return self


class Cable(Strict):
    """A straight stay: a capsule."""

    from_m: Point3
    to_m: Point3
    radius_m: Positive


class StructureSource(Strict):
    """Meshes and cables, or a sample scene.

    `size_is_right` confirms a structure of unusual size. `placed_from` is written into a plan: the meshes as they were
    given, when `meshes` is what surveyed points made of them.
    """

    meshes: tuple[MeshSource, ...] = ()
    cables: tuple[Cable, ...] = ()
    sample: SampleName | None = None
    size_is_right: bool = False
    placed_from: tuple[MeshSource, ...] = ()

    @model_validator(mode="after")
    def _one_source(self) -> Self:
        if bool(self.meshes) == (self.sample is not None):
            raise ValueError("give either meshes or a sample")
        return self
