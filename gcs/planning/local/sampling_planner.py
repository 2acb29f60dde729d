"""What the sampling planners share: a query on a binarised map, seeded samples, and the best way so far at any time."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.errors import InfeasibleError, InputError
from gcs.core.progress import SilentProgress
from gcs.planning.local.binary_map import check_query

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from gcs.core.progress import Progress
    from gcs.planning.local.binary_map import BinaryMap

PAPER_ITERATIONS = 700
"""Iterations of each planner in the yard paper."""

ITERATIONS_BETWEEN_POLLS = 100

MOST_ITERATIONS = 100_000


@dataclass(frozen=True)
class SamplingOptions:
    """How a sampling planner searches.

    Attributes:
        iterations: samples at most; there is room for no more.
        step_m: longest edge of those planners that step towards a sample.
        goal_share: share of the samples that are the goal itself, in planners with one tree.
        seed: of the samples.
    """

    iterations: int = PAPER_ITERATIONS
    step_m: float = 8.0
    goal_share: float = 0.05
    seed: int = 0

    def __post_init__(self) -> None:
        if not 0 < self.iterations <= MOST_ITERATIONS:
            raise InputError(f"give 1 to {MOST_ITERATIONS} iterations, not {self.iterations}", field="iterations")
        if not 0 < self.step_m < math.inf:
            raise InputError(f"a step must be positive and finite, not {self.step_m:g}", field="step_m")
        if not 0 <= self.goal_share <= 1:
            raise InputError(f"a share lies between 0 and 1, not at {self.goal_share:g}", field="goal_share")


class SamplingPlanner(ABC):
    """A search for a way through free cells that can be grown, read and dropped at any time.

    Args:
        area: a binarised map of the plane or of space, already grown by the safe distance.
        start_m: shape (d,), scene ENU.
        goal_m: likewise.
        options: how to search.

    Attributes:
        iterations_done: samples drawn so far.

    Raises:
        InputError: start or goal is not a point, or is blocked.
    """

    two_trees = False
    """Whether a tree grows from the goal too; only planners with one tree need the goal among their samples."""

    def __init__(
        self, area: BinaryMap, start_m: ArrayLike, goal_m: ArrayLike, options: SamplingOptions | None = None
    ) -> None:
        check_query(area, start_m, goal_m)
        self._options = options or SamplingOptions()
        self._area = area
        self._axes = area.dimensions
        self._blocked = np.ascontiguousarray(area.blocked if self._axes == 3 else area.blocked[:, :, None])
        self._start, self._goal = self._in_cells(start_m), self._in_cells(goal_m)
        self._step = self._options.step_m / area.cell_m
        self._rng = np.random.default_rng(self._options.seed)
        self.iterations_done = 0

    def grow(self, iterations: int) -> None:
        """Draw so many samples more, but not more than the options allow."""
        count = min(iterations, self._options.iterations - self.iterations_done)
        if count <= 0:
            return
        samples = self._rng.random((count, 3)) * self._blocked.shape
        if self._axes == 2:
            samples[:, 2] = self._start[2]
        if not self.two_trees:
            samples[self._rng.random(count) < self._options.goal_share] = self._goal
        self._grow(samples)
        self.iterations_done += count

    def best(self) -> NDArray[np.float64] | None:
        """The shortest way found so far from start to goal, shape (K, d), scene ENU m; None before the first."""
        way = self._best_cells()
        return None if way is None else self._area.points_m(way[:, : self._axes])

    @property
    def share_done(self) -> float:
        """Share of the samples that were drawn."""
        return self.iterations_done / self._options.iterations

    @property
    def finished(self) -> bool:
        """Whether more samples would change nothing, or none are left."""
        return self.share_done >= 1

    @abstractmethod
    def _grow(self, samples: NDArray[np.float64]) -> None:
        """Take samples (n, 3), cells, one by one."""

    @abstractmethod
    def _best_cells(self) -> NDArray[np.float64] | None:
        """The shortest way so far, shape (K, 3), cells."""

    @cached_property
    def _gamma(self) -> float:
        """Factor of the neighbours' radius (cells) that makes RRT* come to the optimum (Karaman and Frazzoli 2011)."""
        d = self._axes
        unit_ball = math.pi if d == 2 else 4 * math.pi / 3
        free = float(self._blocked.size - np.count_nonzero(self._blocked))
        return float(2 * ((1 + 1 / d) * free / unit_ball) ** (1 / d))

    def _in_cells(self, point_m: ArrayLike) -> NDArray[np.float64]:
        cells = self._area.cells(point_m)
        return cells if self._axes == 3 else np.append(cells, 0.5)


def search_path(planner: SamplingPlanner, progress: Progress | None = None) -> NDArray[np.float64]:
    """Grow a planner to its end.

    Args:
        planner: keeps its best way when the progress stops the search.
        progress: reports the stage `local path`.

    Returns:
        The shortest way found, shape (K, d), scene ENU m.

    Raises:
        InfeasibleError: no way was found in the planner's iterations.
        OperationCancelled: the progress said so.
    """
    progress = progress or SilentProgress()
    while not planner.finished:
        progress.report("local path", planner.share_done)
        planner.grow(ITERATIONS_BETWEEN_POLLS)
    way = planner.best()
    if way is None:
        raise InfeasibleError(f"no way was found in {planner.iterations_done} samples: give more iterations, or hold")
    return way
