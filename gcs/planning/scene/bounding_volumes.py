"""A bounding volume hierarchy over triangles: a binary tree of boxes, split at the median of the longest axis."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from gcs.planning.numerics.compiled import compiled

if TYPE_CHECKING:
    from numpy.typing import NDArray

LEAF_SIZE = 4
STACK_SIZE = 128
"""Enough for any tree: the median split halves, so the depth is at most log2 of the number of triangles."""

Floats = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Ints = np.ndarray[tuple[int, ...], np.dtype[np.int64]]


class BoundingVolumes(NamedTuple):
    """Nodes of the tree as arrays (a named tuple, so that kernels can take it).

    Attributes:
        low: lowest corner of each node's box, shape (M, 3).
        high: highest corner, shape (M, 3).
        first: first triangle of a leaf in `order`, or the left child of an inner node (the right one follows it).
        size: triangles in a leaf; 0 in an inner node.
        order: triangle indices, those of a leaf side by side, shape (F,).
    """

    low: NDArray[np.float64]
    high: NDArray[np.float64]
    first: NDArray[np.int64]
    size: NDArray[np.int64]
    order: NDArray[np.int64]


@compiled
def _split_at(centre: Floats, order: Ints, begin: int, end: int, middle: int, axis: int) -> None:
    """Reorder rows so that none before `middle` is larger on an axis than any from there on (Hoare's selection)."""
    low, high = begin, end - 1
    while low < high:
        a, b, c = centre[low, axis], centre[(low + high) // 2, axis], centre[high, axis]
        pivot = max(min(a, b), min(max(a, b), c))
        i, j = low, high
        while i <= j:
            while centre[i, axis] < pivot:
                i += 1
            while centre[j, axis] > pivot:
                j -= 1
            if i <= j:
                order[i], order[j] = order[j], order[i]
                for k in range(3):
                    swapped = centre[i, k]
                    centre[i, k] = centre[j, k]
                    centre[j, k] = swapped
                i += 1
                j -= 1
        if middle <= j:
            high = j
        elif middle >= i:
            low = i
        else:
            return


@compiled
def _build(triangles: Floats) -> tuple[Floats, Floats, Ints, Ints, Ints]:
    n = triangles.shape[0]
    most = 2 * n + 1
    first = np.zeros(most, np.int64)
    size = np.zeros(most, np.int64)
    order = np.arange(n)
    centre = np.empty((n, 3))
    for i in range(n):
        for k in range(3):
            a, b, c = triangles[i, 0, k], triangles[i, 1, k], triangles[i, 2, k]
            centre[i, k] = (min(a, b, c) + max(a, b, c)) / 2
    begin = np.zeros(most, np.int64)
    end = np.zeros(most, np.int64)
    end[0] = n
    made = 1
    node = 0
    while node < made:
        b, e = begin[node], end[node]
        if e - b <= LEAF_SIZE:
            first[node] = b
            size[node] = e - b
        else:
            axis = 0
            widest = -1.0
            for k in range(3):
                least, largest = np.inf, -np.inf
                for i in range(b, e):
                    least = min(least, centre[i, k])
                    largest = max(largest, centre[i, k])
                if largest - least > widest:
                    widest, axis = largest - least, k
            middle = (b + e) // 2
            _split_at(centre, order, b, e, middle, axis)
            first[node] = made
            begin[made], end[made] = b, middle
            begin[made + 1], end[made + 1] = middle, e
            made += 2
        node += 1
    node_low = np.full((made, 3), np.inf)
    node_high = np.full((made, 3), -np.inf)
    for node in range(made - 1, -1, -1):
        for k in range(3):
            if size[node] > 0:
                for i in range(first[node], first[node] + size[node]):
                    for c in range(3):
                        corner = triangles[order[i], c, k]
                        node_low[node, k] = min(node_low[node, k], corner)
                        node_high[node, k] = max(node_high[node, k], corner)
            else:
                child = first[node]
                node_low[node, k] = min(node_low[child, k], node_low[child + 1, k])
                node_high[node, k] = max(node_high[child, k], node_high[child + 1, k])
    return node_low, node_high, first[:made].copy(), size[:made].copy(), order


def build_bounding_volumes(triangles_m: NDArray[np.float64]) -> BoundingVolumes:
    """Build the tree, in time that grows as F log F.

    Args:
        triangles_m: corners, shape (F, 3, 3), F > 0.
    """
    return BoundingVolumes(*_build(np.ascontiguousarray(triangles_m, np.float64)))
