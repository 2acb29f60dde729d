"""RRT, the rapidly exploring random tree (LaValle 1998): one tree from the start; its first way is its last."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gcs.planning.local.sampling_planner import SamplingOptions, SamplingPlanner
from gcs.planning.local.search_tree import (
    NONE,
    SearchTree,
    add_node,
    distance,
    nearest_node,
    rooted_tree,
    steered,
    straight_free,
    way_from_root,
)
from gcs.planning.numerics.compiled import compiled

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from gcs.planning.local.binary_map import BinaryMap

Floats = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Marks = np.ndarray[tuple[int, ...], np.dtype[np.bool_]]


class Rrt(SamplingPlanner):
    """See `SamplingPlanner`; it is finished with its first way."""

    def __init__(
        self, area: BinaryMap, start_m: ArrayLike, goal_m: ArrayLike, options: SamplingOptions | None = None
    ) -> None:
        super().__init__(area, start_m, goal_m, options)
        self._tree = rooted_tree(self._start, self._options.iterations + 2)
        self._reached = NONE

    @property
    def finished(self) -> bool:
        """Whether there is a way, or no samples are left."""
        return self._reached != NONE or super().finished

    def _grow(self, samples: NDArray[np.float64]) -> None:
        if self._reached == NONE:
            self._reached = _grow(self._tree, samples, self._goal, self._step, self._blocked)

    def _best_cells(self) -> NDArray[np.float64] | None:
        return None if self._reached == NONE else way_from_root(self._tree, self._reached)


@compiled
def _grow(tree: SearchTree, samples: Floats, goal: Floats, step: float, blocked: Marks) -> int:
    """Step towards each sample; the goal's node, or `NONE`."""
    for s in range(len(samples)):
        nearest = nearest_node(tree, samples[s])
        point = steered(tree.points[nearest], samples[s], step)
        away = distance(tree.points[nearest], point)
        if away == 0.0 or not straight_free(tree.points[nearest], point, blocked):
            continue
        node = add_node(tree, point, nearest, tree.cost[nearest] + away)
        left = distance(point, goal)
        if left == 0.0:
            return node
        if left <= step and straight_free(point, goal, blocked):
            return add_node(tree, goal, node, tree.cost[node] + left)
    return NONE
