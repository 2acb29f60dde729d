"""Legs between home and stops, searched when they are asked for, with what each costs and uses."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from gcs.planning.paths.path_search import find_path
from gcs.planning.scene.grid_search import GridSearch
from gcs.planning.tours.run_exchange import HOME

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from numpy.typing import NDArray

    from gcs.core.progress import Progress
    from gcs.planning.scene.free_space import FreeSpace


class Leg(NamedTuple):
    """A way from one node to another.

    Attributes:
        path_m: free polyline, shape (K, 3).
        cost: in the tour's metric.
        energy_wh: estimate of what flying it takes.
    """

    path_m: NDArray[np.float64]
    cost: float
    energy_wh: float


class LegTable:
    """Legs by pairs of nodes: `HOME`, and the stops 0, 1, ...

    Args:
        space: where the centre may be.
        home_m: shape (3,).
        stops_m: shape (N, 3).
        cost: of a polyline, the same in both directions, at most that of any polyline between the same ends when it is
            straight.
        energy_wh: of a polyline.
        progress: told about the stage `sorties`, and polled.
    """

    def __init__(
        self,
        space: FreeSpace,
        home_m: NDArray[np.float64],
        stops_m: NDArray[np.float64],
        cost: Callable[[NDArray[np.float64]], float],
        energy_wh: Callable[[NDArray[np.float64]], float],
        progress: Progress,
    ) -> None:
        self.stops_m = stops_m
        self._space = space
        self._points = np.concatenate([stops_m, home_m[None]])
        self._cost = cost
        self._energy = energy_wh
        self._progress = progress
        self._grid = GridSearch(space.free_mask.shape)
        self._paths: dict[tuple[int, int], NDArray[np.float64]] = {}
        self._legs: dict[tuple[int, int], Leg] = {}
        self._straight_wh: dict[tuple[int, int], float] = {}

    def know(self, order: Sequence[int], legs_m: Sequence[NDArray[np.float64]]) -> None:
        """Take over the paths of a closed tour: from home to the first stop, ..., from the last one home."""
        nodes = [HOME, *order, HOME]
        for a, b, path in zip(nodes[:-1], nodes[1:], legs_m, strict=True):
            self._paths[a, b] = path

    def leg(self, a: int, b: int) -> Leg:
        """The leg from a to b.

        Raises:
            InfeasibleError: there is no way.
        """
        if (a, b) not in self._legs:
            path = self._path(a, b)
            self._legs[a, b] = Leg(path, self._cost(path), self._energy(path))
        return self._legs[a, b]

    def is_searched(self, a: int, b: int) -> bool:
        """Whether the way from a to b, or back, is known."""
        return (a, b) in self._paths or (b, a) in self._paths

    def search(self, order: Iterable[int]) -> bool:
        """Search the legs of a run, and tell whether there was one that was not known before."""
        new = [pair for pair in _pairs(order) if not self.is_searched(*pair)]
        for pair in new:
            self._path(*pair)
        return bool(new)

    def least_cost(self, a: int, b: int) -> float:
        """Cost of the leg if it is known, else of the straight line, which no way undercuts."""
        if self.is_searched(a, b):
            return self.leg(a, b).cost
        return self._cost(self._points[[a, b]])

    def least_energy_wh(self, a: int, b: int) -> float:
        """Estimated energy of the leg if it is known, else of the straight line."""
        if self.is_searched(a, b):
            return self.leg(a, b).energy_wh
        if (a, b) not in self._straight_wh:
            self._straight_wh[a, b] = self._energy(self._points[[a, b]])
        return self._straight_wh[a, b]

    def least_costs(self, of_steps: Callable[[NDArray[np.float64]], NDArray[np.float64]]) -> NDArray[np.float64]:
        """`least_cost` of all pairs, home last, shape (N + 1, N + 1).

        Args:
            of_steps: costs of straight lines, from displacements (..., 3) to (...).
        """
        costs = of_steps(self._points[:, None] - self._points[None])
        for (a, b), leg in self._legs.items():
            costs[a, b] = costs[b, a] = leg.cost
        return costs

    def legs(self, order: Iterable[int]) -> list[Leg]:
        """The legs of a run: from home through the stops and back."""
        return [self.leg(a, b) for a, b in _pairs(order)]

    def cost(self, order: Iterable[int]) -> float:
        """Cost of a run."""
        return sum(leg.cost for leg in self.legs(order))

    def energy_wh(self, order: Iterable[int]) -> float:
        """Estimated energy of the legs of a run."""
        return sum(leg.energy_wh for leg in self.legs(order))

    def least_run_cost(self, order: Iterable[int]) -> float:
        """`least_cost` of a run."""
        return sum(self.least_cost(a, b) for a, b in _pairs(order))

    def least_run_energy_wh(self, order: Iterable[int]) -> float:
        """`least_energy_wh` of a run."""
        return sum(self.least_energy_wh(a, b) for a, b in _pairs(order))

    def poll(self) -> None:
        """Tell the progress that something is going on; it may stop it."""
        self._progress.report("sorties", 0.5)

    def _path(self, a: int, b: int) -> NDArray[np.float64]:
        if (a, b) not in self._paths:
            if (b, a) in self._paths:
                self._paths[a, b] = self._paths[b, a][::-1].copy()
            else:
                ends = self._points[[a, b]]
                self._paths[a, b] = find_path(self._space, ends[0], ends[1], grid=self._grid, poll=self.poll)
        return self._paths[a, b]


def _pairs(order: Iterable[int]) -> Iterable[tuple[int, int]]:
    """The legs of a run from home and back, by their nodes."""
    return itertools.pairwise([HOME, *order, HOME])
