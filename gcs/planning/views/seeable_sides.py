"""Which sides of a surface can be seen from somewhere, how easily, and from where."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from gcs.planning.numerics.compiled import compiled
from gcs.planning.numerics.worker_threads import in_threads
from gcs.planning.scene.free_space import LINK_REACH
from gcs.planning.scene.visibility import LAST_PIECE_M, Rays
from gcs.planning.views.picture_kernels import LIFT_M, PictureLimits

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from gcs.planning.scene.free_space import FreeSpace
    from gcs.planning.scene.visibility import SightLines
    from gcs.planning.views.surface_candidates import Targets

TRIES = 4
"""Places that are tried for every side; how many of them see it says how easily it is seen."""

MORE_TRIES = 20
"""Places that are tried after those for a side that none has seen yet."""

LAST_TRIES = 8
"""Places that are tried after those, and that are judged exactly, not by the grid's cell."""

STEEPEST = 0.97
"""Share of the incidence limit that the most tilted places have."""

SIDES_AT_A_TIME = 8192

SingleFloats = np.ndarray[tuple[int, ...], np.dtype[np.float32]]
Floats = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Ints = np.ndarray[tuple[int, ...], np.dtype[np.int64]]
Marks = np.ndarray[tuple[int, ...], np.dtype[np.bool_]]


class _Tries(NamedTuple):
    """How places are drawn: most tilt (rad), whether rather near or rather far, and the limits of the distance (m)."""

    tilt: float
    near: bool
    nearest: float
    furthest: float


@dataclass(frozen=True, eq=False)
class SeeableSides:
    """Sides that can be seen from somewhere.

    Attributes:
        which: their numbers among those asked about, ascending, shape (S,).
        times: how many of the first tries saw each, shape (S,).
        places: places that see one of them, about the structure's middle, shape (W, 3), float32.
        seen: which of the S each of those places sees, shape (W,).
    """

    which: NDArray[np.int64]
    times: NDArray[np.int64]
    places: NDArray[np.float32]
    seen: NDArray[np.int64]


def joined(first: SeeableSides, second: SeeableSides) -> SeeableSides:
    """Two findings as one; `which` counts only within each."""
    return SeeableSides(
        np.concatenate([first.which, second.which]),
        np.concatenate([first.times, second.times]),
        np.concatenate([first.places, second.places]),
        np.concatenate([first.seen, second.seen + len(first.which)]),
    )


def find_seeable(
    sides: Targets,
    nearest_m: float,
    furthest_m: float,
    limits: PictureLimits,
    space: FreeSpace,
    sight: SightLines,
    rng: np.random.Generator,
    poll: Callable[[float], None],
) -> SeeableSides:
    """Try random places in front of every side.

    A place counts if it is free, connected with home, within the camera's pitch range and in sight of the side.

    Args:
        sides: what is asked about.
        nearest_m: smallest distance of a place from its side.
        furthest_m: largest distance.
        limits: incidence and pitch.
        space: where the vehicle may be.
        sight: what hides them.
        rng: the source of randomness.
        poll: told the share that is done; may raise.
    """
    times = np.zeros(len(sides), dtype=np.int64)
    found = np.zeros(len(sides), dtype=np.bool_)
    places: list[NDArray[np.float32]] = []
    seen: list[NDArray[np.int64]] = []
    steepest = STEEPEST * math.acos(limits.least_cosine)
    low = space.low_m - sight.middle_m
    rounds = TRIES + MORE_TRIES + LAST_TRIES
    cells = space.reachable_mask

    for round_ in range(rounds):
        exact = round_ >= TRIES + MORE_TRIES
        if round_ == TRIES + MORE_TRIES:
            cells = _widened(space.reachable_mask, LINK_REACH)
        todo = np.arange(len(sides)) if round_ < TRIES else np.flatnonzero(~found)
        if not len(todo):
            break
        draws = rng.random((len(todo), 3), dtype=np.float32)
        tilt = 0.0 if round_ == 0 else steepest
        tries = _Tries(tilt, round_ % 2 == 0, nearest_m, furthest_m)
        look = partial(_look, sides.points, sides.normals, todo, draws, tries, limits, cells, low, space.pitch_m, sight)
        got = in_threads(look, range(0, len(todo), SIDES_AT_A_TIME), partial(_tell, poll, round_, rounds))
        which = np.concatenate([g[0] for g in got])
        where = np.concatenate([g[1] for g in got])
        if exact:
            ok = space.is_reachable(where.astype(np.float64) + sight.middle_m)
            which, where = which[ok], where[ok]
        if round_ < TRIES:
            times[which] += 1
        found[which] = True
        places.append(where)
        seen.append(which)
    seeable = np.flatnonzero(found)
    number = np.cumsum(found) - 1
    return SeeableSides(seeable, times[seeable], np.concatenate(places), number[np.concatenate(seen)])


def _tell(poll: Callable[[float], None], round_: int, rounds: int, share: float) -> None:
    poll((round_ + share) / rounds)


def _look(
    points: SingleFloats,
    normals: SingleFloats,
    todo: Ints,
    draws: SingleFloats,
    tries: _Tries,
    limits: PictureLimits,
    cells: Marks,
    low: Floats,
    pitch: float,
    sight: SightLines,
    first: int,
) -> tuple[Ints, SingleFloats]:
    """The sides, from the first on, that a place in an allowed cell sees, and those places."""
    part = slice(first, first + SIDES_AT_A_TIME)
    which, *rays = _rays_from_places(points, normals, todo[part], draws[part], tries, limits, cells, low, pitch)
    clear = sight.clear_rays(Rays(*rays))
    return which[clear], rays[0][clear]


@compiled
def _rays_from_places(
    points: SingleFloats,
    normals: SingleFloats,
    which: Ints,
    draws: SingleFloats,
    tries: _Tries,
    limits: PictureLimits,
    cells: Marks,
    low: Floats,
    pitch: float,
) -> tuple[Ints, SingleFloats, SingleFloats, SingleFloats]:
    """A place in front of each side; of those that are allowed the side's number and the ray to it."""
    n = which.shape[0]
    kept = np.empty(n, np.int64)
    origins, directions, lengths = np.empty((n, 3), np.float32), np.empty((n, 3), np.float32), np.empty(n, np.float32)
    place = np.empty(3)
    lowest, highest = math.sin(limits.pitch_low), math.sin(limits.pitch_high)
    count = 0
    for w in range(n):
        s = which[w]
        nx, ny, nz = normals[s, 0], normals[s, 1], normals[s, 2]
        # two directions square to the normal
        if abs(nz) < 0.9:
            size = math.hypot(nx, ny)
            ux, uy, uz = ny / size, -nx / size, 0.0
        else:
            size = math.hypot(ny, nz)
            ux, uy, uz = 0.0, nz / size, -ny / size
        vx, vy, vz = ny * uz - nz * uy, nz * ux - nx * uz, nx * uy - ny * ux
        tilt, azimuth = tries.tilt * math.sqrt(draws[w, 0]), 2.0 * math.pi * draws[w, 1]
        along, a, b = math.cos(tilt), math.sin(tilt) * math.cos(azimuth), math.sin(tilt) * math.sin(azimuth)
        x, y, z = along * nx + a * ux + b * vx, along * ny + a * uy + b * vy, along * nz + a * uz + b * vz
        if -z < lowest or -z > highest:
            continue
        share = draws[w, 2] * draws[w, 2] if tries.near else math.sqrt(draws[w, 2])
        length = tries.nearest + (tries.furthest - tries.nearest) * share
        place[0], place[1], place[2] = points[s, 0] + length * x, points[s, 1] + length * y, points[s, 2] + length * z
        i = math.floor((place[0] - low[0]) / pitch)
        j = math.floor((place[1] - low[1]) / pitch)
        k = math.floor((place[2] - low[2]) / pitch)
        if not (0 <= i < cells.shape[0] and 0 <= j < cells.shape[1] and 0 <= k < cells.shape[2] and cells[i, j, k]):
            continue
        kept[count] = s
        x = points[s, 0] + LIFT_M * nx - place[0]
        y = points[s, 1] + LIFT_M * ny - place[1]
        z = points[s, 2] + LIFT_M * nz - place[2]
        length = math.sqrt(x * x + y * y + z * z)
        directions[count, 0], directions[count, 1], directions[count, 2] = x / length, y / length, z / length
        lengths[count] = length - LAST_PIECE_M
        for c in range(3):
            origins[count, c] = place[c]
        count += 1
    return kept[:count].copy(), origins[:count].copy(), directions[:count].copy(), lengths[:count].copy()


def _widened(cells: Marks, reach: int) -> Marks:
    """Cells and those at most `reach` cells away from one on every axis."""
    result = cells
    for axis in range(3):
        narrow = result
        result = narrow.copy()
        for step in range(1, reach + 1):
            ahead = [slice(None)] * 3
            behind = [slice(None)] * 3
            ahead[axis], behind[axis] = slice(step, None), slice(None, -step)
            result[tuple(ahead)] |= narrow[tuple(behind)]
            result[tuple(behind)] |= narrow[tuple(ahead)]
    return result
