"""Tubes or polytopes about a straight, as wide as the corridor's reach, and proved clear where the space is tight.

In the tight space a tube is as thick as the least room along its part of the straight lets it be. A polytope is the
tube of full thickness, cut by planes between the straight and what stands near it, so that it is wide where there is
room on one side only; where no planes are found it is a tube.
"""

from __future__ import annotations

import itertools
import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from gcs.planning.trajectories.leg_tube import tube_reach, tubes

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from gcs.planning.scene.free_space import FreeSpace

LEAST_REACH_M = 0.005
"""The thinnest tube reaches so far from its straight; what is not clear then is left to the certificates."""

SHORTEST_M = 0.5
"""Parts of a straight are not halved below this length: tiny pieces make stiff problems."""

WORTH_HALVING = 2.0
"""A part is halved where one of its ends or its middle has this many times the least room along it."""


class ConvexPart(NamedTuple):
    """A part of a straight and the convex set about it.

    Attributes:
        end_m: where it ends, shape (3,).
        box_m: corners of a box that holds the set, shape (2, 3).
        planes: of the set, shape (m, 4).
    """

    end_m: NDArray[np.float64]
    box_m: NDArray[np.float64]
    planes: NDArray[np.float64]


def convex_parts(
    a: NDArray[np.float64],
    b: NDArray[np.float64],
    reach_m: float,
    longest_m: float,
    *,
    polytopes: bool,
    space: FreeSpace | None = None,
) -> list[ConvexPart]:
    """Cut a straight into parts and put a tube or a polytope about each.

    Args:
        a: where the straight starts, shape (3,).
        b: where it ends.
        reach_m: no point of a set is further from its part than this.
        longest_m: longest part.
        polytopes: whether tubes may be cut rather than thinned where the space is tight.
        space: where it is tight; without it, or where the straight keeps the reach, all tubes are of full thickness.
    """
    count = max(1, math.ceil(math.dist(a, b) / longest_m - 1e-9))
    share = np.linspace(0.0, 1.0, count + 1)[:, None]
    ends = (1 - share) * a + share * b
    if space is None or space.segment_free(a, b, model=space.wide_model):
        full = np.full(count, reach_m / tube_reach(b - a))
        return [ConvexPart(end, box, planes) for end, planes, box in zip(ends[1:], *tubes(ends, full), strict=True)]
    return [part for c, d in itertools.pairwise(ends) for part in _fitted(c, d, reach_m, space, polytopes)]


def _fitted(
    a: NDArray[np.float64], b: NDArray[np.float64], reach_m: float, space: FreeSpace, polytopes: bool
) -> list[ConvexPart]:
    """A part in the tight space, halved where that gives the halves more room."""
    if polytopes:
        whole = _tube(a, b, reach_m)
        planes = space.cut_free(a, b, whole.planes, reach_m)
        if planes is not None:
            return [whole._replace(planes=planes)]
    middle = (a + b) / 2
    room = space.least_room_m(a, b)
    if room < reach_m and math.dist(a, b) >= 2 * SHORTEST_M:
        widest = max(space.least_room_m(p, p) for p in (a, middle, b))
        if widest > WORTH_HALVING * room:
            return [*_fitted(a, middle, reach_m, space, polytopes), *_fitted(middle, b, reach_m, space, polytopes)]
    return [_tube(a, b, min(max(room, LEAST_REACH_M), reach_m))]


def _tube(a: NDArray[np.float64], b: NDArray[np.float64], reach_m: float) -> ConvexPart:
    """The tube about a part that reaches so far from it."""
    (planes,), (box,) = tubes(np.stack([a, b]), np.array([reach_m / tube_reach(b - a)]))
    return ConvexPart(b, box, planes)
