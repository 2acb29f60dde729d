"""The tour: in which order the stops are visited from home and back, over the paths that the search finds.

Paths are searched only where they are needed. A cost matrix starts with straight lines, which no path undercuts; the
tour over it is found, the paths of its edges are searched and put in the matrix, and the tour is found again, until
all edges of the tour are searched ones.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.errors import InfeasibleError
from gcs.core.progress import SilentProgress
from gcs.planning.paths.path_search import find_path
from gcs.planning.scene.grid_search import GridSearch
from gcs.planning.tours.genetic_tour import genetic_tour
from gcs.planning.tours.tour_bound import tour_lower_bound
from gcs.planning.tours.tour_costs import TourCosts
from gcs.planning.tours.tour_metric import LegTime, tour_metric
from gcs.planning.tours.tour_solver import from_node_zero, solve_tour

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike, NDArray

    from gcs.core.progress import Progress
    from gcs.core.scenario import PlannerOptions
    from gcs.planning.scene.free_space import FreeSpace
    from gcs.planning.tours.tour_metric import TourMetric

__all__ = ["LegTime", "Tour", "find_tour"]

MOST_ROUNDS = 40
HURRIED = 0.1
"""Effort of the solver while the matrix still changes."""

BETTER = 1e-9


@dataclass(frozen=True, eq=False)
class Tour:
    """A closed tour from home through all stops.

    Attributes:
        order: stops in visiting order, shape (N,).
        legs_m: N + 1 free paths (K, 3): home to the first stop, ..., the last stop to home; the first starts and the
            last ends with the vertical column over home.
        cost: sum of the legs' costs in the metric.
        lower_bound: no order of the stops costs less, with legs as this search finds them.
        metric: `length` (m), `time` (s) or `energy`.
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
        options: metric, method (the given order may be kept) and seed.
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
    metric = tour_metric(options, leg_time)
    legs = _LegCosts(space, np.asarray(home_m, dtype=np.float64), stops, metric, progress, prefer_open_sky)
    if options.tour == "given":
        nodes = np.arange(len(stops) + 1)
        legs.search_edges(nodes, 0.0, 0.9)
    elif options.tour == "genetic":
        nodes = _bred_tour(legs, options.seed)
    else:
        nodes = _refined_tour(legs, options.seed)
    cost = legs.costs.of_tour(nodes)
    bound = tour_lower_bound(legs.costs, nodes, lambda: progress.report("tour", 0.95))
    paths = [legs.leg(int(a), int(b)) for a, b in zip(nodes, np.roll(nodes, -1), strict=True)]
    progress.report("tour", 1.0)
    return Tour(nodes[1:] - 1, paths, cost, bound, metric.name, len(legs.paths))


def _refined_tour(legs: _LegCosts, seed: int) -> NDArray[np.int64]:
    """Solve and search in turns, with little effort of the solver until it has nothing better to offer."""
    costs, best, effort = legs.costs, None, 1.0
    for turn in range(MOST_ROUNDS):
        begin, end = (0.0, 0.3) if best is None else (0.9 - 0.6 * 0.7 ** (turn - 1), 0.9 - 0.6 * 0.7**turn)
        nodes = solve_tour(
            costs,
            seed=seed,
            effort=effort,
            start=best,
            poll=lambda begin=begin: legs.progress.report("tour", begin),  # type: ignore[misc]
        )
        if best is not None and costs.of_tour(nodes) >= costs.of_tour(best) * (1 - BETTER):
            if effort == 1.0:
                break
            effort = 1.0
            continue
        legs.search_edges(nodes, begin, end)
        if best is None or costs.of_tour(nodes) < costs.of_tour(best):
            best = nodes
        effort = HURRIED
    return nodes if best is None else best


def _bred_tour(legs: _LegCosts, seed: int) -> NDArray[np.int64]:
    """Breed a tour over the straight lines, search its paths, and breed on from it until it stays."""
    costs, best = legs.costs, None
    for turn in range(MOST_ROUNDS):
        begin, end = 1 - 0.7**turn, 1 - 0.7 ** (turn + 1)

        def poll(share: float, begin: float = begin, end: float = end) -> None:
            legs.progress.report("tour", 0.9 * (begin + 0.8 * share * (end - begin)))

        nodes = from_node_zero(genetic_tour(costs, closed=True, seed=seed, start=best, poll=poll).order)
        if best is not None and costs.of_tour(nodes) >= costs.of_tour(best) * (1 - BETTER):
            break
        legs.search_edges(nodes, 0.9 * (begin + 0.8 * (end - begin)), 0.9 * end)
        if best is None or costs.of_tour(nodes) < costs.of_tour(best):
            best = nodes
    return nodes if best is None else best


class _LegCosts:
    """Costs between home (node 0) and the stops: those of straight lines until a path is searched."""

    def __init__(
        self,
        space: FreeSpace,
        home: NDArray[np.float64],
        stops: NDArray[np.float64],
        metric: TourMetric,
        progress: Progress,
        prefer_open_sky: bool,
    ) -> None:
        self._space = space
        self._points = np.concatenate([home[None], stops])
        self._metric = metric
        self.progress = progress
        self._prefer_open_sky = prefer_open_sky
        self._grid = GridSearch(space.free_mask.shape)
        self.paths: dict[tuple[int, int], NDArray[np.float64]] = {}
        in_column = space.in_home_column(home)
        above = space.take_off_m if in_column else home
        matrix = metric.of_steps(self._points[:, None] - self._points[None])
        matrix[0, 1:] = matrix[1:, 0] = metric.of_steps(np.broadcast_to(above - home, stops.shape), stops - above)
        np.fill_diagonal(matrix, 0.0)
        self.costs = TourCosts.of_matrix(matrix)

    def search_edges(self, nodes: NDArray[np.int64], begin: float, end: float) -> None:
        """Search the paths of a closed tour's edges that are not known yet."""
        matrix = self.costs.data
        for i, (a, b) in enumerate(zip(nodes, np.roll(nodes, -1), strict=True)):
            fraction = begin + (end - begin) * i / len(nodes)
            self.progress.report("tour", fraction)
            pair = (int(min(a, b)), int(max(a, b)))
            if pair in self.paths:
                continue
            path = find_path(
                self._space,
                self._points[pair[0]],
                self._points[pair[1]],
                self._prefer_open_sky,
                grid=self._grid,
                poll=lambda fraction=fraction: self.progress.report("tour", fraction),  # type: ignore[misc]
            )
            self.paths[pair] = path
            # never below the bound it replaces, or rounding would make the tours flicker
            matrix[pair] = matrix[pair[::-1]] = max(self._metric.of_path(path), float(matrix[pair]))

    def leg(self, a: int, b: int) -> NDArray[np.float64]:
        """The searched path from one node to another."""
        return self.paths[a, b] if a < b else self.paths[b, a][::-1].copy()


def _check_reachable(space: FreeSpace, stops: NDArray[np.float64], names: Sequence[str] | None) -> None:
    lost = np.flatnonzero(~space.is_reachable(stops))
    if not len(lost):
        return
    first = int(lost[0])
    where = ", ".join(f"{c:.1f}" for c in stops[first])
    more = f" (and {len(lost) - 1} more)" if len(lost) > 1 else ""
    room = space.largest_clearance_m(stops[first : first + 1])
    least = f"with {room:.2f} m it could be reached: ask for no more, or leave it out" if room else "leave it out"
    raise InfeasibleError(
        f"no way leads from home to it at ({where}) m with {space.nearest_m:.2f} m about the vehicle's centre{more}; "
        f"{least}",
        field=f"viewpoint {names[first] if names else first + 1}",
    )
