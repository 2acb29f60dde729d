"""Few straight legs that follow a curve: what a mission of waypoints can fly of a trajectory.

An autopilot flies straight lines between waypoints, and slows down the more of them there are. So points are placed
only where the chord error asks for them: between two stops the fewest that keep it, by a shortest path over all chords
that do (H. Imai and M. Iri, Polygonal approximations of a curve, 1988), and among those the set whose longest error is
the least. A straight stays one leg.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.errors import InputError
from gcs.planning.numerics.compiled import compiled

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike, NDArray

    from gcs.core.trajectory import PiecewisePolynomial

Floats = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Indices = np.ndarray[tuple[int, ...], np.dtype[np.int64]]

CHORD_ERROR_M = 0.3
_SAMPLE_S = 0.02
_SAMPLE_M = 0.05
_MOST_ENDS = 240
_MOST_CORNERS = 40
_CORNER_COSINE = math.cos(math.radians(2.0))


@dataclass(frozen=True, eq=False)
class MissionPath:
    """A trajectory as straight legs.

    Attributes:
        takeoff_m: top of the vertical climb, exactly over home, shape (3,).
        legs_m: one leg a viewpoint and one back: points after the leg's start, the last is the viewpoint, or the top of
            the vertical descent; each of shape (K, 3), K >= 1.
        chord_error_m: largest distance of the curve from the straight legs.
    """

    takeoff_m: NDArray[np.float64]
    legs_m: tuple[NDArray[np.float64], ...]
    chord_error_m: float


def sample_mission_path(
    trajectory: PiecewisePolynomial,
    stop_times_s: Sequence[float],
    chord_error_m: float = CHORD_ERROR_M,
) -> MissionPath:
    """Find straight legs for a trajectory that starts and ends at home.

    While it stays within the chord error of the vertical through home it counts as climb or descent.

    Args:
        trajectory: the curve, scene ENU.
        stop_times_s: when each viewpoint is photographed (s on the trajectory), increasing; a mission stops there.
        chord_error_m: how far the curve may lie from the legs.

    Raises:
        InputError: a chord error that is not positive, or times out of order.
    """
    if not chord_error_m > 0:
        raise InputError("the chord error must be positive", field="chord_error_m")
    times = [0.0, *stop_times_s, trajectory.duration_s]
    if any(a > b for a, b in itertools.pairwise(times)):
        raise InputError("stop times must increase and lie on the trajectory", field="stop_times_s")
    home = trajectory.value(np.array([0.0, trajectory.duration_s]))
    up, down = np.arange(times[0], times[1], _SAMPLE_S), np.arange(times[-1], times[-2], -_SAMPLE_S)
    times[0] = _column_end(trajectory, home[0], up, times[1], chord_error_m)
    times[-1] = _column_end(trajectory, home[1], down, times[-2], chord_error_m)
    legs, worst = [], 0.0
    for leg, (start, end) in enumerate(itertools.pairwise(times)):
        curve = _dense(trajectory, start, end)
        line = curve.copy()
        if leg == 0:
            line[0, :2] = home[0, :2]
            takeoff = line[0].copy()
        if leg == len(times) - 2:
            line[-1, :2] = home[1, :2]
        kept = fewest_chords(line, chord_error_m)
        worst = max(worst, chord_error(curve, line[kept]))
        legs.append(line[kept[1:]])
    return MissionPath(takeoff, tuple(legs), worst)


def chord_error(curve_m: ArrayLike, polyline_m: ArrayLike) -> float:
    """Largest distance (m) of points of shape (N, 3) from the nearest leg of a polyline of shape (K, 3)."""
    curve = np.asarray(curve_m, dtype=np.float64)
    line = np.asarray(polyline_m, dtype=np.float64)
    if len(line) == 1:
        return float(np.linalg.norm(curve - line[0], axis=1).max())
    nearest = np.full(len(curve), np.inf)
    for a, b in itertools.pairwise(line):
        nearest = np.minimum(nearest, _segment_distance(curve, a, b))
    return float(nearest.max())


def _column_end(
    trajectory: PiecewisePolynomial,
    home_m: NDArray[np.float64],
    times_s: NDArray[np.float64],
    last_s: float,
    within_m: float,
) -> float:
    """The last of the times up to which the curve stays over home without a break; `last_s` if it always does."""
    points = trajectory.value(times_s)
    away = np.linalg.norm(points[:, :2] - home_m[:2], axis=1) > within_m
    if not away.any():
        return last_s
    return float(times_s[max(int(np.argmax(away)) - 1, 0)])


def _dense(trajectory: PiecewisePolynomial, start_s: float, end_s: float) -> NDArray[np.float64]:
    """Points of the curve about every 5 cm, both ends included, shape (N, 3) with N >= 2."""
    times = np.linspace(start_s, end_s, max(2, int(np.ceil((end_s - start_s) / _SAMPLE_S)) + 1))
    points = trajectory.value(times)
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    marks = np.floor(way / _SAMPLE_M)
    keep = np.concatenate([[True], np.diff(marks) > 0])
    keep[-1] = True
    return points[keep] if keep.sum() > 1 else points[[0, -1]]


def fewest_chords(curve_m: ArrayLike, chord_error_m: float) -> list[int]:
    """The fewest points of a curve whose chords keep an error, both ends among them.

    Args:
        curve_m: shape (N, 3), N >= 2.
        chord_error_m: how far the curve may lie from the chord over it.

    Returns:
        Indices, increasing. Of more than 240 points evenly chosen 240, and the sharpest corners, are looked at as ends
        of chords.
    """
    curve = np.ascontiguousarray(curve_m, dtype=np.float64)
    even = np.linspace(0, len(curve) - 1, min(len(curve), _MOST_ENDS)).round().astype(np.int64)
    ends = np.union1d(even, _corners(curve))
    before = np.empty(len(ends), dtype=np.int64)
    _shortest(curve, ends, chord_error_m, before)
    kept = [len(ends) - 1]
    while kept[-1] > 0:
        kept.append(int(before[kept[-1]]))
    return [int(ends[k]) for k in reversed(kept)]


def farthest_chords(curve_m: ArrayLike, chord_error_m: float) -> list[int]:
    """Points of a curve, each as far from the one before as the chord error lets it: quick, for long curves.

    Args:
        curve_m: shape (N, 3), N >= 2.
        chord_error_m: how far the curve may lie from the chord over it.

    Returns:
        Indices, increasing, both ends among them.
    """
    curve = np.ascontiguousarray(curve_m, dtype=np.float64)
    kept, last = [0], len(curve) - 1
    while kept[-1] < last:
        start = near = kept[-1]
        near, step = start + 1, 1
        while near < last and _error(curve, start, min(near + step, last)) <= chord_error_m:
            near = min(near + step, last)
            step *= 2
        far = min(near + step, last)
        while far - near > 1:
            middle = (near + far) // 2
            if _error(curve, start, middle) <= chord_error_m:
                near = middle
            else:
                far = middle
        kept.append(near)
    return kept


def _corners(curve: NDArray[np.float64]) -> NDArray[np.int64]:
    """Indices of the sharpest corners between a curve's points."""
    steps = np.diff(curve, axis=0)
    sizes = np.linalg.norm(steps, axis=1)
    product = sizes[1:] * sizes[:-1]
    cosine = np.einsum("ij,ij->i", steps[1:], steps[:-1]) / np.where(product > 0, product, 1.0)
    sharp = np.nonzero((cosine < _CORNER_COSINE) & (product > 0))[0]
    return np.asarray(1 + sharp[np.argsort(cosine[sharp])][:_MOST_CORNERS], dtype=np.int64)


@compiled
def _error(curve: Floats, first: int, last: int) -> float:
    """Largest distance of a curve's points from the chord between two of them."""
    length2 = 0.0
    for k in range(3):
        length2 += (curve[last, k] - curve[first, k]) ** 2
    worst = 0.0
    for i in range(first + 1, last):
        along, gap = 0.0, 0.0
        for k in range(3):
            along += (curve[i, k] - curve[first, k]) * (curve[last, k] - curve[first, k])
        share = min(max(along / length2, 0.0), 1.0) if length2 > 0.0 else 0.0
        for k in range(3):
            gap += (curve[i, k] - curve[first, k] - share * (curve[last, k] - curve[first, k])) ** 2
        worst = max(worst, gap)
    return math.sqrt(worst)


@compiled
def _shortest(curve: Floats, ends: Indices, most: float, before: Indices) -> None:
    """For each end the one before it on a path of the fewest chords from the first."""
    count = ends.shape[0]
    chords = np.full(count, count, dtype=np.int64)
    worst = np.full(count, np.inf)
    chords[0], worst[0] = 0, 0.0
    before[0] = 0
    for j in range(1, count):
        for i in range(j - 1, -1, -1):
            if chords[i] + 1 > chords[j]:
                continue
            error = _error(curve, ends[i], ends[j])
            # Neighbours always are a chord, whatever lies between two that are looked at.
            if error > most and i < j - 1:
                continue
            if chords[i] + 1 < chords[j] or max(worst[i], error) < worst[j]:
                chords[j], worst[j], before[j] = chords[i] + 1, max(worst[i], error), i


def _segment_distance(
    points: NDArray[np.float64], a: NDArray[np.float64], b: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Distance of points of shape (N, 3) from the segment between two points."""
    along = b - a
    length2 = float(along @ along)
    share = np.clip((points - a) @ along / length2, 0.0, 1.0) if length2 > 0 else np.zeros(len(points))
    return np.asarray(np.linalg.norm(points - a - share[:, None] * along, axis=1))
