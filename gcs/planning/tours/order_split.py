"""A given visiting order cut into runs that each leave from a home and come back to it, by dynamic programming.

"Route first, cluster second" (J. E. Beasley, Omega 11, 1983): for a fixed order the cheapest cut is found exactly, as a
shortest path over the places where it may be cut.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple, Self

import numpy as np

from gcs.planning.tours.run_exchange import HOME

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class OrderCosts:
    """What the legs of a visiting order of n stops take, in any unit; what a visit takes belongs to the leg to it.

    Attributes:
        out: from home to each stop, shape (n,).
        between: from each stop to the next, shape (n - 1,).
        back: from each stop home, shape (n,).
    """

    out: NDArray[np.float64]
    between: NDArray[np.float64]
    back: NDArray[np.float64]

    @classmethod
    def of_order(cls, order: Sequence[int], leg: Callable[[int, int], float]) -> Self:
        """What the legs of an order take, given what a leg from one node to another does."""
        return cls(
            out=np.array([leg(HOME, stop) for stop in order]),
            between=np.array([leg(a, b) for a, b in itertools.pairwise(order)]),
            back=np.array([leg(stop, HOME) for stop in order]),
        )

    @cached_property
    def _along(self) -> NDArray[np.float64]:
        return np.concatenate([[0.0], np.cumsum(self.between)])

    def of_runs_to(self, last: int) -> NDArray[np.float64]:
        """Cost of leaving home for stop i, visiting all up to `last`, and coming back, for i = 0 ... last."""
        along = self._along
        return np.asarray(self.out[: last + 1] + (along[last] - along[: last + 1]) + self.back[last])

    def of_run(self, first: int, last: int) -> float:
        """Cost of one run."""
        return float(self.of_runs_to(last)[first])


class Cut(NamedTuple):
    """A run of an order.

    Attributes:
        base: number of the home that it leaves from and comes back to.
        stops: which part of the order it is.
    """

    base: int
    stops: slice


def split_order(
    costs: Sequence[OrderCosts], uses: Sequence[OrderCosts], limit: float, run_cost: float = 0.0
) -> list[Cut] | None:
    """Cut an order into runs at least cost, none of which uses more than a limit.

    Args:
        costs: what is to be small in total, for each home that a run may have.
        uses: what is limited in each run, likewise.
        limit: the most that a run may use.
        run_cost: what every run costs besides.

    Returns:
        The runs, in order; of homes that cost the same the first. None when no cut keeps the limit; where the triangle
        inequality holds, that is so only if some stop uses too much on its own from every home.
    """
    n = len(costs[0].out)
    best = np.full(n + 1, math.inf)
    best[0] = 0.0
    first_of, base_of = np.zeros(n + 1, dtype=np.int64), np.zeros(n + 1, dtype=np.int64)
    for last in range(n):
        total = np.array([best[: last + 1] + own.of_runs_to(last) + run_cost for own in costs])
        total[np.array([own.of_runs_to(last) for own in uses]) > limit] = math.inf
        base, first = divmod(int(total.argmin()), last + 1)
        first_of[last + 1], base_of[last + 1] = first, base
        best[last + 1] = total[base, first]
    if not math.isfinite(best[n]):
        return None
    runs: list[Cut] = []
    end = n
    while end > 0:
        runs.append(Cut(int(base_of[end]), slice(int(first_of[end]), end)))
        end = int(first_of[end])
    return runs[::-1]


def share_order(times: list[OrderCosts]) -> list[slice]:
    """Cut an order into as many runs as there are vehicles, each from and to a home of its own, the longest least.

    Vehicle k takes the k-th run; every vehicle has at least one stop.

    Args:
        times: for each vehicle, with its home; `between` is the same for all.

    Returns:
        The run of each vehicle, in order.

    Raises:
        ValueError: there are more vehicles than stops.
    """
    n, vehicles = len(times[0].out), len(times)
    if vehicles > n:
        raise ValueError("more vehicles than stops")
    best = np.full((vehicles + 1, n + 1), math.inf)
    first_of = np.zeros((vehicles + 1, n + 1), dtype=np.int64)
    best[0, 0] = 0.0
    for vehicle, own in enumerate(times, start=1):
        for last in range(vehicle - 1, n):
            longest = np.maximum(best[vehicle - 1, : last + 1], own.of_runs_to(last))
            first_of[vehicle, last + 1] = first = int(longest.argmin())
            best[vehicle, last + 1] = longest[first]
    runs: list[slice] = []
    end = n
    for vehicle in range(vehicles, 0, -1):
        first = int(first_of[vehicle, end])
        runs.append(slice(first, end))
        end = first
    return runs[::-1]
