"""How the triangles of a mesh hang together: bodies, holes, crowded edges, and which way they face."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

_HALF = np.uint64(32)


@dataclass(frozen=True)
class MeshTopology:
    """Figures of a mesh whose vertices are all different and whose triangles are all different.

    Attributes:
        parts: bodies that share no vertex with each other.
        border_edges: edges of a single triangle.
        holes: connected groups of such edges.
        crowded_edges: edges of more than two triangles.
        flipped: triangles that face the other way than most of the surface they are joined to by their edges.
    """

    parts: int = 0
    border_edges: int = 0
    holes: int = 0
    crowded_edges: int = 0
    flipped: int = 0


def mesh_topology(faces: NDArray[np.int64]) -> MeshTopology:
    """Look at how triangles, shape (F, 3), share vertices and edges."""
    if not len(faces):
        return MeshTopology()
    start, end = faces.reshape(-1), np.roll(faces, -1, axis=1).reshape(-1)
    key = (np.minimum(start, end).astype(np.uint64) << _HALF) | np.maximum(start, end).astype(np.uint64)
    order = np.argsort(key, kind="stable")
    key = key[order]
    first = np.flatnonzero(np.concatenate([[True], key[1:] != key[:-1]]))
    times = np.diff(np.append(first, len(key)))
    ends = np.stack([key[first] >> _HALF, key[first] & np.uint64(0xFFFFFFFF)], axis=1).astype(np.int64)
    border = ends[times == 1]
    one, other = order[first[times == 2]], order[first[times == 2] + 1]
    return MeshTopology(
        parts=_groups(ends),
        border_edges=len(border),
        holes=_groups(border),
        crowded_edges=int((times > 2).sum()),
        flipped=_flipped(one // 3, other // 3, start[one] == start[other], len(faces)),
    )


def _groups(edges: NDArray[np.int64]) -> int:
    """Connected groups that edges, shape (E, 2), form."""
    if not len(edges):
        return 0
    is_node = np.zeros(int(edges.max()) + 1, dtype=np.bool_)
    is_node[edges] = True
    labels = _components(edges[:, 0], edges[:, 1], len(is_node))
    return len(np.unique(labels[is_node]))


def _flipped(one: NDArray[np.int64], other: NDArray[np.int64], disagree: NDArray[np.bool_], triangles: int) -> int:
    """The fewest triangles to turn round so that neighbours agree; surfaces with one side only are left out.

    Every triangle is there twice, as it is and turned round; neighbours that agree are joined alike, those that
    disagree crosswise. A surface then comes in two copies; the triangles that are "as they are" in the copy with fewer
    of them are flipped.

    Args:
        one: triangle on one side of each shared edge, shape (E,).
        other: triangle on its other side.
        disagree: whether both run along the edge in the same direction.
        triangles: how many there are.
    """
    if not disagree.any():
        return 0
    crosswise = disagree * triangles
    low = np.concatenate([one, one + triangles])
    high = np.concatenate([other + crosswise, other + triangles - crosswise])
    labels = _components(low, high, 2 * triangles)
    as_it_is, turned = labels[:triangles], labels[triangles:]
    count = np.bincount(as_it_is, minlength=int(labels.max()) + 1)
    partner = np.empty(len(count), dtype=np.int64)
    partner[as_it_is], partner[turned] = turned, as_it_is
    kinds = np.arange(len(count))
    return int(np.minimum(count, count[partner])[kinds < partner].sum())


def _components(low: NDArray[np.int64], high: NDArray[np.int64], nodes: int) -> NDArray[np.int64]:
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    graph = coo_array((np.ones(len(low), dtype=np.int8), (low.astype(np.int32), high.astype(np.int32))), (nodes, nodes))
    return np.asarray(connected_components(graph.tocsr(), directed=False)[1], dtype=np.int64)
