"""Few straight legs that follow a curve: what a mission of waypoints can fly of a trajectory.

An autopilot flies straight lines between waypoints, and slows down the more of them there are. So points are placed
only where the chord error asks for them (Ramer-Douglas-Peucker, then points that turned out superfluous are dropped);
a straight stays one leg.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike, NDArray

    from gcs.core.trajectory import PiecewisePolynomial

CHORD_ERROR_M = 0.3
_SAMPLE_S = 0.02
_SAMPLE_M = 0.05
_COLUMN_M = 0.05
"""Within this horizontal distance of home the climb and the descent count as vertical."""


@dataclass(frozen=True, eq=False)
class MissionPath:
    """A trajectory as straight legs.

    Attributes:
        takeoff_m: top of the vertical climb over home, shape (3,).
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

    Args:
        trajectory: the curve, scene ENU.
        stop_times_s: when each viewpoint is photographed (s on the trajectory), increasing; the curve is at rest there.
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
    climb_end = _column_end(trajectory, home[0], np.arange(times[0], times[1], _SAMPLE_S), times[1])
    descent_start = _column_end(trajectory, home[1], np.arange(times[-1], times[-2], -_SAMPLE_S), times[-2])
    times[0], times[-1] = climb_end, descent_start
    legs, worst = [], 0.0
    for start, end in itertools.pairwise(times):
        curve = _dense(trajectory, start, end)
        kept = _simplify(curve, chord_error_m)
        worst = max(worst, chord_error(curve, curve[kept]))
        legs.append(curve[kept[1:]])
    return MissionPath(trajectory.value(climb_end), tuple(legs), worst)


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
    trajectory: PiecewisePolynomial, home_m: NDArray[np.float64], times_s: NDArray[np.float64], last_s: float
) -> float:
    """The last of the times up to which the curve stays over home without a break; `last_s` if it always does."""
    points = trajectory.value(times_s)
    away = np.linalg.norm(points[:, :2] - home_m[:2], axis=1) > _COLUMN_M
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


def _simplify(curve: NDArray[np.float64], tolerance: float) -> list[int]:
    """Indices of the points that are kept, both ends among them."""
    kept = [0, len(curve) - 1]
    spans = [(0, len(curve) - 1)]
    while spans:
        a, b = spans.pop()
        if b - a < 2:
            continue
        apart = _segment_distance(curve[a + 1 : b], curve[a], curve[b])
        if apart.max() > tolerance:
            split = a + 1 + int(np.argmax(apart))
            kept.append(split)
            spans += [(a, split), (split, b)]
    kept.sort()
    position = 1
    while position < len(kept) - 1:
        a, b = kept[position - 1], kept[position + 1]
        if _segment_distance(curve[a : b + 1], curve[a], curve[b]).max() <= tolerance:
            del kept[position]
        else:
            position += 1
    return kept


def _segment_distance(
    points: NDArray[np.float64], a: NDArray[np.float64], b: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Distance of points of shape (N, 3) from the segment between two points."""
    along = b - a
    length2 = float(along @ along)
    share = np.clip((points - a) @ along / length2, 0.0, 1.0) if length2 > 0 else np.zeros(len(points))
    return np.asarray(np.linalg.norm(points - a - share[:, None] * along, axis=1))
