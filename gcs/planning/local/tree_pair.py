"""What planners with two trees share: one tree from the start, one from the goal, and the best link between them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gcs.planning.local.sampling_planner import SamplingOptions, SamplingPlanner
from gcs.planning.local.search_tree import NONE, SearchTree, distance, rooted_tree, way_from_root
from gcs.planning.numerics.compiled import compiled

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from gcs.planning.local.binary_map import BinaryMap

Ints = np.ndarray[tuple[int, ...], np.dtype[np.int64]]


class PairPlanner(SamplingPlanner):
    """See `SamplingPlanner`."""

    two_trees = True

    def __init__(
        self, area: BinaryMap, start_m: ArrayLike, goal_m: ArrayLike, options: SamplingOptions | None = None
    ) -> None:
        super().__init__(area, start_m, goal_m, options)
        self._from_start = rooted_tree(self._start, self._options.iterations + 1)
        self._from_goal = rooted_tree(self._goal, self._options.iterations + 1)
        self._link = np.array([NONE, NONE])

    def _best_cells(self) -> NDArray[np.float64] | None:
        if self._link[0] == NONE:
            return None
        there = way_from_root(self._from_start, int(self._link[0]))
        on = way_from_root(self._from_goal, int(self._link[1]))[::-1]
        same = bool((there[-1] == on[0]).all())
        return np.concatenate([there, on[1:] if same else on])


@compiled
def take_link(from_start: SearchTree, from_goal: SearchTree, link: Ints, a: int, b: int) -> None:
    """Let the trees be linked by a free straight between nodes a and b, if the way through it is the shortest.

    Args:
        from_start: a is its node.
        from_goal: b is its node.
        link: the best so far, changed in place; both `NONE` before the first.
        a: node.
        b: node.
    """
    if link[0] == NONE or _length(from_start, from_goal, a, b) < _length(from_start, from_goal, link[0], link[1]):
        link[0], link[1] = a, b


@compiled
def _length(from_start: SearchTree, from_goal: SearchTree, a: int, b: int) -> float:
    return float(from_start.cost[a] + from_goal.cost[b] + distance(from_start.points[a], from_goal.points[b]))
