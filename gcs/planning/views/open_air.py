"""Whether the air at a place is the air outside: random walks along straight free lines."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from gcs.planning.numerics.compiled import compiled
from gcs.planning.numerics.worker_threads import in_threads
from gcs.planning.scene.visibility import Rays
from gcs.planning.views.coverage_places import in_open_cell

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from gcs.planning.scene.outer_space import OuterSpace
    from gcs.planning.scene.visibility import SightLines

WALKS, STEPS, MORE_STEPS = 2, 12, 100
"""Walks from each place, and straight lines of a walk; and how many more when the last walk has led further away than
the clearance, so that it is not in a hollow of a beam. Too few take open air for enclosed; never the reverse."""

SCOUTS = 400
"""Of thousands that would go on for longer so many go first; when none gets out, the others are taken to be inside."""

SHORTEST_SHARE, LONGEST_SHARE = 0.1, 0.95
"""Of a line's free length, how much is gone."""

PLACES_AT_A_TIME = 16384

Floats = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
SingleFloats = np.ndarray[tuple[int, ...], np.dtype[np.float32]]
Longs = np.ndarray[tuple[int, ...], np.dtype[np.int64]]


def in_open_air(
    places_m: NDArray[np.float64],
    normals: NDArray[np.float64],
    outer: OuterSpace,
    ground_m: float,
    far_away_m: float,
    sight: SightLines,
    rng: np.random.Generator,
    poll: Callable[[float], None],
) -> NDArray[np.bool_]:
    """Whether a walk leads into the open: far away, or to a cell where a camera could be.

    Args:
        places_m: where the walks begin, shape (N, 3).
        normals: the side that they begin on, unit, shape (N, 3).
        outer: cells about the structure.
        ground_m: height of the ground; minus infinity when there is none.
        far_away_m: a walk that has led further goes on for longer.
        sight: what is in the way.
        rng: the source of randomness.
        poll: told the share that is done; may raise.

    Returns:
        Shape (N,).
    """
    starts = range(0, len(places_m), PLACES_AT_A_TIME)
    far = 2.0 * outer.pitch * float(np.linalg.norm(outer.state.shape))

    def walk(item: tuple[int, np.random.Generator]) -> NDArray[np.bool_]:
        first, own_rng = item
        part = slice(first, first + PLACES_AT_A_TIME)
        start, normal = places_m[part], normals[part]
        place = start.copy()
        reached = np.zeros(len(place), dtype=np.bool_)

        def go(who: NDArray[np.int64], steps: int, *, outwards: bool) -> None:
            for step in range(steps):
                going = who[~reached[who]]
                if not len(going):
                    return
                draws = own_rng.random((len(going), 3))
                rays = _lines(place, normal, going, draws, outwards and step == 0, ground_m, far, sight.middle_m)
                free = sight.free_lengths(Rays(*rays))
                _walk(place, going, rays[1], free * (SHORTEST_SHARE + (LONGEST_SHARE - SHORTEST_SHARE) * draws[:, 2]))
                reached[going] = (free >= 0.999 * far) | in_open_cell(place[going], outer)

        everybody = np.arange(len(place))
        for _ in range(WALKS):
            place[~reached] = start[~reached]
            go(everybody, STEPS, outwards=True)
        wide = np.flatnonzero(~reached & (((place - start) ** 2).sum(axis=1) > far_away_m**2))
        go(wide[:SCOUTS], MORE_STEPS, outwards=False)
        if reached[wide[:SCOUTS]].any():
            go(wide, MORE_STEPS, outwards=False)
        return reached

    if not len(places_m):
        return np.zeros(0, dtype=np.bool_)
    return np.concatenate(in_threads(walk, list(zip(starts, rng.spawn(len(starts)), strict=True)), poll))


@compiled
def _lines(
    places: Floats,
    normals: Floats,
    going: Longs,
    draws: Floats,
    outwards: bool,
    ground: float,
    far: float,
    middle: Floats,
) -> tuple[SingleFloats, SingleFloats, SingleFloats]:
    """A line from each place in a random direction, as long as it is above the ground; origins about the middle."""
    n = going.shape[0]
    origins, directions, lengths = np.empty((n, 3), np.float32), np.empty((n, 3), np.float32), np.empty(n, np.float32)
    for i in range(n):
        p, normal = places[going[i]], normals[going[i]]
        z = 2.0 * draws[i, 0] - 1.0
        level = math.sqrt(max(1.0 - z * z, 0.0))
        x, y = level * math.cos(2.0 * math.pi * draws[i, 1]), level * math.sin(2.0 * math.pi * draws[i, 1])
        if outwards and x * normal[0] + y * normal[1] + z * normal[2] < 0.0:
            x, y, z = -x, -y, -z
        directions[i, 0], directions[i, 1], directions[i, 2] = x, y, z
        lengths[i] = min(max((p[2] - ground) / -z, 0.0), far) if z < -1e-9 else far
        for k in range(3):
            origins[i, k] = p[k] - middle[k]
    return origins, directions, lengths


@compiled
def _walk(places: Floats, going: Longs, directions: SingleFloats, lengths: Floats) -> None:
    for i in range(going.shape[0]):
        for k in range(3):
            places[going[i], k] += lengths[i] * directions[i, k]
