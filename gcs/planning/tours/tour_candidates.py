"""What the local search begins with: a greedy tour, and for each node the few others that good tours join it to."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from gcs.planning.numerics.compiled import compiled
from gcs.planning.tours.one_tree import Graph, ascend, graph_of_edges, sparse_one_tree
from gcs.planning.tours.tour_costs import Floats, Ints

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from gcs.planning.tours.tour_costs import TourCosts

NEAREST = 10
"""Nearest nodes from which candidates are chosen."""

CANDIDATES = 5
STEPS = 60
STEP = 0.15
"""First step of the ascent, in mean costs to the nearest node."""


def near_edges(costs: TourCosts, count: int = NEAREST) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Edges from every node to its nearest ones, and of a node that costs nothing to reach to all.

    Returns:
        Their two ends, shape (m,) each.
    """
    n, real = len(costs), _real_nodes(costs)
    others, _ = costs.nearest(min(count, len(real) - 1), real)
    ends = np.repeat(real, others.shape[1]), others.ravel()
    if len(real) == n:
        return ends
    return np.concatenate([ends[0], np.zeros(len(real), dtype=np.int64)]), np.concatenate([ends[1], real])


def candidate_graph(costs: TourCosts, order: NDArray[np.int64], count: int = NEAREST) -> Graph:
    """The near edges and those of a closed tour, which joins all nodes."""
    a, b = near_edges(costs, count)
    return graph_of_edges(len(costs), np.concatenate([a, order]), np.concatenate([b, np.roll(order, -1)]), costs)


def best_candidates(graph: Graph, steps: int = STEPS, poll: Callable[[], None] | None = None) -> NDArray[np.int64]:
    """For each node the ends of its edges with the least alpha-nearness, nearest first.

    That is what the cheapest 1-tree would cost more if it had to have the edge, at prices that make the tree much like
    a tour (K. Helsgaun, European J. of Operational Research 126, 2000).

    Args:
        graph: near edges, connected.
        steps: of the ascent to those prices.
        poll: called now and then; may raise.

    Returns:
        Nodes, shape (n, k); a row with less than k ends with the node itself.
    """
    n = len(graph.start) - 1
    prices = np.zeros(n)
    ascend(graph, prices, steps, STEP * float(graph.cost[graph.start[:-1]].mean()), poll)
    tree = sparse_one_tree(graph, prices)
    alpha = _alpha_nearness(
        *graph, prices, tree.parent, tree.edge_cost, tree.order, np.array(tree.zero_ends), tree.zero_costs[1]
    )
    one = np.repeat(np.arange(n), np.diff(graph.start))
    # of edges with equal alpha (all of the tree's have none) the cheaper ones
    unit = max(float(graph.cost.max()), 1e-300) * 1e-9
    chosen = np.lexsort((graph.cost, np.rint(alpha / unit), one))
    rank = np.arange(len(one)) - graph.start[one]
    candidates = np.repeat(np.arange(n)[:, None], CANDIDATES, axis=1)
    costs = np.full((n, CANDIDATES), math.inf)
    few = rank < CANDIDATES
    candidates[one[few], rank[few]] = graph.other[chosen[few]]
    costs[one[few], rank[few]] = graph.cost[chosen[few]]
    return np.take_along_axis(candidates, np.argsort(costs, axis=1, kind="stable"), axis=1)


def greedy_tour(costs: TourCosts) -> NDArray[np.int64]:
    """A closed tour of the cheapest edges that leave it one: the cheapest first, among near nodes.

    Returns:
        The nodes in visiting order, shape (n,).
    """
    n, nodes = len(costs), _real_nodes(costs)
    root, degree, beside = np.arange(n), np.zeros(n, dtype=np.int64), np.full((n, 2), -1)
    real, count = nodes, NEAREST
    while True:
        others, cost = costs.nearest(min(count, len(nodes) - 1), nodes)
        a, b = np.repeat(nodes, others.shape[1]), others.ravel()
        before = int(degree.sum())
        _join(a, b, np.argsort(cost.ravel(), kind="stable"), root, degree, beside)
        if int(degree.sum()) == 2 * (len(real) - 1):
            break
        if int(degree.sum()) == before:
            count *= 2  # all the nearest ends belong to the same part
        nodes = real[degree[real] < 2]
    ends = real[degree[real] < 2]
    order = _walk(beside, int(ends[0]), len(real))
    return order if len(real) == n else np.concatenate([[0], order])


def _real_nodes(costs: TourCosts) -> NDArray[np.int64]:
    free = costs.from_points and costs.data[0, 3] == 0.0
    return np.arange(1 if free else 0, len(costs))


@compiled
def _join(a: Ints, b: Ints, by_cost: Ints, root: Ints, degree: Ints, beside: Ints) -> None:
    """Take each edge that joins the ends of two different parts; `root` leads to a node that stands for a part."""
    for e in by_cost:
        i, j = a[e], b[e]
        if degree[i] > 1 or degree[j] > 1:
            continue
        while root[i] != i:
            root[i] = root[root[i]]
            i = root[i]
        while root[j] != j:
            root[j] = root[root[j]]
            j = root[j]
        if i == j:
            continue
        root[i] = j
        for here, there in ((a[e], b[e]), (b[e], a[e])):
            beside[here, degree[here]] = there
            degree[here] += 1


@compiled
def _walk(beside: Ints, start: int, n: int) -> Ints:
    order = np.empty(n, np.int64)
    before, node = -1, start
    for i in range(n):
        order[i] = node
        following = beside[node, 0] if beside[node, 0] != before else beside[node, 1]
        before, node = node, following
    return order


@compiled
def _alpha_nearness(
    start: Ints,
    other: Ints,
    cost: Floats,
    prices: Floats,
    parent: Ints,
    edge_cost: Floats,
    order: Ints,
    zero_ends: Ints,
    second_at_zero: float,
) -> Floats:
    """Of each edge of the graph: its cost less that of the dearest edge of the tree's way between its ends."""
    n = len(prices)
    depth = np.zeros(n, np.int64)
    for node in order[1:]:
        depth[node] = depth[parent[node]] + 1
    alpha = np.empty(len(other))
    for i in range(n):
        for e in range(start[i], start[i + 1]):
            j = other[e]
            c = cost[e] + prices[i] + prices[j]
            a, b, dearest = i, j, -math.inf
            if i == 0 or j == 0:
                end = max(i, j)
                dearest = c if end == zero_ends[0] or end == zero_ends[1] else second_at_zero
                a = b
            while a != b:
                if depth[a] < depth[b]:
                    a, b = b, a
                dearest = max(dearest, edge_cost[a])
                a = parent[a]
            alpha[e] = c - dearest
    return alpha
