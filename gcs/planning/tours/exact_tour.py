"""The cheapest tour through few nodes: dynamic programming over sets of them (M. Held, R. Karp, J. SIAM 10, 1962)."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from gcs.planning.numerics.compiled import compiled
from gcs.planning.tours.tour_costs import Floats, Ints

if TYPE_CHECKING:
    from numpy.typing import NDArray

MOST_EXACT = 12
"""Nodes up to which it is quick: time and memory double with every node more."""


def exact_tour(costs: NDArray[np.float64]) -> NDArray[np.int64]:
    """The cheapest closed tour through all nodes.

    Args:
        costs: between them, shape (n, n), n >= 2.

    Returns:
        The nodes in visiting order from node 0, shape (n,).
    """
    return np.asarray(_exact(np.ascontiguousarray(costs, dtype=np.float64)), dtype=np.int64)


@compiled
def _exact(costs: Floats) -> Ints:
    m = costs.shape[0] - 1
    best = np.full((1 << m, m), math.inf)
    before = np.full((1 << m, m), -1, np.int64)
    for j in range(m):
        best[1 << j, j] = costs[0, j + 1]
    for visited in range(1, 1 << m):
        for j in range(m):
            here = best[visited, j]
            if here == math.inf:
                continue
            for k in range(m):
                if visited & (1 << k):
                    continue
                total = here + costs[j + 1, k + 1]
                if total < best[visited | (1 << k), k]:
                    best[visited | (1 << k), k] = total
                    before[visited | (1 << k), k] = j
    visited = (1 << m) - 1
    last = 0
    for j in range(1, m):
        if best[visited, j] + costs[j + 1, 0] < best[visited, last] + costs[last + 1, 0]:
            last = j
    order = np.zeros(m + 1, np.int64)
    for place in range(m, 0, -1):
        order[place] = last + 1
        earlier = before[visited, last]
        visited ^= 1 << last
        last = earlier
    return order
