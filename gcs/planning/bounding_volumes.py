"""A bounding volume hierarchy over triangles: a binary tree of boxes, split at the median of the longest axis."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from gcs.planning.compiled import compiled

if TYPE_CHECKING:
    from numpy.typing import NDArray

LEAF_SIZE = 4
STACK_SIZE = 128
"""Enough for any tree: the median split halves, so the depth is at most log2 of the number of triangles."""


class BoundingVolumes(NamedTuple):
    """Nodes of the tree as arrays (a named tuple, so that kernels can take it).

    Attributes:
        low: lowest corner of each node's box, shape (M, 3).
        high: highest corner, shape (M, 3).
        first: first primitive of a leaf in `order`, or the left child of an inner node (the right one follows it).
        size: primitives in a leaf; 0 in an inner node.
        order: primitive indices, those of a leaf side by side, shape (F,).
    """

    low: NDArray[np.float64]
    high: NDArray[np.float64]
    first: NDArray[np.int64]
    size: NDArray[np.int64]
    order: NDArray[np.int64]


@compiled
def _build(
    low: NDArray[np.float64], high: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    n = low.shape[0]
    most = 2 * n + 1
    node_low = np.empty((most, 3))
    node_high = np.empty((most, 3))
    first = np.zeros(most, np.int64)
    size = np.zeros(most, np.int64)
    order = np.arange(n)
    centre = (low + high) / 2
    begin = np.zeros(most, np.int64)
    end = np.zeros(most, np.int64)
    end[0] = n
    made = 1
    node = 0
    while node < made:
        b, e = begin[node], end[node]
        centre_low = np.full(3, np.inf)
        centre_high = np.full(3, -np.inf)
        for k in range(3):
            node_low[node, k] = np.inf
            node_high[node, k] = -np.inf
        for i in range(b, e):
            p = order[i]
            for k in range(3):
                node_low[node, k] = min(node_low[node, k], low[p, k])
                node_high[node, k] = max(node_high[node, k], high[p, k])
                centre_low[k] = min(centre_low[k], centre[p, k])
                centre_high[k] = max(centre_high[k], centre[p, k])
        if e - b <= LEAF_SIZE:
            first[node] = b
            size[node] = e - b
        else:
            axis = 0
            for k in range(1, 3):
                if centre_high[k] - centre_low[k] > centre_high[axis] - centre_low[axis]:
                    axis = k
            keys = np.empty(e - b)
            for i in range(b, e):
                keys[i - b] = centre[order[i], axis]
            order[b:e] = order[b:e][np.argsort(keys)]
            middle = (b + e) // 2
            first[node] = made
            begin[made], end[made] = b, middle
            begin[made + 1], end[made + 1] = middle, e
            made += 2
        node += 1
    return node_low[:made].copy(), node_high[:made].copy(), first[:made].copy(), size[:made].copy(), order


def build_bounding_volumes(low: NDArray[np.float64], high: NDArray[np.float64]) -> BoundingVolumes:
    """Build the tree.

    Args:
        low: lowest corner of every primitive's box, shape (F, 3), F > 0.
        high: highest corner, shape (F, 3).
    """
    return BoundingVolumes(*_build(np.ascontiguousarray(low, np.float64), np.ascontiguousarray(high, np.float64)))
