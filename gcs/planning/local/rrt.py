"""RRT, the rapidly exploring random tree (LaValle 1998): one tree from the start; its first way is its last."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gcs.planning.local.search_tree import (
    NONE,
    SearchTree,
    add_node,
    distance,
    nearest_node,
    steered,
    straight_free,
)
from gcs.planning.local.single_tree import SingleTreePlanner
from gcs.planning.numerics.compiled import compiled

if TYPE_CHECKING:
    from numpy.typing import NDArray

Floats = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Marks = np.ndarray[tuple[int, ...], np.dtype[np.bool_]]


class Rrt(SingleTreePlanner):
    """See `SamplingPlanner`; it is finished with its first way."""

    @property
    def finished(self) -> bool:
        """Whether there is a way, or no samples are left."""
        return self._reached != NONE or super().finished

    def _grow(self, samples: NDArray[np.float64]) -> None:
        if self._reached == NONE:
            self._reached = _grow(self._tree, samples, self._goal, self._step, self._blocked)


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
