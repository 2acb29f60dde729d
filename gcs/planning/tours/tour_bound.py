"""Proven lower bounds of the cost of tours: Held and Karp's 1-tree ascent, and the counting bound on grids.

The ascent runs on a sparse graph of near edges, where a step takes microseconds. What counts is the cheapest 1-tree
of the complete graph at the prices found: it bounds every tour, whatever edges the sparse graph lacks. The edges that
it has and the sparse graph had not are added, and the ascent goes on. Of few nodes the cheapest tour itself is the
bound.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from gcs.planning.tours.exact_tour import MOST_EXACT, exact_tour
from gcs.planning.tours.one_tree import ascend, complete_one_tree, graph_of_edges
from gcs.planning.tours.tour_candidates import candidate_graph

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import ArrayLike, NDArray

    from gcs.planning.tours.one_tree import OneTree
    from gcs.planning.tours.tour_costs import TourCosts

ROUNDS = 6
EDGE_STEPS = 4e7
"""Edges looked at in all steps of the first round together, which bounds its time."""

LEAST_STEPS, MOST_STEPS = 1000, 3000
STEP = 0.1
"""First step of the first round's ascent, in mean costs of the near edges."""

CLOSE = 1e-6
"""The rounds end when the complete graph's bound is as near to the sparse graph's."""

ON_GRID = 1e-9
"""Share of the extent, or of the pitch, by which a grid's nodes may be off their places."""


def tour_lower_bound(costs: TourCosts, order: NDArray[np.int64], poll: Callable[[], None] | None = None) -> float:
    """Lower bound of the cost of every closed tour.

    Args:
        costs: between the nodes, or lower bounds of them.
        order: any tour, the better the sooner the bound is good, shape (n,), n >= 1.
        poll: called now and then; may raise.

    Returns:
        The bound, in the unit of the costs; never above the cost of the tour given.
    """
    n, known = len(costs), costs.of_tour(order)
    if n <= 3:
        return known
    if n <= MOST_EXACT:
        return min(costs.of_tour(exact_tour(costs.matrix())), known)
    graph = candidate_graph(costs, order)
    prices = np.zeros(n)
    steps = int(min(max(EDGE_STEPS / len(graph.other), LEAST_STEPS), MOST_STEPS))
    step = STEP * float(graph.cost.mean())
    best = -math.inf
    for turn in range(ROUNDS):
        reached = ascend(graph, prices, max(steps >> turn, LEAST_STEPS // 4), step * 0.5**turn, poll)
        tree = complete_one_tree(costs, prices)
        best = max(best, tree.bound)
        if reached - tree.bound <= CLOSE * abs(reached) or known - best <= CLOSE * known:
            break
        one = np.repeat(np.arange(n), np.diff(graph.start))
        more = _edges(tree)
        graph = graph_of_edges(n, np.concatenate([one, more[0]]), np.concatenate([graph.other, more[1]]), costs)
    return min(best, known)


def _edges(tree: OneTree) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    nodes = tree.order[1:]
    ends = np.array(tree.zero_ends)
    return np.concatenate([nodes, ends]), np.concatenate([tree.parent[nodes], np.zeros(2, dtype=np.int64)])


def counting_bound(points: ArrayLike, *, closed: bool) -> float | None:
    """Lower bound of the length of every tour through all nodes of a full rectangular grid.

    With pitches p <= q, N nodes and L lines of nodes along p, every edge is at least p long, and one that leads j lines
    on at least `j q >= p + j (q - p)`. An open tour has N - 1 edges and gets past each of the L - 1 gaps between lines
    once or more, a closed one has N and gets past them twice. Lines flown to and fro reach it.

    Args:
        points: in a space where distance is cost, shape (N, 3).
        closed: whether the way back counts.

    Returns:
        The bound, or None when the points are not such a grid.
    """
    given = np.asarray(points, dtype=np.float64).reshape(-1, 3)
    pitches = []
    cells = np.zeros((len(given), 0), dtype=np.int64)
    for values in given.T:
        steps = np.diff(np.sort(values))
        steps = steps[steps > ON_GRID * max(float(np.ptp(values)), 1e-300)]
        if not len(steps):
            continue
        pitch = np.ptp(values) / len(steps)
        cell = (values - values.min()) / pitch
        if np.abs(cell - np.rint(cell)).max() > ON_GRID:
            return None
        pitches.append(float(pitch))
        cells = np.column_stack([cells, np.rint(cell).astype(np.int64)])
    if len(pitches) != 2 or len(np.unique(cells, axis=0)) != len(given):
        return None
    counts = cells.max(axis=0) + 1
    if int(counts.prod()) != len(given):
        return None
    (short, _), (long, lines) = sorted(zip(pitches, counts.tolist(), strict=True))
    gaps = (lines - 1) * (2 if closed else 1)
    return float((len(given) - (0 if closed else 1)) * short + gaps * (long - short))
