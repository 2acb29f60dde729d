"""String pulling: a grid path is shortened to few straight legs, each proved free."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gcs.planning.numerics.compiled import compiled
from gcs.planning.scene.open_sky import OpenSky, covered_length
from gcs.planning.scene.room import RoomModel, room_at, segment_free

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from gcs.planning.scene.free_space import FreeSpace

SWEEPS = 12
WORTHWHILE = 1e-3
"""Sweeps end when one shortens the path by less than this share."""

BISECTIONS = 7
CUTS = 2
"""How often corners are cut: so many times two corners may take the place of one."""

LEAST_SAVING_M, LEAST_SAVING_SHARE = 0.02, 1e-3
"""What one more corner has to save, and which share of the path's length."""

TOUCHING_M = 0.1
"""A leg with less room than this to spare touches something."""

TOUCHING_STEP_M = 1e-3
LEAST_SLIDE_M = 1e-3
"""What a slide has to save."""

LEAST_SINE = 0.05
"""Normals of two touched surfaces nearer to each other than this are one."""

COVER_ROUNDING_M = 1e-6
NEITHER = -1

Floats = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Marks = np.ndarray[tuple[int, ...], np.dtype[np.bool_]]


def pull_string(
    space: FreeSpace, path_m: NDArray[np.float64], *, keep_open_sky: bool = True, model: RoomModel | None = None
) -> NDArray[np.float64]:
    """Shorten a free path between its fixed ends.

    Drops every corner that can be skipped and moves the others inwards as far as the space allows, in turns; then
    cuts corners where that saves enough, and settles the rest again.

    Args:
        space: where the path may run.
        path_m: corner points of a free path, shape (K, 3).
        keep_open_sky: whether a change may not lengthen the part that is not under the open sky.
        model: of the space that changes have to stay in; the wide one by default.

    Returns:
        Corner points with the same first and last point, shape (L, 3), never longer than before.
    """
    path = np.ascontiguousarray(path_m, dtype=np.float64)
    if len(path) < 3:
        return path
    return _pull(path[_corners(path)], model or space.wide_model, space.sky, keep_open_sky)


def path_length(path_m: NDArray[np.float64]) -> float:
    """Length (m) of a polyline (K, 3)."""
    return float(np.linalg.norm(np.diff(path_m, axis=0), axis=1).sum())


def _corners(path: NDArray[np.float64]) -> Marks:
    """Points that are not in the middle of a straight run."""
    before = path[1:-1] - path[:-2]
    after = path[2:] - path[1:-1]
    turn = np.linalg.norm(np.cross(before, after), axis=1)
    straight = (turn < 1e-9) & (np.einsum("ij,ij->i", before, after) > 0)
    return np.concatenate([[True], ~straight, [True]])


@compiled
def _distance(a: Floats, b: Floats) -> float:
    return float(np.sqrt((b[0] - a[0]) ** 2 + (b[1] - a[1]) ** 2 + (b[2] - a[2]) ** 2))


@compiled
def _length(path: Floats) -> float:
    length = 0.0
    for i in range(1, path.shape[0]):
        length += _distance(path[i - 1], path[i])
    return length


@compiled
def _free(a: Floats, b: Floats, model: RoomModel) -> bool:
    return segment_free(a, b, model.tolerance, model)


@compiled
def _pull(path: Floats, model: RoomModel, sky: OpenSky, keep: bool) -> Floats:
    path = _settle(path, model, sky, keep)
    for _ in range(CUTS):
        corners = path.shape[0]
        path = _settle(_cut_corners(path, model, sky, keep), model, sky, keep)
        if path.shape[0] == corners:
            break
    return path


@compiled
def _settle(path: Floats, model: RoomModel, sky: OpenSky, keep: bool) -> Floats:
    path = _skip(path, model, sky, keep)
    for _ in range(SWEEPS):
        gained, length = _tighten(path, model, sky, keep)
        if gained < WORTHWHILE * length:
            break
        path = _skip(path, model, sky, keep)
    return _distinct(path)


@compiled
def _distinct(path: Floats) -> Floats:
    """Without corners that were moved onto the one before, or onto the end."""
    kept = np.ones(path.shape[0], np.bool_)
    last = path.shape[0] - 1
    at = 0
    for i in range(1, last):
        if _distance(path[at], path[i]) == 0.0 or _distance(path[i], path[last]) == 0.0:
            kept[i] = False
        else:
            at = i
    return path[kept]


@compiled
def _skip(path: Floats, model: RoomModel, sky: OpenSky, keep: bool) -> Floats:
    """From each kept point on to the furthest one that is seen along a free segment."""
    n = path.shape[0]
    covered = np.zeros(n)
    if keep:
        for i in range(1, n):
            covered[i] = covered[i - 1] + covered_length(path[i - 1], path[i], sky)
    kept = np.zeros(n, np.bool_)
    kept[0] = True
    i = 0
    while i < n - 1:
        j = n - 1
        while j > i + 1:
            allowed = covered[j] - covered[i] + COVER_ROUNDING_M
            if (not keep or covered_length(path[i], path[j], sky) <= allowed) and _free(path[i], path[j], model):
                break
            j -= 1
        kept[j] = True
        i = j
    return path[kept]


@compiled
def _cut_corners(path: Floats, model: RoomModel, sky: OpenSky, keep: bool) -> Floats:
    """Put two corners in the place of one where that saves enough; the longest cut that is free is taken."""
    least_saving = max(LEAST_SAVING_M, LEAST_SAVING_SHARE * _length(path))
    result = [path[0]]
    for i in range(1, path.shape[0] - 1):
        a, b, c = path[i - 1], path[i], path[i + 1]
        first, second = _distance(a, b), _distance(b, c)
        most = 0.5 * min(first, second)
        low, high, saved = 0.0, most, 0.0
        for turn in range(BISECTIONS):
            cut = high if turn == 0 else (low + high) / 2
            before, after = b + (a - b) * (cut / first), b + (c - b) * (cut / second)
            allowed = COVER_ROUNDING_M
            if keep:
                allowed += covered_length(before, b, sky) + covered_length(b, after, sky)
            clear = not keep or covered_length(before, after, sky) <= allowed
            if clear and _free(before, after, model):
                low, saved = cut, 2 * cut - _distance(before, after)
                if turn == 0:
                    break
            else:
                high = cut
        if saved >= least_saving:
            result.append(b + (a - b) * (low / first))
            result.append(b + (c - b) * (low / second))
        else:
            result.append(b)
    result.append(path[-1])
    cut_path = np.empty((len(result), 3))
    for i in range(len(result)):
        cut_path[i] = result[i]
    return cut_path


@compiled
def _tighten(path: Floats, model: RoomModel, sky: OpenSky, keep: bool) -> tuple[float, float]:
    """Move each inner corner as far as it may go: inwards, along its legs, along what they touch; all of it shortens.

    Returns:
        The length gained and the length before.
    """
    gained, length = 0.0, _length(path)
    for i in range(1, path.shape[0] - 1):
        a, c = path[i - 1], path[i + 1]
        before = _distance(a, path[i]) + _distance(path[i], c)
        if before == 0.0:
            continue
        inwards = a + (c - a) * (_distance(a, path[i]) / before)
        path[i] = _moved(a, path[i], c, inwards, NEITHER, model, sky, keep)
        path[i] = _moved(a, path[i], c, a, 0, model, sky, keep)
        path[i] = _moved(a, path[i], c, c, 1, model, sky, keep)
        aside = _slide(a, path[i], c, model)
        if _distance(a, aside) + _distance(aside, c) < _distance(a, path[i]) + _distance(path[i], c) - LEAST_SLIDE_M:
            path[i] = _moved(a, path[i], c, aside, NEITHER, model, sky, keep)
        gained += before - _distance(a, path[i]) - _distance(path[i], c)
    return gained, length


@compiled
def _slide(a: Floats, b: Floats, c: Floats, model: RoomModel) -> Floats:
    """The best place for the corner `b` between `a` and `c` along the surfaces that its legs touch.

    A taut corner cannot move inwards, but where the legs may slide along what they touch (up a mast, along a beam) the
    line of that slide, perpendicular to the surfaces' normals, is as good as unfolded: on it the best place is where
    the two legs make a straight.
    """
    towards = (a - b) / max(_distance(a, b), 1e-9) + (c - b) / max(_distance(b, c), 1e-9)
    first, second = _touched(a, b, model), _touched(b, c, model)
    off = TOUCHING_STEP_M * (first + second)  # or rounding would hold it back
    second = second - np.dot(second, first) * first
    size = np.sqrt(np.dot(second, second))
    if size > LEAST_SINE:
        second /= size
    else:
        second[:] = 0.0
    towards = towards - np.dot(towards, first) * first
    towards -= np.dot(towards, second) * second
    size = np.sqrt(np.dot(towards, towards))
    if size < 1e-6:
        return b
    towards /= size
    ahead, behind = np.dot(a - b, towards), np.dot(c - b, towards)
    aside, beside = _distance(a, b + ahead * towards), _distance(c, b + behind * towards)
    if aside + beside < 1e-9:
        return b
    best: Floats = b + (ahead * beside + behind * aside) / (aside + beside) * towards + off
    return best


@compiled
def _touched(a: Floats, b: Floats, model: RoomModel) -> Floats:
    """Unit normal (3,) of what a free leg comes nearest to, away from it; zeros where it touches nothing."""
    length = _distance(a, b)
    at, least, nearest = 0.0, np.inf, 0.0
    while True:
        room = room_at(a + (b - a) * (at / max(length, 1e-9)), model)
        if room < least:
            least, nearest = room, at
        if at >= length:
            break
        at = min(at + max(room, model.tolerance), length)
    normal = np.zeros(3)
    if least > model.tolerance + TOUCHING_M:
        return normal
    point = a + (b - a) * (nearest / max(length, 1e-9))
    for k in range(3):
        offset = np.zeros(3)
        offset[k] = TOUCHING_STEP_M
        normal[k] = room_at(point + offset, model) - room_at(point - offset, model)
    size = np.sqrt(np.dot(normal, normal))
    if size > 0.0:
        normal /= size
    return normal


@compiled
def _moved(
    a: Floats, b: Floats, c: Floats, to: Floats, along: int, model: RoomModel, sky: OpenSky, keep: bool
) -> Floats:
    """The corner `b` between `a` and `c`, moved towards a point as far as both legs stay free.

    When it moves along a leg (0: the first, 1: the second), what is left of that leg is known to be free.
    """
    allowed = COVER_ROUNDING_M
    if keep:
        allowed += covered_length(a, b, sky) + covered_length(b, c, sky)
    low, high = 0.0, 1.0
    for turn in range(BISECTIONS):
        share = high if turn == 0 else (low + high) / 2
        moved = b + share * (to - b)
        clear = not keep or covered_length(a, moved, sky) + covered_length(moved, c, sky) <= allowed
        if clear and (along == 0 or _free(a, moved, model)) and (along == 1 or _free(moved, c, model)):
            low = share
            if turn == 0:
                break
        else:
            high = share
    return b + low * (to - b)
