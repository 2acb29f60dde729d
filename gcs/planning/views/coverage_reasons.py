"""Which sides some place could show, and why not the others.

A side is coverable if one of many random places in front of it keeps every limit and sees it. For each of the others
places are tried that break limits. The place that breaks the fewest decides, and of several limits the first in the
order of `Verdict`: what stands in the way is the least that would have to be given up. A side that the air outside does
not reach, or that no tried place sees at all, is occluded; that tells most sides of a closed structure's inside at
once.
"""

from __future__ import annotations

import math
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from gcs.core.surface_coverage import Verdict
from gcs.planning.numerics.worker_threads import in_threads
from gcs.planning.views.coverage_places import LIMITS, NOWHERE, TOO_CLOSE, Draws, draw_places
from gcs.planning.views.open_air import in_open_air

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from gcs.planning.scene.fence import FenceVolume
    from gcs.planning.scene.outer_space import OuterSpace
    from gcs.planning.scene.point_distance import SceneDistance
    from gcs.planning.scene.visibility import SightLines
    from gcs.planning.views.coverage_places import PlaceLimits

TRIES = 40
"""Places that keep all limits and are tried for every side before it counts as one that nobody can see."""

REASON_TRIES = 16
"""Places of each kind that are tried for the reason."""

STEEPEST_SHARE = 0.97
"""Share of the incidence limit that the most tilted places have."""

STEEPEST_AT_ALL_RAD = math.radians(80.0)
"""A side that is seen only more slantingly than this is not seen: no other incidence limit would help."""

FURTHEST_AT_ALL = 2.0
"""Places are tried up to this many times as far away as the GSD allows."""

NEAREST_AT_ALL_M = 0.02
SIDES_AT_A_TIME = 16384
BEYOND = 1.01

UNSEEN = 255
"""Rank of a side that no tried place sees."""

RANKS = np.array([16 * m.bit_count() + max((m & -m).bit_length() - 1, 0) for m in range(1 << LIMITS)], dtype=np.uint8)
"""Rank of the limits that a place breaks: 16 times how many they are, and the first of them; 0 for none."""


class Surroundings(NamedTuple):
    """What stands about the sides, and what keeps places from them."""

    limits: PlaceLimits
    outer: OuterSpace
    fence: FenceVolume
    distance: SceneDistance
    sight: SightLines


class Sides(NamedTuple):
    """Sides that are judged: points and unit normals, each of shape (N, 3), and where they are looked at."""

    points_m: NDArray[np.float64]
    normals: NDArray[np.float64]
    lifted_m: NDArray[np.float64]


def judge_unseen(
    sides: Sides, around: Surroundings, rng: np.random.Generator, poll: Callable[[float], None]
) -> NDArray[np.uint8]:
    """Verdicts on sides that no viewpoint shows.

    Args:
        sides: what is judged.
        around: the scene and its limits.
        rng: the source of randomness.
        poll: told the share that is done; may raise.

    Returns:
        Values of `Verdict`, none of them `SEEN`, shape (N,).
    """
    ranks = np.full(len(sides.points_m), UNSEEN, dtype=np.uint8)
    outer, ground, clearance = around.outer, around.limits.ground, around.limits.clearance
    in_air = in_open_air(
        sides.lifted_m, sides.normals, outer, ground, clearance, around.sight, rng, lambda share: poll(0.4 * share)
    )
    open_sides = np.flatnonzero(in_air)
    rounds = [*_good_places(around.limits), *_other_places(around.limits)]
    for done, draws in enumerate(rounds):
        todo = open_sides[ranks[open_sides] > 0]
        tried = _try(sides, todo, draws, around, rng, partial(_tell, poll, 0.4 + 0.6 * done / len(rounds)))
        ranks[todo] = np.minimum(ranks[todo], tried)
    verdicts = np.where(ranks == UNSEEN, int(Verdict.OCCLUDED), int(Verdict.GIMBAL) + ranks % 16)
    verdicts[ranks == 0] = Verdict.LEFT_OUT
    return verdicts.astype(np.uint8)


def _tell(poll: Callable[[float], None], share: float, _: float) -> None:
    poll(share)


def _good_places(limits: PlaceLimits) -> list[Draws]:
    """Rounds of places that keep incidence, GSD, sharpness and the distance from the side itself."""
    shortest = max(BEYOND * limits.clearance, limits.nearest)
    if shortest > limits.furthest:
        return []
    tilt = STEEPEST_SHARE * limits.steepest
    longest = max(0.99 * limits.furthest, shortest)
    return [
        Draws(0.0, 0.0 if k == 0 else tilt, shortest, longest, 2.0 if k % 2 == 0 else 0.5, only_good=True)
        for k in range(TRIES)
    ]


def _other_places(limits: PlaceLimits) -> list[Draws]:
    """Rounds of places that may break limits: near, slanting and far ones, and such as are right but for the rest."""
    tilt = STEEPEST_SHARE * limits.steepest
    near = max(limits.clearance, limits.nearest)
    short, long = min(near, limits.furthest), max(near, limits.furthest)
    kinds = (
        Draws(0.0, tilt, NEAREST_AT_ALL_M, near, 0.0),
        Draws(0.0, tilt, short, long, 0.0),
        Draws(limits.steepest, max(STEEPEST_AT_ALL_RAD, limits.steepest), short, long, 0.0),
        Draws(0.0, tilt, limits.furthest, FURTHEST_AT_ALL * long, 1.0),
    )
    return [kind for _ in range(REASON_TRIES) for kind in kinds]


def _try(
    sides: Sides,
    todo: NDArray[np.int64],
    draws: Draws,
    around: Surroundings,
    rng: np.random.Generator,
    poll: Callable[[float], None],
) -> NDArray[np.uint8]:
    """Rank of one place for every side, `UNSEEN` where it does not see the side."""
    uniform = rng.random((len(todo), 3))

    def look(first: int) -> NDArray[np.uint8]:
        part = slice(first, first + SIDES_AT_A_TIME)
        which = todo[part]
        places, broken = draw_places(
            sides.points_m, sides.normals, which, uniform[part], draws, around.limits, around.outer, around.fence
        )
        seen = np.flatnonzero(broken == 0 if draws.only_good else broken != NOWHERE)
        seen = seen[around.sight.clear(places[seen], sides.lifted_m[which[seen]])]
        exact = seen[broken[seen] & TOO_CLOSE == 0]
        near = around.distance.distance(places[exact], ground=False, limit=around.limits.clearance)
        broken[exact[near < around.limits.clearance]] |= TOO_CLOSE
        result = np.full(len(which), UNSEEN, dtype=np.uint8)
        result[seen] = RANKS[broken[seen]]
        return result

    if not len(todo):
        return np.empty(0, dtype=np.uint8)
    return np.concatenate(in_threads(look, range(0, len(todo), SIDES_AT_A_TIME), poll))
