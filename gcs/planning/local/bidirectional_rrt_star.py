"""BI-RRT* (Jordan and Perez 2013): an RRT* from the start and one from the goal that take turns and try to meet.

After one tree has grown a node, the other is extended towards it, step by step, as long as nothing is in the way.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from gcs.planning.local.search_tree import NONE, SearchTree, distance, extend_star, with_room
from gcs.planning.local.tree_pair import PairPlanner, take_link
from gcs.planning.numerics.compiled import compiled

if TYPE_CHECKING:
    from numpy.typing import NDArray

Floats = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Ints = np.ndarray[tuple[int, ...], np.dtype[np.int64]]
Marks = np.ndarray[tuple[int, ...], np.dtype[np.bool_]]


class BidirectionalRrtStar(PairPlanner):
    """See `SamplingPlanner`; its way gets shorter with more samples."""

    def _grow(self, samples: NDArray[np.float64]) -> None:
        # Towards one node a tree makes no more steps than cross the map.
        most_steps = math.ceil(float(np.linalg.norm(self._blocked.shape)) / self._step) + 1
        taken = 0
        while taken < len(samples):
            self._from_start = with_room(self._from_start, most_steps + 1)
            self._from_goal = with_room(self._from_goal, most_steps + 1)
            taken += _grow(
                self._from_start,
                self._from_goal,
                self._link,
                samples[taken:],
                (self.iterations_done + taken) % 2 == 0,
                self._step,
                most_steps,
                self._gamma,
                self._axes,
                self._blocked,
            )


@compiled
def _grow(
    from_start: SearchTree,
    from_goal: SearchTree,
    link: Ints,
    samples: Floats,
    starts_turn: bool,
    step: float,
    most_steps: int,
    gamma: float,
    axes: int,
    blocked: Marks,
) -> int:
    """Take samples as long as both trees have room for what one can add; how many were taken."""
    for s in range(len(samples)):
        room = min(len(from_start.parent) - from_start.size[0], len(from_goal.parent) - from_goal.size[0])
        if room <= most_steps:
            return s
        if starts_turn:
            a, b = _grow_and_connect(from_start, from_goal, samples[s], step, most_steps, gamma, axes, blocked)
        else:
            b, a = _grow_and_connect(from_goal, from_start, samples[s], step, most_steps, gamma, axes, blocked)
        if a != NONE:
            take_link(from_start, from_goal, link, a, b)
        starts_turn = not starts_turn
    return len(samples)


@compiled
def _grow_and_connect(
    grown: SearchTree,
    other: SearchTree,
    sample: Floats,
    step: float,
    most_steps: int,
    gamma: float,
    axes: int,
    blocked: Marks,
) -> tuple[int, int]:
    """Extend one tree towards a sample and the other towards the new node; the nodes in which they meet, or `NONE`."""
    node = extend_star(grown, sample, step, gamma, axes, blocked)
    if node == NONE:
        return NONE, NONE
    for _ in range(most_steps):
        met = extend_star(other, grown.points[node], step, gamma, axes, blocked)
        if met == NONE:
            break
        if distance(other.points[met], grown.points[node]) == 0.0:
            return node, met
    return NONE, NONE
