"""Lower bound of the cost of tours that may each have another home."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gcs.planning.tours.tour_bound import tour_lower_bound
from gcs.planning.tours.tour_costs import TourCosts

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray


def bound_from_bases(
    least_costs: Sequence[NDArray[np.float64]], order: Sequence[int], poll: Callable[[], None] | None = None
) -> float:
    """Lower bound of visiting all stops in runs that each leave from one of several bases and come back to it.

    In the order in which they are flown, the runs are one round of all stops, in which the way from one stop to the
    next may lead by bases. That costs no less than the cheapest leg from the one stop to any base and from any base to
    the other: so no less than the cheapest round of the stops and one base, with each cost the lesser of the two.

    Args:
        least_costs: for each base, costs between its nodes or lower bounds of them, the base itself last, shape
            (N + 1, N + 1), symmetric.
        order: the stops 0 ... N - 1 in any order, the better the sooner the bound is good.
        poll: called now and then; may raise.
    """
    cheapest = np.min(least_costs, axis=0)
    to_base, between = cheapest[-1, :-1], cheapest[:-1, :-1]
    costs = np.zeros_like(cheapest)
    costs[:-1, :-1] = np.minimum(between, to_base[:, None] + to_base[None])
    costs[-1, :-1] = costs[:-1, -1] = to_base
    np.fill_diagonal(costs, 0.0)
    nodes = np.array([*order, len(to_base)], dtype=np.int64)
    return tour_lower_bound(TourCosts.of_matrix(costs), nodes, poll)
