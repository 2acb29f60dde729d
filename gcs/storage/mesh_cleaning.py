"""Triangles without what is of no use: copies of vertices and of triangles, and triangles without area."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

SLIVER = 1e-9
"""A triangle whose height is less than this share of its longest side is a line."""

AT_A_TIME = 200_000
"""Triangles looked at together; bounds the memory."""

_ODD = (0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9)
_HALF = np.uint64(32)


@dataclass(frozen=True, eq=False)
class CleanMesh:
    """What is left, and what was dropped.

    Attributes:
        vertices: all different and all used, shape (V, 3).
        faces: shape (F, 3).
        degenerate: triangles dropped because they are only a line or a point.
        duplicates: triangles dropped because they repeat another one, whichever way round.
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]
    degenerate: int
    duplicates: int


def clean_mesh(vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> CleanMesh:
    """Weld equal vertices, and drop degenerate and repeated triangles; the order of the others stays.

    Args:
        vertices: finite where they are used, shape (V, 3).
        faces: shape (F, 3).
    """
    kept, number = distinct_rows(np.ascontiguousarray(vertices + 0.0).view(np.uint64))  # + 0.0: -0 is 0
    welded = number[faces]
    vertices = vertices[kept]
    flat = is_degenerate(vertices, welded)
    solid = welded[~flat]
    first, _ = distinct_rows(np.sort(solid, axis=1).view(np.uint64))
    if len(first) < len(solid):
        solid = solid[first]
    vertices, solid = _only_used(vertices, solid)
    degenerate = int(flat.sum())
    return CleanMesh(vertices, solid, degenerate, len(faces) - degenerate - len(solid))


def is_degenerate(vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Triangles that are only a line or a point, vertices (V, 3), faces (F, 3) -> (F,)."""
    result = np.empty(len(faces), dtype=np.bool_)
    for begin in range(0, len(faces), AT_A_TIME):
        part = slice(begin, begin + AT_A_TIME)
        a, b, c = (vertices[faces[part, k]] for k in range(3))
        ab, bc, ca = b - a, c - b, a - c
        longest_squared = np.maximum(np.maximum(_squared(ab), _squared(bc)), _squared(ca))
        doubled_area_squared = _squared(np.cross(ab, bc))
        result[part] = doubled_area_squared <= (SLIVER * longest_squared) ** 2
    return result


def distinct_rows(rows: NDArray[np.uint64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Tell equal rows of three numbers, shape (N, 3).

    Returns:
        The first row of every kind, ascending, shape (K,), and for every row its kind as an index into these, shape
        (N,).
    """
    key = np.zeros(len(rows), dtype=np.uint64)
    for k in range(3):  # a mix that spreads well; equality is checked below
        key ^= rows[:, k]
        key *= np.uint64(_ODD[k])
        key ^= key >> _HALF
    order = np.argsort(key, kind="stable")
    in_order = key[order]
    is_new = np.ones(len(rows), dtype=np.bool_)
    np.not_equal(in_order[1:], in_order[:-1], out=is_new[1:])
    first = order[is_new]
    number = np.empty(len(rows), dtype=np.int64)
    number[order] = np.cumsum(is_new) - 1
    if not all(np.array_equal(rows[first, k][number], rows[:, k]) for k in range(3)):  # two kinds with one key
        _, first, number = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    by_place = np.argsort(first)
    rank = np.empty(len(first), dtype=np.int64)
    rank[by_place] = np.arange(len(first))
    return first[by_place].astype(np.int64), rank[number.reshape(-1)]


def _squared(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(np.einsum("ij,ij->i", vectors, vectors))


def _only_used(
    vertices: NDArray[np.float64], faces: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Without loose vertices, which may be anything, even NaN."""
    is_used = np.zeros(len(vertices), dtype=np.bool_)
    is_used[faces] = True
    if is_used.all():
        return vertices, faces
    number = np.cumsum(is_used) - 1
    return vertices[is_used], number[faces]
