"""IB-RRT* (Qureshi and Ayaz 2015): a sample joins that one of two trees from whose root it is nearer.

The sample itself becomes a node, without a step towards it: on the best of its neighbours in either tree, or on the
nearest node where it has none. Where both trees have a free straight to it, it links them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gcs.planning.local.search_tree import (
    NONE,
    SearchTree,
    add_node,
    best_parent,
    near_nodes,
    near_radius,
    nearest_node,
    rewire,
)
from gcs.planning.local.tree_pair import PairPlanner, take_link
from gcs.planning.numerics.compiled import compiled

if TYPE_CHECKING:
    from numpy.typing import NDArray

Floats = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Ints = np.ndarray[tuple[int, ...], np.dtype[np.int64]]
Marks = np.ndarray[tuple[int, ...], np.dtype[np.bool_]]


class IntelligentBidirectionalRrtStar(PairPlanner):
    """See `SamplingPlanner`; its way gets shorter with more samples."""

    def _grow(self, samples: NDArray[np.float64]) -> None:
        _grow(self._from_start, self._from_goal, self._link, samples, self._gamma, self._axes, self._blocked)


@compiled
def _grow(
    from_start: SearchTree,
    from_goal: SearchTree,
    link: Ints,
    samples: Floats,
    gamma: float,
    axes: int,
    blocked: Marks,
) -> None:
    for s in range(len(samples)):
        sample = samples[s]
        near_start = near_nodes(from_start, sample, near_radius(from_start, gamma, axes))
        near_goal = near_nodes(from_goal, sample, near_radius(from_goal, gamma, axes))
        if len(near_start) == 0 and len(near_goal) == 0:
            near_start = np.array([nearest_node(from_start, sample)])
            near_goal = np.array([nearest_node(from_goal, sample)])
        a, from_a = best_parent(from_start, sample, near_start, blocked)
        b, from_b = best_parent(from_goal, sample, near_goal, blocked)
        if a == NONE and b == NONE:
            continue
        if from_a <= from_b:
            node = add_node(from_start, sample, a, from_a)
            if b != NONE:
                take_link(from_start, from_goal, link, node, b)
            rewire(from_start, node, near_start, blocked)
        else:
            node = add_node(from_goal, sample, b, from_b)
            if a != NONE:
                take_link(from_start, from_goal, link, a, node)
            rewire(from_goal, node, near_goal, blocked)
