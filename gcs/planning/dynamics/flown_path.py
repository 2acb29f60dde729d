"""Figures of a flown path beside a planned curve: how far it goes from it, when, and how near it comes to the scene."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gcs.planning.numerics.compiled import compiled

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from gcs.planning.dynamics.predicted_flight import PredictedFlight
    from gcs.planning.scene.point_distance import SceneDistance

Floats = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Indices = np.ndarray[tuple[int, ...], np.dtype[np.int64]]

CURVE_STEP_M = 0.05
SEARCH_M = 25.0
"""The nearest point of the curve is looked for from where the last one was, this far ahead: a curve that comes back to
the same place must not hide that the vehicle is late."""

AHEAD_SHARE = 0.1
"""Each metre ahead counts like this much more distance (in squares): of two passes of the curve by the same place it is
the next one that is flown."""

START_M = 0.3
END_M = 0.5
"""The time and the deviation count from this far after the curve's start to this far before its end."""


@dataclass(frozen=True)
class FlownDeviation:
    """A flown path beside the curve it was to follow.

    Attributes:
        mean_m: mean distance from the curve, by the curve's length.
        max_m: largest distance.
        max_at_s: when that is.
        time_s: how long it took from the curve's start to its end.
        complete: whether it came to the curve's end.
    """

    mean_m: float
    max_m: float
    max_at_s: float
    time_s: float
    complete: bool


@dataclass(frozen=True)
class FlownClearance:
    """Where a flown path comes nearest to the scene.

    Attributes:
        hull_m: distance of the hull to the nearest surface, cable or the ground.
        at_s: when.
        place_m: the vehicle's centre then.
    """

    hull_m: float
    at_s: float
    place_m: tuple[float, float, float]


def deviation_from_curve(flight: PredictedFlight, curve_m: ArrayLike) -> FlownDeviation:
    """Compare a flight with a curve.

    Args:
        flight: what was flown.
        curve_m: points of the curve in order, close enough for straight lines between them, shape (K, 3).
    """
    curve = _evenly(np.asarray(curve_m, dtype=np.float64))
    positions = np.ascontiguousarray(flight.position_m)
    nearest, apart = np.empty(len(positions), dtype=np.int64), np.empty(len(positions))
    _walk(positions, curve, round(SEARCH_M / CURVE_STEP_M), AHEAD_SHARE * CURVE_STEP_M, nearest, apart)
    along = CURVE_STEP_M * nearest
    length = CURVE_STEP_M * (len(curve) - 1)
    first = int(np.argmax(along > START_M)) if (along > START_M).any() else 0
    complete = bool(along[-1] > length - END_M)
    last = int(np.argmax(along > length - END_M)) if complete else len(along) - 1
    last = max(last, min(first + 1, len(along) - 1))
    part = slice(first, last + 1)
    worst = first + int(np.argmax(apart[part]))
    steps = np.arange(along[first], max(along[last], along[first] + CURVE_STEP_M), 2 * CURVE_STEP_M)
    return FlownDeviation(
        mean_m=float(np.interp(steps, along[part], apart[part]).mean()),
        max_m=float(apart[worst]),
        max_at_s=float(flight.time_s[worst]),
        time_s=float(flight.time_s[last] - flight.time_s[first]),
        complete=complete,
    )


def clearance_of_flight(
    flight: PredictedFlight, scene: SceneDistance, radius_m: float, home_m: ArrayLike, column_m: float
) -> FlownClearance:
    """Where a flight comes nearest to the scene, by exact distances at its samples.

    Args:
        flight: what is flown.
        scene: all that may not be touched.
        radius_m: of the vehicle.
        home_m: the column above it is exempt from the ground, shape (3,).
        column_m: half the column's width.
    """
    home = np.asarray(home_m, dtype=np.float64)
    beside = np.linalg.norm(flight.position_m[:, :2] - home[:2], axis=1)
    distance = scene.distance(flight.position_m, ground=beside > column_m)
    worst = int(np.argmin(distance))
    x, y, z = (float(v) for v in flight.position_m[worst])
    return FlownClearance(float(distance[worst]) - radius_m, float(flight.time_s[worst]), (x, y, z))


def _evenly(curve: NDArray[np.float64]) -> NDArray[np.float64]:
    """The curve's points at equal steps of its length, shape (M, 3), M >= 2."""
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=1))])
    keep = np.concatenate([[True], np.diff(way) > 1e-12])
    marks = CURVE_STEP_M * np.arange(max(math.floor(way[-1] / CURVE_STEP_M), 1) + 1)
    return np.stack([np.interp(marks, way[keep], curve[keep, k]) for k in range(3)], axis=1)


@compiled
def _walk(positions: Floats, curve: Floats, window: int, ahead: float, nearest: Indices, apart: Floats) -> None:
    """The nearest point of the curve for each position, never going back along it."""
    at = 0
    for i in range(positions.shape[0]):
        best = math.inf
        found = at
        for k in range(at, min(at + window, curve.shape[0])):
            cost = (ahead * (k - at)) ** 2
            for axis in range(3):
                cost += (positions[i, axis] - curve[k, axis]) ** 2
            if cost < best:
                best, found = cost, k
        apart[i] = math.sqrt(best - (ahead * (found - at)) ** 2)
        at = found
        nearest[i] = at
