"""Tours at little cost: exactly by dynamic programming when there are few nodes, else by local search."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from gcs.planning.tours.exact_tour import MOST_EXACT, exact_tour
from gcs.planning.tours.lin_kernighan import LocalSearch
from gcs.planning.tours.tour_bound import counting_bound
from gcs.planning.tours.tour_candidates import best_candidates, candidate_graph, greedy_tour
from gcs.planning.tours.tour_costs import TourCosts

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import ArrayLike, NDArray

KICKS_PER_NODE = 4
LEAST_KICKS = 2500
MOST_RUNS = 20
"""How often the kicks are begun again for a cost that is known to be enough."""

SAME = 1e-9


def solve_tour(
    costs: TourCosts,
    *,
    seed: int = 0,
    effort: float = 1.0,
    start: NDArray[np.int64] | None = None,
    enough: float = -math.inf,
    poll: Callable[[], None] | None = None,
) -> NDArray[np.int64]:
    """A short closed tour through all nodes; the same one for the same arguments.

    Args:
        costs: between the nodes.
        seed: of the local search's random numbers.
        effort: local search in multiples of what the number of nodes asks for by itself.
        start: a tour to begin with instead of a greedy one, shape (n,).
        enough: a cost that no tour undercuts; reaching it ends the search, which goes on longer for it.
        poll: called now and then; may raise.

    Returns:
        The nodes in visiting order from node 0, shape (n,); of the two directions the one with the smaller second node.
    """
    n = len(costs)
    if n <= 3:
        return np.arange(n, dtype=np.int64)
    if n <= MOST_EXACT:
        return from_node_zero(exact_tour(costs.matrix()))
    order = greedy_tour(costs) if start is None else np.asarray(start, dtype=np.int64)
    candidates = best_candidates(candidate_graph(costs, order), poll=poll)
    search = LocalSearch(costs, candidates, order, np.random.default_rng(seed))
    search.descend()
    kicks = round(effort * max(KICKS_PER_NODE * n, LEAST_KICKS))
    best = search.order
    for _ in range(MOST_RUNS if enough > -math.inf else 1):
        search.kick(kicks, poll, enough=enough * (1 + SAME))
        if costs.of_tour(search.order) < costs.of_tour(best):
            best = search.order
        if costs.of_tour(best) <= enough * (1 + SAME):
            break
    return from_node_zero(best)


def solve_closed_tour(costs: ArrayLike, *, seed: int = 0, effort: float = 1.0) -> NDArray[np.int64]:
    """A short closed tour on a matrix of costs.

    Args:
        costs: symmetric, not negative, shape (n, n), n >= 1.
        seed: as in `solve_tour`.
        effort: as in `solve_tour`.

    Returns:
        The nodes in visiting order from node 0, shape (n,).
    """
    return solve_tour(TourCosts.of_matrix(costs), seed=seed, effort=effort)


def solve_open_tour(costs: ArrayLike, *, seed: int = 0, effort: float = 1.0) -> NDArray[np.int64]:
    """A short path with free ends on a matrix of costs, by way of a node that costs nothing to reach.

    Args:
        costs: symmetric, not negative, shape (n, n), n >= 1.
        seed: as in `solve_tour`.
        effort: as in `solve_tour`.

    Returns:
        The nodes in visiting order, shape (n,).
    """
    return solve_tour(TourCosts.of_matrix(with_free_node(costs)), seed=seed, effort=effort)[1:] - 1


def solve_point_tour(
    points: ArrayLike,
    *,
    closed: bool,
    seed: int = 0,
    effort: float = 1.0,
    poll: Callable[[], None] | None = None,
) -> NDArray[np.int64]:
    """A short tour through points in free space, without a matrix of costs.

    Args:
        points: in a space where distance is cost, shape (n, 3), n >= 1.
        closed: whether it ends where it begins.
        seed: as in `solve_tour`.
        effort: as in `solve_tour`.
        poll: called now and then; may raise.

    Returns:
        The points in visiting order, shape (n,).
    """
    counted = counting_bound(points, closed=closed)
    enough = -math.inf if counted is None else counted
    costs = TourCosts.of_points(points, free_node=not closed)
    order = solve_tour(costs, seed=seed, effort=effort, enough=enough, poll=poll)
    return order if closed else order[1:] - 1


def with_free_node(costs: ArrayLike) -> NDArray[np.float64]:
    """The costs with a first node more that is reached for nothing: its closed tours are open ones of the rest."""
    return np.pad(np.asarray(costs, dtype=np.float64), ((1, 0), (1, 0)))


def tour_cost(costs: NDArray[np.float64], order: NDArray[np.int64], *, closed: bool = True) -> float:
    """Cost of visiting nodes in an order, with the way back when it is closed."""
    return TourCosts.of_matrix(costs).of_tour(order, closed=closed)


def from_node_zero(order: NDArray[np.int64]) -> NDArray[np.int64]:
    """The same closed tour from node 0 on, in the direction with the smaller second node."""
    order = np.roll(order, -int(np.flatnonzero(order == 0)[0]))
    return order if len(order) < 3 or order[1] <= order[-1] else np.concatenate([order[:1], order[:0:-1]])
