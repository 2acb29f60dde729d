"""A proven lower bound of the cost of closed tours: Held and Karp's 1-tree ascent.

A 1-tree is a spanning tree over all nodes but the first, with the first joined to its two nearest. Every tour is one,
so the cheapest 1-tree costs no more than the cheapest tour. With a price p_i on every node, edges cost
`c_ij + p_i + p_j` and every tour 2 sum(p) more, so that `cheapest 1-tree - 2 sum(p)` is a bound for any prices; they
are raised where the tree has more than two edges (M. Held, R. M. Karp, Math. Programming 1, 1971; step sizes as by
Polyak, towards the cost of a known tour).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from gcs.planning.compiled import compiled

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

ROUNDS = 4000
MOST_STEPS = 4e8
"""Node pairs looked at in all rounds together, which bounds the time for large tours."""

PATIENCE = 40
WORTHWHILE = 1e-7
SMALLEST_STEP = 1e-4
MEMORY = 0.95
"""Share of the last direction in the next: carries prices along where many trees cost the same, as on grids."""

Floats = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Ints = np.ndarray[tuple[int, ...], np.dtype[np.int64]]


def tour_lower_bound(costs: NDArray[np.float64], upper_bound: float, poll: Callable[[], None] | None = None) -> float:
    """Lower bound of the cost of every closed tour.

    Args:
        costs: symmetric lower bounds of the costs between nodes, shape (n, n), n >= 1.
        upper_bound: cost of a known tour, to scale the steps; the bound holds whatever it is.
        poll: called now and then; may raise.

    Returns:
        The bound, in the unit of the costs.
    """
    n = len(costs)
    if n <= 3:
        return float(costs[np.arange(n), np.arange(1, n + 1) % n].sum())
    costs = np.ascontiguousarray(costs, dtype=np.float64)
    prices, direction = np.zeros(n), np.zeros(n)
    best, step, since_better = -math.inf, 1.0, 0
    degree = np.empty(n, dtype=np.int64)
    for _ in range(int(min(ROUNDS, MOST_STEPS / n**2)) + 1):
        if poll:
            poll()
        bound = _cheapest_one_tree(costs, prices, degree) - 2 * float(prices.sum())
        if bound > best + WORTHWHILE * abs(best) or best == -math.inf:
            best, since_better = bound, 0
        else:
            best, since_better = max(best, bound), since_better + 1
        excess = degree - 2
        if not excess.any():
            break  # the tree is a tour
        direction = excess + MEMORY * direction
        if since_better >= PATIENCE:
            step, since_better = step / 2, 0
            if step < SMALLEST_STEP:
                break
        missing = max(upper_bound - bound, 1e-4 * abs(upper_bound))
        prices += step * missing / max(float(direction @ direction), 1.0) * direction
    return best


@compiled
def _cheapest_one_tree(costs: Floats, prices: Floats, degree: Ints) -> float:
    """Cost of the cheapest 1-tree at the prices, by Prim's method; `degree` takes the edges of each node."""
    n = costs.shape[0]
    degree[:] = 0
    near = np.full(n, math.inf)
    parent = np.ones(n, np.int64)
    done = np.zeros(n, np.bool_)
    total = 0.0
    node = 1
    for _ in range(n - 2):
        done[node] = True
        following = -1
        for j in range(2, n):
            if done[j]:
                continue
            cost = costs[node, j] + prices[node] + prices[j]
            if cost < near[j]:
                near[j] = cost
                parent[j] = node
            if following < 0 or near[j] < near[following]:
                following = j
        node = following
        total += near[node]
        degree[node] += 1
        degree[parent[node]] += 1
    first, second = 1, 2
    if costs[0, 2] + prices[2] < costs[0, 1] + prices[1]:
        first, second = 2, 1
    for j in range(3, n):
        cost = costs[0, j] + prices[j]
        if cost < costs[0, first] + prices[first]:
            first, second = j, first
        elif cost < costs[0, second] + prices[second]:
            second = j
    degree[0] = 2
    degree[first] += 1
    degree[second] += 1
    return float(total + costs[0, first] + costs[0, second] + prices[first] + prices[second] + 2.0 * prices[0])
