"""RRT* (Karaman and Frazzoli 2011): one tree whose nodes hang on the best parent near them and are rewired."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gcs.planning.local.search_tree import (
    NONE,
    SearchTree,
    add_node,
    distance,
    extend_star,
    hang_anew,
    straight_free,
)
from gcs.planning.local.single_tree import SingleTreePlanner
from gcs.planning.numerics.compiled import compiled

if TYPE_CHECKING:
    from numpy.typing import NDArray

Floats = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Marks = np.ndarray[tuple[int, ...], np.dtype[np.bool_]]


class RrtStar(SingleTreePlanner):
    """See `SamplingPlanner`; its way gets shorter with more samples."""

    def _grow(self, samples: NDArray[np.float64]) -> None:
        self._reached = _grow(
            self._tree, samples, self._goal, self._reached, self._step, self._gamma, self._axes, self._blocked
        )


@compiled
def _grow(
    tree: SearchTree,
    samples: Floats,
    goal: Floats,
    reached: int,
    step: float,
    gamma: float,
    axes: int,
    blocked: Marks,
) -> int:
    """Extend towards each sample; the goal's node, or `NONE`. Once in the tree the goal is rewired like any node."""
    for s in range(len(samples)):
        node = extend_star(tree, samples[s], step, gamma, axes, blocked)
        if node == NONE:
            continue
        left = distance(tree.points[node], goal)
        cost = tree.cost[node] + left
        if left > step or (reached != NONE and cost >= tree.cost[reached]):
            continue
        if straight_free(tree.points[node], goal, blocked):
            if reached == NONE:
                reached = add_node(tree, goal, node, cost)
            else:
                hang_anew(tree, reached, node, cost)
    return reached
