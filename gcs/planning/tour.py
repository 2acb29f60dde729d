"""The tour: in which order the stops are visited from home and back, over the paths that the search finds.

Paths are searched only where they are needed. A cost matrix starts with straight lines, which no path undercuts; the
tour over it is found, the paths of its edges are searched and put in the matrix, and the tour is found again, until
all edges of the tour are searched ones.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

from gcs.core.errors import InfeasibleError
from gcs.core.progress import SilentProgress
from gcs.planning.grid_search import GridSearch
from gcs.planning.path_search import find_path
from gcs.planning.string_pulling import path_length
from gcs.planning.tour_bound import tour_lower_bound
from gcs.planning.tour_costs import TourCosts
from gcs.planning.tour_solver import solve_closed_tour, tour_cost

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike, NDArray

    from gcs.core.progress import Progress
    from gcs.core.scenario import PlannerOptions
    from gcs.planning.free_space import FreeSpace

MOST_ROUNDS = 40
HURRIED_EFFORT = 0.2
FEW = 20
"""Nodes up to which a whole effort costs nothing."""


class LegTime(Protocol):
    """Time of legs from rest to rest."""

    def __call__(self, length_m: NDArray[np.float64], /) -> NDArray[np.float64]:
        """Times (s) of legs of the given lengths (m), any shape; grows with the length."""
        ...


@dataclass(frozen=True, eq=False)
class Tour:
    """A closed tour from home through all stops.

    Attributes:
        order: stops in visiting order, shape (N,).
        legs_m: N + 1 free paths (K, 3): home to the first stop, ..., the last stop to home; the first starts and the
            last ends with the vertical column over home.
        cost: sum of the legs' costs in the metric.
        lower_bound: no order of the stops costs less, with legs as this search finds them.
        metric: `length` (m) or `time` (s).
        searched: how many paths were searched.
    """

    order: NDArray[np.int64]
    legs_m: list[NDArray[np.float64]]
    cost: float
    lower_bound: float
    metric: str
    searched: int


def find_tour(
    space: FreeSpace,
    home_m: ArrayLike,
    stops_m: ArrayLike,
    options: PlannerOptions,
    leg_time: LegTime,
    progress: Progress | None = None,
    *,
    names: Sequence[str] | None = None,
    prefer_open_sky: bool = True,
) -> Tour:
    """Find a short tour from home through all stops and back.

    Args:
        space: where the centre may be.
        home_m: where the tour starts and ends, shape (3,).
        stops_m: places to visit, shape (N, 3), N >= 1.
        options: metric, and whether the given order is kept.
        leg_time: for the metric `time`.
        progress: told about the stage `tour`.
        names: of the stops, for messages.
        prefer_open_sky: as in `find_path`.

    Raises:
        InfeasibleError: a stop cannot be reached; it is named.
    """
    progress = progress or SilentProgress()
    stops = np.asarray(stops_m, dtype=np.float64).reshape(-1, 3)
    if len(stops) == 0:
        raise InfeasibleError("there is nothing to visit: no viewpoint was found", field="inspection")
    _check_reachable(space, stops, names)
    costs = _LegCosts(space, np.asarray(home_m, dtype=np.float64), stops, options, leg_time, progress, prefer_open_sky)
    if options.tour == "given":
        nodes = np.arange(len(stops) + 1)
        costs.search_edges(nodes, 0.0, 0.9)
    else:
        nodes = _refined_tour(costs, options.seed)
    cost = tour_cost(costs.matrix, nodes)
    bound = tour_lower_bound(TourCosts.of_matrix(costs.matrix), nodes, lambda: progress.report("tour", 0.95))
    legs = [costs.leg(int(a), int(b)) for a, b in zip(nodes, np.roll(nodes, -1), strict=True)]
    progress.report("tour", 1.0)
    # the ascent ends a rounding error above an optimum that it reaches
    return Tour(nodes[1:] - 1, legs, cost, min(bound, cost), options.metric, len(costs.paths))


def _refined_tour(costs: _LegCosts, seed: int) -> NDArray[np.int64]:
    """Solve and search in turns, with little effort until the solver has nothing better to offer."""
    effort = 1.0 if costs.size <= FEW else HURRIED_EFFORT
    best = solve_closed_tour(costs.matrix, seed=seed, effort=effort)
    costs.search_edges(best, 0.0, 0.3)
    for turn in range(1, MOST_ROUNDS):
        nodes = solve_closed_tour(costs.matrix, seed=seed, effort=effort)
        if tour_cost(costs.matrix, nodes) >= tour_cost(costs.matrix, best) * (1 - 1e-9):
            if effort >= 1.0:
                break
            effort = 1.0
            continue
        costs.search_edges(nodes, 0.9 - 0.6 * 0.7 ** (turn - 1), 0.9 - 0.6 * 0.7**turn)
        if tour_cost(costs.matrix, nodes) < tour_cost(costs.matrix, best):
            best = nodes
    return best


class _LegCosts:
    """Costs between home (node 0) and the stops: lower bounds by straight lines until a path is searched."""

    def __init__(
        self,
        space: FreeSpace,
        home: NDArray[np.float64],
        stops: NDArray[np.float64],
        options: PlannerOptions,
        leg_time: LegTime,
        progress: Progress,
        prefer_open_sky: bool,
    ) -> None:
        self._space = space
        self._points = np.concatenate([home[None], stops])
        self._leg_time = leg_time if options.metric == "time" else None
        self._progress = progress
        self._prefer_open_sky = prefer_open_sky
        self._grid = GridSearch(space.free_mask.shape)
        self.size = len(self._points)
        self.paths: dict[tuple[int, int], NDArray[np.float64]] = {}
        via = self._points.copy()
        climb = np.zeros(len(via))
        if space.in_home_column(home):
            via[0] = space.take_off_m
            climb[0] = space.take_off_m[2] - home[2]
        apart = np.linalg.norm(via[:, None] - via[None], axis=-1)
        self.matrix = self._cost(apart + climb[:, None] + climb[None])
        np.fill_diagonal(self.matrix, 0.0)

    def search_edges(self, nodes: NDArray[np.int64], begin: float, end: float) -> None:
        """Search the paths of a closed tour's edges that are not known yet."""
        for i, (a, b) in enumerate(zip(nodes, np.roll(nodes, -1), strict=True)):
            fraction = begin + (end - begin) * i / len(nodes)
            self._progress.report("tour", fraction)
            pair = (int(min(a, b)), int(max(a, b)))
            if pair in self.paths:
                continue
            path = find_path(
                self._space,
                self._points[pair[0]],
                self._points[pair[1]],
                self._prefer_open_sky,
                grid=self._grid,
                poll=lambda fraction=fraction: self._progress.report("tour", fraction),  # type: ignore[misc]
            )
            self.paths[pair] = path
            # never below the bound it replaces, or rounding would make the tours flicker
            cost = max(float(self._cost(np.array(path_length(path)))), float(self.matrix[pair]))
            self.matrix[pair] = self.matrix[pair[::-1]] = cost

    def leg(self, a: int, b: int) -> NDArray[np.float64]:
        """The searched path from one node to another."""
        return self.paths[a, b] if a < b else self.paths[b, a][::-1].copy()

    def _cost(self, length_m: NDArray[np.float64]) -> NDArray[np.float64]:
        return length_m if self._leg_time is None else np.asarray(self._leg_time(length_m), dtype=np.float64)


def _check_reachable(space: FreeSpace, stops: NDArray[np.float64], names: Sequence[str] | None) -> None:
    lost = np.flatnonzero(~space.is_reachable(stops))
    if not len(lost):
        return
    first = int(lost[0])
    where = ", ".join(f"{c:.1f}" for c in stops[first])
    more = f" (and {len(lost) - 1} more)" if len(lost) > 1 else ""
    raise InfeasibleError(
        f"no way leads from home to it at ({where}) m with {space.clearance_m:.2f} m about the vehicle's centre{more}: "
        "ask for less clearance or leave it out",
        field=f"viewpoint {names[first] if names else first + 1}",
    )
