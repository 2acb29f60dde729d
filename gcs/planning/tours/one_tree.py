"""Cheapest 1-trees with prices on the nodes, on a sparse graph and on the complete one.

A 1-tree is a spanning tree over all nodes but node 0, and two edges at node 0. Every tour is one, so the cheapest
1-tree costs no more than the cheapest tour. With a price p_i on every node an edge costs `c_ij + p_i + p_j` and every
tour 2 sum(p) more, so that `cheapest 1-tree - 2 sum(p)` is a bound for any prices (M. Held, R. M. Karp, Math.
Programming 1, 1971). The prices are raised where the tree has more than two edges and lowered where it has one.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from gcs.planning.numerics.compiled import compiled
from gcs.planning.tours.tour_costs import Floats, Ints, TourCosts, pair_cost

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

MOMENTUM = 0.3
"""Share of the last direction in the next, as in K. Helsgaun, European J. of Operational Research 126, 2000."""

STEPS_AT_ONCE = 2e6
"""Edges looked at between two questions whether to go on."""

UNSEEN, DONE = -1, -2


class Graph(NamedTuple):
    """Candidate edges in compressed rows: those of node i are `start[i]` to `start[i + 1]`, by ascending cost."""

    start: NDArray[np.int64]
    other: NDArray[np.int64]
    cost: NDArray[np.float64]


class OneTree(NamedTuple):
    """A cheapest 1-tree.

    Attributes:
        bound: its cost at the prices, less twice the prices.
        parent: the tree's edges: of each node but 0 and the tree's root the node before it; shape (n,), else -1.
        edge_cost: cost at the prices of each of those edges, shape (n,).
        order: nodes but 0 in the order in which they joined the tree, shape (n - 1,).
        zero_ends: the two nodes that are joined to node 0, the nearer first.
        zero_costs: costs at the prices of these two edges.
        degree: edges at each node, shape (n,).
    """

    bound: float
    parent: NDArray[np.int64]
    edge_cost: NDArray[np.float64]
    order: NDArray[np.int64]
    zero_ends: tuple[int, int]
    zero_costs: tuple[float, float]
    degree: NDArray[np.int64]


def graph_of_edges(n: int, a: NDArray[np.int64], b: NDArray[np.int64], costs: TourCosts) -> Graph:
    """The graph over n nodes with the given edges (in either direction, doubled or not)."""
    low, high = np.minimum(a, b), np.maximum(a, b)
    code = np.unique(low[low != high] * n + high[low != high])
    low, high = code // n, code % n
    cost = _costs_of_pairs(costs.data, costs.from_points, low, high)
    one, other, both = np.concatenate([low, high]), np.concatenate([high, low]), np.concatenate([cost, cost])
    order = np.lexsort((both, one))
    start = np.zeros(n + 1, dtype=np.int64)
    np.cumsum(np.bincount(one, minlength=n), out=start[1:])
    return Graph(start, other[order], both[order])


def sparse_one_tree(graph: Graph, prices: NDArray[np.float64]) -> OneTree:
    """The cheapest 1-tree of a connected sparse graph (no bound for tours that use other edges)."""
    n = len(prices)
    tree = _new_tree(n)
    bound = _sparse(*graph, prices, *tree)
    return _one_tree(bound, *tree)


def complete_one_tree(costs: TourCosts, prices: NDArray[np.float64]) -> OneTree:
    """The cheapest 1-tree of the complete graph: its bound holds for every tour. Takes O(n^2) time and O(n) memory."""
    n = len(prices)
    tree = _new_tree(n)
    bound = _complete(costs.data, costs.from_points, prices, *tree)
    return _one_tree(bound, *tree)


def ascend(
    graph: Graph, prices: NDArray[np.float64], steps: int, step: float, poll: Callable[[], None] | None = None
) -> float:
    """Raise the bound of the sparse graph's cheapest 1-tree by the subgradient method, with steps falling to nothing.

    Args:
        graph: connected.
        prices: to begin with, shape (n,); the best ones found are left in it.
        steps: how many.
        step: length of the first.
        poll: called now and then; may raise.

    Returns:
        The highest bound found.
    """
    n = len(prices)
    tree = _new_tree(n)
    best_prices, direction = prices.copy(), np.zeros(n)
    best = -math.inf
    at_once = max(1, int(STEPS_AT_ONCE / len(graph.other)))
    for begin in range(0, steps, at_once):
        if poll:
            poll()
        end = min(begin + at_once, steps)
        best = _ascend(*graph, prices, best_prices, direction, best, begin, end, steps, step, *tree)
    prices[:] = best_prices
    return best


def _new_tree(n: int) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.int64], Ints, Floats, Ints]:
    ints, floats = np.empty((4, n), dtype=np.int64), np.empty((1, n))
    return ints[0], floats[0], ints[1][: n - 1], np.zeros(2, dtype=np.int64), np.zeros(2), ints[2]


def _one_tree(
    bound: float, parent: Ints, key: Floats, order: Ints, zero_ends: Ints, zero_costs: Floats, degree: Ints
) -> OneTree:
    ends, costs = (int(zero_ends[0]), int(zero_ends[1])), (float(zero_costs[0]), float(zero_costs[1]))
    return OneTree(float(bound), parent, key, order, ends, costs, degree)


@compiled
def _costs_of_pairs(data: Floats, from_points: bool, a: Ints, b: Ints) -> Floats:
    costs = np.empty(len(a))
    for i in range(len(a)):
        costs[i] = pair_cost(data, from_points, a[i], b[i])
    return costs


@compiled
def _ascend(
    start: Ints,
    other: Ints,
    cost: Floats,
    prices: Floats,
    best_prices: Floats,
    direction: Floats,
    best: float,
    begin: int,
    end: int,
    steps: int,
    first_step: float,
    parent: Ints,
    key: Floats,
    order: Ints,
    zero_ends: Ints,
    zero_costs: Floats,
    degree: Ints,
) -> float:
    for turn in range(begin, end):
        bound = _sparse(start, other, cost, prices, parent, key, order, zero_ends, zero_costs, degree)
        if bound > best:
            best = bound
            best_prices[:] = prices
        step = first_step * (1.0 - turn / steps)
        for i in range(len(prices)):
            excess = degree[i] - 2.0
            prices[i] += step * ((1.0 - MOMENTUM) * excess + MOMENTUM * direction[i])
            direction[i] = excess
    return best


@compiled
def _sparse(
    start: Ints,
    other: Ints,
    cost: Floats,
    prices: Floats,
    parent: Ints,
    key: Floats,
    order: Ints,
    zero_ends: Ints,
    zero_costs: Floats,
    degree: Ints,
) -> float:
    """Prim's method with a binary heap of nodes (`place` is where in it a node is)."""
    n = len(prices)
    key[:] = math.inf
    parent[:] = -1
    degree[:] = 0
    place = np.full(n, UNSEEN)
    heap_key, heap_node = np.empty(n), np.empty(n, np.int64)
    total, size, node = 0.0, 0, 1
    place[1] = DONE
    key[1] = -math.inf
    for joined in range(n - 1):
        order[joined] = node
        for e in range(start[node], start[node + 1]):
            j = other[e]
            if j == 0 or place[j] == DONE:
                continue
            c = cost[e] + prices[node] + prices[j]
            if c >= key[j]:
                continue
            key[j] = c
            parent[j] = node
            hole = place[j]
            if hole == UNSEEN:
                hole = size
                size += 1
            while hole > 0 and heap_key[(hole - 1) >> 1] > c:
                above = (hole - 1) >> 1
                heap_key[hole], heap_node[hole] = heap_key[above], heap_node[above]
                place[heap_node[hole]] = hole
                hole = above
            heap_key[hole], heap_node[hole] = c, j
            place[j] = hole
        if size == 0:
            break
        node = heap_node[0]
        place[node] = DONE
        total += heap_key[0]
        degree[node] += 1
        degree[parent[node]] += 1
        size -= 1
        c, j = heap_key[size], heap_node[size]
        hole = 0
        while 2 * hole + 1 < size:
            below = 2 * hole + 1
            if below + 1 < size and heap_key[below + 1] < heap_key[below]:
                below += 1
            if heap_key[below] >= c:
                break
            heap_key[hole], heap_node[hole] = heap_key[below], heap_node[below]
            place[heap_node[hole]] = hole
            hole = below
        if size > 0:
            heap_key[hole], heap_node[hole] = c, j
            place[j] = hole
    zero_costs[:] = math.inf
    for e in range(start[0], start[1]):
        _offer_to_zero(other[e], cost[e] + prices[0] + prices[other[e]], zero_ends, zero_costs)
    return _with_node_zero(total, prices, zero_ends, zero_costs, degree)


@compiled
def _complete(
    data: Floats,
    from_points: bool,
    prices: Floats,
    parent: Ints,
    key: Floats,
    order: Ints,
    zero_ends: Ints,
    zero_costs: Floats,
    degree: Ints,
) -> float:
    """Prim's method on all pairs; the nodes that are left stand at the front of `left`."""
    n = len(prices)
    key[:] = math.inf
    parent[:] = -1
    degree[:] = 0
    left = np.arange(2, n)
    total, node = 0.0, 1
    key[1] = -math.inf
    order[0] = 1
    for remaining in range(n - 2, 0, -1):
        nearest = 0
        for place in range(remaining):
            j = left[place]
            c = pair_cost(data, from_points, node, j) + prices[node] + prices[j]
            if c < key[j]:
                key[j] = c
                parent[j] = node
            if key[j] < key[left[nearest]]:
                nearest = place
        node = left[nearest]
        left[nearest] = left[remaining - 1]
        order[n - 1 - remaining] = node
        total += key[node]
        degree[node] += 1
        degree[parent[node]] += 1
    zero_costs[:] = math.inf
    for j in range(1, n):
        _offer_to_zero(j, pair_cost(data, from_points, 0, j) + prices[0] + prices[j], zero_ends, zero_costs)
    return _with_node_zero(total, prices, zero_ends, zero_costs, degree)


@compiled
def _offer_to_zero(node: int, cost: float, zero_ends: Ints, zero_costs: Floats) -> None:
    if cost < zero_costs[0]:
        zero_ends[1], zero_costs[1] = zero_ends[0], zero_costs[0]
        zero_ends[0], zero_costs[0] = node, cost
    elif cost < zero_costs[1]:
        zero_ends[1], zero_costs[1] = node, cost


@compiled
def _with_node_zero(total: float, prices: Floats, zero_ends: Ints, zero_costs: Floats, degree: Ints) -> float:
    degree[0] = 2
    degree[zero_ends[0]] += 1
    degree[zero_ends[1]] += 1
    return float(total + zero_costs[0] + zero_costs[1] - 2.0 * prices.sum())
