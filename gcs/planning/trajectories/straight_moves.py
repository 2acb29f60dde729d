"""Straight moves from corner to corner, at rest at each: the flight that every corridor has room for, however narrow.

Each straight is flown by the minimum-snap polynomial from rest to rest, `35 u^4 - 84 u^5 + 70 u^6 - 20 u^7`, in the
least time that the limits allow; it never leaves the straight. Its peaks are closed forms.
"""

from __future__ import annotations

import itertools
import math
from typing import TYPE_CHECKING

import numpy as np

from gcs.planning.numerics.bernstein import control_from_monomial

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from gcs.planning.trajectories.flight_limits import FlightLimits
    from gcs.planning.trajectories.safe_corridor import LegCorridor

SHARE = np.polynomial.Polynomial([0.0, 0, 0, 0, 35, -84, 70, -20])
"""Share of the way at a share of the time."""

PEAKS = np.array([35 / 16, 84 * math.sqrt(5) / 25, 52.5])
"""Largest first, second and third derivative of that, of any sign."""


def straight_times(leg: LegCorridor, limits: FlightLimits) -> NDArray[np.float64]:
    """Time (s) of each of a leg's straights, from rest to rest, shape (R,).

    Args:
        leg: the corridor.
        limits: one of them is reached on every straight.
    """
    joints = leg.joints_m[_runs(leg)]
    ways = np.diff(joints, axis=0)
    peaks = np.linalg.norm(ways, axis=1)[:, None] * PEAKS
    # It speeds up and slows down by the same, and tilt and thrust are not the same both ways.
    peaks[:, 1] = limits.acceleration_peaks(PEAKS[1] * np.stack([ways, -ways], axis=1))
    return limits.stretch(peaks)


def straight_moves(leg: LegCorridor, times_s: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The curve of the straight moves, a piece for each of the leg's boxes.

    Args:
        leg: the corridor.
        times_s: of each straight, shape (R,).

    Returns:
        Control points of the pieces, scene ENU m, shape (n, 8, 3), and their durations (s), shape (n,).
    """
    runs = _runs(leg)
    controls, durations = [], []
    for first, last, time in zip(runs[:-1], runs[1:], times_s, strict=True):
        start, way = leg.joints_m[first], leg.joints_m[last] - leg.joints_m[first]
        shares = (leg.joints_m[first : last + 1] - start) @ way / (way @ way)
        ends = np.array([0.0, *(_time_of(share) for share in shares[1:-1]), 1.0])
        for begin, end in itertools.pairwise(ends):
            part = np.asarray(SHARE(np.polynomial.Polynomial([begin, end - begin])).coef, dtype=np.float64)
            controls.append(start + control_from_monomial(part[:, None]) * way)
        durations.append(np.diff(ends) * time)
    return np.stack(controls), np.concatenate(durations)


def _runs(leg: LegCorridor) -> NDArray[np.int64]:
    """Joints at which a straight starts or ends."""
    direction = np.diff(leg.joints_m, axis=0) / leg.lengths_m[:, None]
    turns = np.linalg.norm(np.diff(direction, axis=0), axis=1) > 1e-7
    return np.concatenate([[0], np.flatnonzero(turns) + 1, [len(direction)]])


def _time_of(share: float) -> float:
    """Share of the time at which a share of the way is done, by bisection."""
    low, high = 0.0, 1.0
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if SHARE(middle) < share else (low, middle)
    return low
