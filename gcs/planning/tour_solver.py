"""Tours on a cost matrix: exactly by dynamic programming when there are few stops, else by local search."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from gcs.planning.compiled import compiled

if TYPE_CHECKING:
    from numpy.typing import NDArray

MOST_EXACT = 12
"""Nodes up to which the tour is found by dynamic programming."""

SECONDS_PER_NODE = 1e-3
LEAST_SECONDS, MOST_SECONDS = 0.1, 1.0
LARGEST_INTEGER = 65535

Floats = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Ints = np.ndarray[tuple[int, ...], np.dtype[np.int64]]


def solve_closed_tour(costs: NDArray[np.float64], seconds: float | None = None) -> NDArray[np.int64]:
    """A short closed tour through all nodes.

    Args:
        costs: symmetric, not negative, shape (n, n), n >= 1.
        seconds: time for the local search (12 nodes and less are solved exactly, without it); grows with n from 0.1
            to 1 s when not given.

    Returns:
        The nodes in visiting order from node 0, shape (n,); of the two directions the one with the smaller second node.
    """
    n = len(costs)
    if n <= 3:
        return np.arange(n, dtype=np.int64)
    if n <= MOST_EXACT:
        order = _exact(np.ascontiguousarray(costs, dtype=np.float64))
    else:
        order = _local_search(costs, seconds or min(max(SECONDS_PER_NODE * n, LEAST_SECONDS), MOST_SECONDS))
    order = np.roll(order, -int(np.flatnonzero(order == 0)[0]))
    return order if order[1] <= order[-1] else np.concatenate([order[:1], order[:0:-1]])


def solve_open_tour(costs: NDArray[np.float64], seconds: float | None = None) -> NDArray[np.int64]:
    """A short path through all nodes with free ends, by way of a node that costs nothing to reach.

    Args:
        costs: symmetric, not negative, shape (n, n), n >= 1.
        seconds: as in `solve_closed_tour`.

    Returns:
        The nodes in visiting order, shape (n,).
    """
    return solve_closed_tour(with_free_node(costs), seconds)[1:] - 1


def with_free_node(costs: NDArray[np.float64]) -> NDArray[np.float64]:
    """The costs with a first node more that is reached for nothing: its closed tours are open ones of the rest."""
    return np.pad(costs, ((1, 0), (1, 0)))


def tour_cost(costs: NDArray[np.float64], order: NDArray[np.int64], *, closed: bool = True) -> float:
    """Cost of visiting nodes in an order, with the way back when it is closed."""
    total = float(costs[order[:-1], order[1:]].sum())
    return total + float(costs[order[-1], order[0]]) if closed else total


def _local_search(costs: NDArray[np.float64], seconds: float) -> NDArray[np.int64]:
    import fast_tsp

    largest = float(costs.max())
    scaled = np.rint(costs * (LARGEST_INTEGER / largest if largest > 0 else 1.0)).astype(np.int64)
    return np.array(fast_tsp.find_tour(scaled.tolist(), seconds, stop_when_converged=True), dtype=np.int64)


@compiled
def _exact(costs: Floats) -> Ints:
    """Held and Karp's dynamic programme (J. SIAM 10, 1962) over the sets of nodes 1 ... n - 1."""
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
