"""What a mesh file is like, in plain words, for somebody who wants to plan with it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.structure import Structure
from gcs.planning.scene.mesh_simplification import PLANNING_ERROR_M, planning_mesh
from gcs.services.mesh_inside import DIRECTIONS, SAMPLED_POINTS, inner_share
from gcs.services.mesh_topology import MeshTopology, mesh_topology
from gcs.storage.mesh_cleaning import CleanMesh, clean_mesh
from gcs.storage.mesh_loading import COARSE_STEP_M
from gcs.storage.mesh_reading import read_mesh

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

SAME_VERTEX = 1e-8
"""Vertices nearer than this share of the mesh's size are one and the same."""

FAR_OFF = 10.0
"""A mesh whose middle is this many times its size from its origin is in map coordinates."""


@dataclass(frozen=True)
class MeshReport:
    """Figures of a mesh file in its own units; triangles with a corner that is not finite are only counted.

    Attributes:
        file: its name.
        file_format: such as `STL`.
        triangles: all of them.
        not_finite: triangles with NaN or infinite corners.
        degenerate: triangles that are only a line or a point.
        duplicates: triangles that repeat another one.
        low: lowest corner, (3,).
        high: highest corner, (3,).
        area: of all different triangles, one side.
        topology: how they hang together.
        inside_out: whether it is closed and faces inwards.
        inner: share of the surface that cannot be seen from outside.
        step: distance between neighbouring numbers of the file at its largest coordinates; 0 in double precision.
        planned_triangles: what is left of it on the planner's grid, if its unit is the guessed one.
        planned_error_m: how far those are from the full ones at most.
        units: the unit written in the file, if one is.
    """

    file: str
    file_format: str
    triangles: int
    not_finite: int
    degenerate: int
    duplicates: int
    low: tuple[float, float, float]
    high: tuple[float, float, float]
    area: float
    topology: MeshTopology
    inside_out: bool
    inner: float
    step: float
    planned_triangles: int
    planned_error_m: float
    units: str | None

    @property
    def watertight(self) -> bool:
        """Whether every edge belongs to exactly two triangles."""
        return self.topology.border_edges == 0 and self.topology.crowded_edges == 0

    @property
    def extent(self) -> float:
        """Largest size along an axis."""
        return max(h - low for low, h in zip(self.low, self.high, strict=True))

    def lines(self) -> list[str]:
        """The report in plain words."""
        size = [h - low for low, h in zip(self.low, self.high, strict=True)]
        parts = _count(self.topology.parts, "part")
        return [
            f"{self.file}: {self.file_format}, {_count(self.triangles, 'triangle')}, {parts}",
            f"size: {size[0]:.4g} x {size[1]:.4g} x {size[2]:.4g} file units (x, y, z)",
            "from " + " to ".join(f"({c[0]:.7g}, {c[1]:.7g}, {c[2]:.7g})" for c in (self.low, self.high)),
            f"surface: {self.area:.4g} square units, one side",
            f"units: {units_guess(self.extent)}",
            *self._axes(),
            *self._place(),
            *self._closure(),
            *self._repairs(),
            *self._planning(),
        ]

    def _axes(self) -> list[str]:
        lines = []
        if self.units:
            lines.append(f"the file says that its unit is {self.units}: this is not used, only `scale` is")
        if self.file_format in {"GLB", "GLTF"}:
            lines.append(
                "this format is in metres with y upwards by its rules: `up: y`, unless its maker did otherwise"
            )
        return lines

    def _place(self) -> list[str]:
        middle = [(h + low) / 2 for low, h in zip(self.low, self.high, strict=True)]
        lines = []
        if max(abs(m) for m in middle) > FAR_OFF * self.extent:
            scale = scale_guess(self.extent)
            position = ", ".join(f"{round(-m * scale) + 0:d}" for m in (middle[0], middle[1], self.low[2]))
            lines.append(
                f"far from its origin, as in map coordinates: `position_m: [{position}]` with `scale: {scale:g}` would "
                "put its foot at the anchor"
            )
        if self.step * scale_guess(self.extent) > COARSE_STEP_M:
            lines.append(
                f"its coordinates are in single precision, in steps of {self.step:.2g}: export it about a local origin"
            )
        return lines

    def _closure(self) -> list[str]:
        found = self.topology
        lines = []
        if self.watertight and not self.not_finite:
            lines.append("closed: every edge joins two triangles")
        elif found.border_edges:
            holes = _count(found.holes, "hole or open border", "holes or open borders")
            lines.append(f"not closed: {_count(found.border_edges, 'open edge')} in {holes}: harmless")
        if found.crowded_edges:
            edges = _count(found.crowded_edges, "edge")
            lines.append(f"{edges} of more than two triangles: inner walls or parts that touch: harmless")
        if found.flipped:
            lines.append(f"{_count(found.flipped, 'triangle')} facing the other way than their neighbours: harmless")
        if self.inside_out:
            lines.append("its triangles face inwards: harmless")
        if found.flipped or self.inside_out or found.border_edges:
            lines.append("(planning takes both sides of every triangle for surface and does not need it closed)")
        sampled = f"{SAMPLED_POINTS:,} sampled points, {DIRECTIONS} directions"
        if self.inner > 0:
            lines.append(
                f"inner faces: about {100 * self.inner:.2g} % of the surface cannot be seen from outside ({sampled}): "
                "they are not asked for, and count as not coverable"
            )
        elif self.area > 0:
            lines.append(f"no inner faces found ({sampled})")
        return lines

    def _repairs(self) -> list[str]:
        lines = []
        if self.duplicates:
            lines.append(f"{_count(self.duplicates, 'triangle')} repeat another one: left out when planning")
        if self.degenerate:
            lines.append(f"{_count(self.degenerate, 'triangle')} without area: left out when planning")
        if self.not_finite:
            lines.append(f"{_count(self.not_finite, 'triangle')} with corners that are not finite (NaN): mend the file")
        return lines

    def _planning(self) -> list[str]:
        left = self.triangles - self.not_finite - self.degenerate - self.duplicates
        if self.planned_error_m == 0:
            return [f"planned with {_count(left, 'triangle')}, not simplified"]
        planned = _count(self.planned_triangles, "triangle")
        return [
            f"simplified for the planner's distance grid (at `scale: {scale_guess(self.extent):g}`): {planned}, "
            f"nowhere further than {self.planned_error_m:.3f} m from the file's {left:,}, which the certificates use"
        ]


def units_guess(extent: float) -> str:
    """What the unit of a mesh might be by its largest extent, if it is a structure of some 5 to 500 m."""
    if extent < 5:
        return "unclear; a small part in metres, or a model of a structure (`scale: 100` for 1:100)"
    if extent <= 500:
        return "metres, by its size (`scale: 1`)"
    if extent <= 15000:
        return "centimetres, by its size (`scale: 0.01`)"
    return "millimetres, by its size (`scale: 0.001`)"


def scale_guess(extent: float) -> float:
    """The scale that goes with `units_guess`; 1 when that is unclear."""
    return 1.0 if extent <= 500 else 0.01 if extent <= 15000 else 0.001


def inspect_mesh(path: Path) -> MeshReport:
    """Look at a mesh file.

    Raises:
        InputError: it is missing, empty or not a mesh.
    """
    content = read_mesh(path)
    finite = content.finite_faces
    faces = content.faces[finite]
    low = high = np.full(3, np.nan)
    mesh = CleanMesh(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64), 0, 0)
    if len(faces):
        is_used = np.zeros(len(content.vertices), dtype=np.bool_)
        is_used[faces] = True
        used = content.vertices[is_used]
        low, high = used.min(axis=0), used.max(axis=0)
        mesh = clean_mesh(_snapped(content.vertices, float((high - low).max())), faces)
    topology = mesh_topology(mesh.faces)
    inner, planned, inside_out, area = 0.0, None, False, 0.0
    if len(mesh.faces):
        scale = scale_guess(float((high - low).max()))
        planned = planning_mesh(Structure(mesh.vertices * scale, mesh.faces), PLANNING_ERROR_M)
        inner = inner_share(mesh.vertices, mesh.faces)
        area, volume = _area_and_volume(mesh, (low + high) / 2)
        inside_out = topology.border_edges == topology.crowded_edges == topology.flipped == 0 and volume < 0
    return MeshReport(
        file=path.name,
        file_format=content.file_format,
        triangles=len(content.faces),
        not_finite=int((~finite).sum()),
        degenerate=mesh.degenerate,
        duplicates=mesh.duplicates,
        low=(float(low[0]), float(low[1]), float(low[2])),
        high=(float(high[0]), float(high[1]), float(high[2])),
        area=area,
        topology=topology,
        inside_out=inside_out,
        inner=inner,
        step=content.step,
        planned_triangles=len(planned.structure.faces) if planned else 0,
        planned_error_m=planned.error_m if planned else 0.0,
        units=content.units,
    )


def _count(number: int, singular: str, plural: str | None = None) -> str:
    return f"{number:,} {singular if number == 1 else plural or singular + 's'}"


def _snapped(vertices: NDArray[np.float64], extent: float) -> NDArray[np.float64]:
    """Vertices on a fine grid, so that those that are meant to be one are."""
    grid = max(extent * SAME_VERTEX, 1e-300)
    return np.asarray(np.round(vertices / grid) * grid)


def _area_and_volume(mesh: CleanMesh, middle: NDArray[np.float64]) -> tuple[float, float]:
    """Area of one side, and the volume that the triangles enclose, with their orientation as its sign."""
    a, b, c = (mesh.vertices[mesh.faces[:, k]] - middle for k in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2
    return float(area), float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)
