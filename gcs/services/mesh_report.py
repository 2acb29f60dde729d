"""What a mesh file is like, in plain words, for somebody who wants to plan with it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gcs.storage.mesh_reading import is_degenerate, read_mesh

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

SAME_VERTEX = 1e-8
"""Vertices nearer than this share of the mesh's size are one and the same."""


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
        area: of all triangles, one side.
        parts: bodies that share no vertex with each other.
        border_edges: edges of a single triangle.
        holes: connected groups of such edges.
        crowded_edges: edges of more than two triangles.
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
    parts: int
    border_edges: int
    holes: int
    crowded_edges: int
    units: str | None

    @property
    def watertight(self) -> bool:
        """Whether every edge belongs to exactly two triangles."""
        return self.border_edges == 0 and self.crowded_edges == 0

    def lines(self) -> list[str]:
        """The report in plain words."""
        size = [h - low for low, h in zip(self.low, self.high, strict=True)]
        result = [
            f"{self.file}: {self.file_format}, {_count(self.triangles, 'triangle')}, {_count(self.parts, 'part')}",
            f"size: {size[0]:.4g} x {size[1]:.4g} x {size[2]:.4g} file units (x, y, z)",
            "from " + " to ".join(f"({c[0]:.4g}, {c[1]:.4g}, {c[2]:.4g})" for c in (self.low, self.high)),
            f"surface: {self.area:.4g} square units, one side",
            f"units: {units_guess(max(size))}",
        ]
        if self.units:
            result.append(f"the file says that its unit is {self.units}: this is not used, only `scale` is")
        if self.watertight:
            result.append("closed: every edge joins two triangles")
        elif self.border_edges:
            holes = _count(self.holes, "hole or open border", "holes or open borders")
            result.append(
                f"not closed: {_count(self.border_edges, 'open edge')} in {holes}; planning does not need it closed"
            )
        if self.crowded_edges:
            result.append(
                f"{_count(self.crowded_edges, 'edge')} of more than two triangles: inner walls or parts that touch"
            )
        if self.duplicates:
            result.append(f"{_count(self.duplicates, 'triangle')} repeat another one: harmless")
        if self.degenerate:
            result.append(f"{_count(self.degenerate, 'triangle')} without area: left out when planning")
        if self.not_finite:
            result.append(
                f"{_count(self.not_finite, 'triangle')} with corners that are not finite (NaN): mend the file"
            )
        return result


def units_guess(extent: float) -> str:
    """What the unit of a mesh might be by its largest extent, if it is a structure of some 5 to 500 m."""
    if extent < 5:
        return "unclear; a small part in metres, or a model of a structure (`scale: 100` for 1:100)"
    if extent <= 500:
        return "metres, by its size (`scale: 1`)"
    if extent <= 15000:
        return "centimetres, by its size (`scale: 0.01`)"
    return "millimetres, by its size (`scale: 0.001`)"


def inspect_mesh(path: Path) -> MeshReport:
    """Look at a mesh file.

    Raises:
        InputError: it is missing, empty or not a mesh.
    """
    content = read_mesh(path)
    finite = content.finite_faces
    faces = content.faces[finite]
    triangles = content.vertices[faces]
    low = high = np.full(3, np.nan)
    parts = border = holes = crowded = duplicates = degenerate = 0
    area = 0.0
    if len(faces):
        corners = triangles.reshape(-1, 3)
        low, high = corners.min(axis=0), corners.max(axis=0)
        cross = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
        area = float(np.linalg.norm(cross, axis=1).sum() / 2)
        thin = is_degenerate(triangles)
        degenerate = int(thin.sum())
        welded = _welded(triangles[~thin], float((high - low).max()))
        parts, border, holes, crowded, duplicates = _topology(welded)
    return MeshReport(
        file=path.name,
        file_format=content.file_format,
        triangles=len(content.faces),
        not_finite=int((~finite).sum()),
        degenerate=degenerate,
        duplicates=duplicates,
        low=(float(low[0]), float(low[1]), float(low[2])),
        high=(float(high[0]), float(high[1]), float(high[2])),
        area=area,
        parts=parts,
        border_edges=border,
        holes=holes,
        crowded_edges=crowded,
        units=content.units,
    )


def _count(number: int, singular: str, plural: str | None = None) -> str:
    return f"{number:,} {singular if number == 1 else plural or singular + 's'}"


def _welded(triangles: NDArray[np.float64], extent: float) -> NDArray[np.int64]:
    """Faces (F, 3) over vertices that are told apart by their place alone."""
    grid = np.round(triangles.reshape(-1, 3) / max(extent * SAME_VERTEX, 1e-300))
    _, number = np.unique(grid, axis=0, return_inverse=True)
    return np.asarray(number, dtype=np.int64).reshape(-1, 3)


def _topology(faces: NDArray[np.int64]) -> tuple[int, int, int, int, int]:
    """Parts, open edges, groups of open edges, edges of more than two triangles, repeated triangles."""
    if not len(faces):
        return 0, 0, 0, 0, 0
    distinct = np.unique(np.sort(faces, axis=1), axis=0)
    edges = np.sort(distinct[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    unique, times = np.unique(edges, axis=0, return_counts=True)
    border = unique[times == 1]
    return (
        _groups(unique),
        len(border),
        _groups(border),
        int((times > 2).sum()),
        len(faces) - len(distinct),
    )


def _groups(edges: NDArray[np.int64]) -> int:
    """Connected groups that edges (E, 2) form."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    if not len(edges):
        return 0
    nodes, number = np.unique(edges, return_inverse=True)
    pairs = number.reshape(-1, 2)
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(nodes), len(nodes)))
    count: int = connected_components(graph, directed=False)[0]
    return count
