"""A coarser mesh with a proven error, for what only needs to know about where the surface is.

Vertex clustering (Rossignac and Borrel 1993): vertices in one cube of a grid become one. A point of a triangle moves by
at most as much as the corner that moves most, and everything that a triangle turns into is kept, also when it is only a
line or a point. So every point of the full surface is within the largest move of the simplified one, and the other way
round: the Hausdorff distance is bounded by construction.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from gcs.core.structure import Structure

WORTHWHILE_TRIANGLES = 200_000
"""Smaller meshes are planned with as they are."""

WORTHWHILE_SHARE = 0.5
"""A simplified mesh of more than this share of the triangles is not worth its error."""

PLANNING_ERROR_M = 0.05
"""How far the planner lets surface move; an order below what its distance grid loses anyway."""

MOST_CELLS = 2.0**62
ROUNDING_M = 1e-9


@dataclass(frozen=True, eq=False)
class SimplifiedMesh:
    """A structure and how far it may be from the full one.

    Attributes:
        structure: the same cables; faces may be lines or points (two or three corners in one place), where full
            triangles were smaller than a cube of the grid.
        error_m: no point of the full triangles is further than this from the simplified ones, nor the other way round.
        full_triangles: how many there were.
    """

    structure: Structure
    error_m: float
    full_triangles: int


def simplify(structure: Structure, error_m: float) -> SimplifiedMesh:
    """Cluster the vertices of a structure.

    Args:
        structure: triangles and cables; the cables stay.
        error_m: how far any surface may move; what it really moved is in the result, and at most that.

    Raises:
        ValueError: the error is not positive, or so small for the structure that cubes cannot be numbered.
    """
    if not error_m > 0:
        raise ValueError("error_m must be positive")
    number, places, moved = _cluster(structure.vertices_m, 2 * error_m / math.sqrt(3.0))
    faces = _distinct_faces(number[structure.faces], len(places))
    simplified = replace(structure, vertices_m=places, faces=faces)
    return SimplifiedMesh(simplified, moved + ROUNDING_M, len(structure.faces))


def planning_mesh(structure: Structure, error_m: float) -> SimplifiedMesh:
    """The structure simplified where that is worth it, else as it is with no error; arguments as for `simplify`."""
    as_it_is = SimplifiedMesh(structure, 0.0, len(structure.faces))
    if len(structure.faces) <= WORTHWHILE_TRIANGLES:
        return as_it_is
    simplified = simplify(structure, error_m)
    is_worth_it = len(simplified.structure.faces) <= WORTHWHILE_SHARE * len(structure.faces)
    return simplified if is_worth_it else as_it_is


def _cluster(vertices_m: NDArray[np.float64], edge_m: float) -> tuple[NDArray[np.int64], NDArray[np.float64], float]:
    """The cluster of each vertex (V,), the clusters' places (K, 3), and the farthest that a vertex is from its place.

    A place is the middle of the box about its vertices, so no vertex is further from it than half a cube's diagonal.
    """
    low = vertices_m.min(axis=0)
    cells = np.floor((vertices_m - low) / edge_m)
    counts = cells.max(axis=0) + 1
    if not np.prod(counts) < MOST_CELLS:
        raise ValueError("error_m is too small for a structure of this size")
    _, nx, ny = (int(c) for c in counts)
    cell = cells.astype(np.int64)
    key = (cell[:, 0] * nx + cell[:, 1]) * ny + cell[:, 2]
    order = np.argsort(key, kind="stable")
    is_new = np.ones(len(key), dtype=np.bool_)
    np.not_equal(key[order[1:]], key[order[:-1]], out=is_new[1:])
    first = np.flatnonzero(is_new)
    number = np.empty(len(key), dtype=np.int64)
    number[order] = np.cumsum(is_new) - 1
    in_order = vertices_m[order]
    places = (np.minimum.reduceat(in_order, first, axis=0) + np.maximum.reduceat(in_order, first, axis=0)) / 2
    moved = float(np.linalg.norm(vertices_m - places[number], axis=1).max())
    return number, places, moved


def _distinct_faces(faces: NDArray[np.int64], vertices: int) -> NDArray[np.int64]:
    """Triangles, then lines that are no triangle's edge, then points that are nobody's corner, each once, (F, 3)."""
    corners = np.sort(faces, axis=1)
    distinct = 1 + (corners[:, 1:] != corners[:, :-1]).sum(axis=1)
    triangles = _once(corners[distinct == 3], vertices)
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [0, 2]]])
    two = corners[distinct == 2]
    lines = np.setdiff1d(two[:, 0] * vertices + two[:, 2], edges[:, 0] * vertices + edges[:, 1])
    ends = np.stack([lines // vertices, lines % vertices, lines % vertices], axis=1)
    is_corner = np.zeros(vertices, dtype=np.bool_)
    is_corner[triangles] = True
    is_corner[ends] = True
    lonely = np.zeros(vertices, dtype=np.bool_)
    lonely[corners[distinct == 1, 0]] = True
    points = np.flatnonzero(lonely & ~is_corner)
    return np.concatenate([triangles, ends, np.repeat(points[:, None], 3, axis=1)])


def _once(corners: NDArray[np.int64], vertices: int) -> NDArray[np.int64]:
    """Each triangle once, corners ascending, (F, 3): sorted by its two last corners, then by the first."""
    pair = corners[:, 1] * vertices + corners[:, 2]
    order = np.lexsort((corners[:, 0], pair))
    pair, first = pair[order], corners[order, 0]
    is_new = np.ones(len(order), dtype=np.bool_)
    is_new[1:] = (pair[1:] != pair[:-1]) | (first[1:] != first[:-1])
    return corners[order[is_new]]
