"""Safety rule 6 for what the lidar sees: slower, where the vehicle's own stop after a lost stream would meet it.

What it sweeps then is a straight segment along its velocity (`gcs.planning.trajectories.stream_loss`). Its geometry
stays: the same curve is flown by a time warp that begins at the present motion. Where an obstacle was seen too late to
slow down before it, the vehicle slows down as hard as it may.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import minimum_filter1d

from gcs.core.trajectory import PiecewisePolynomial
from gcs.planning.local.curve_parts import joined_curves, part_of_curve
from gcs.planning.trajectories.flight_limits import TOLERANCE
from gcs.planning.trajectories.retiming import TimeWarp
from gcs.planning.trajectories.warped_curve import hermite_pieces

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from gcs.planning.local.binary_map import BinaryMap
    from gcs.planning.trajectories.flight_limits import FlightLimits
    from gcs.planning.trajectories.stream_loss import StreamLoss

LOOK_AHEAD_S, ACTS_S = 10.0, 6.0
"""The curve is judged for so long, and slowed down where that is needed within the first part: then it may speed up."""

STEP_S = 0.05
SLOWEST_M_S = 0.3
"""The vehicle is not slowed below this, however near something is: it would not get away from there either."""

WORTH = 0.97
"""Rates above this are as good as 1."""

REACH = 2
"""Rates are averaged twice over so many steps to each side, so that they have no kinks."""

BRAKING_SHARES = (0.7, 0.5, 0.35, 0.2)
"""Tried shares of the acceleration limit for changes of the rate; the curve's own acceleration comes on top."""

STEEPEST_PER_S = 2.0
"""Largest change of the squared rate per second of the curve, also where the vehicle hardly moves."""

KNOT_S = 0.1


@dataclass(frozen=True)
class StreamLossRule:
    """What has to stay clear when setpoints stop.

    Attributes:
        loss: what the vehicle does then.
        keep_m: its centre keeps this from what is seen: hull, and the errors of place and map.
    """

    loss: StreamLoss
    keep_m: float


@dataclass(frozen=True, eq=False)
class SlowedCurve:
    """The same way, slower in places.

    Attributes:
        curve: on its own time from 0.
        flown_s: times on it, rising from 0, shape (K,) ...
        before_s: ... and the times on the curve it was made of ...
        pace: ... which behind the last is flown at this rate.
    """

    curve: PiecewisePolynomial
    flown_s: NDArray[np.float64]
    before_s: NDArray[np.float64]
    pace: float

    def time_of(self, before_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Times on it of times on the curve it was made of, of any shape."""
        inside = np.interp(before_s, self.before_s, self.flown_s)
        return np.asarray(inside + np.maximum(before_s - self.before_s[-1], 0.0) / self.pace)


def slowed_for_stream_loss(
    curve: PiecewisePolynomial, near: BinaryMap, loss: StreamLoss, limits: FlightLimits
) -> SlowedCurve | None:
    """Slow a curve down where the stop after a lost stream would end in what is seen.

    Args:
        curve: flown from its time 0 on, scene ENU.
        near: cells of the plane that are too near to what is seen.
        loss: what the vehicle does when setpoints stop.
        limits: kept by the slowed motion where the curve itself keeps them.

    Returns:
        None when it is slow enough, or cannot be made slower.
    """
    ahead_s = min(curve.duration_s, LOOK_AHEAD_S)
    times = np.linspace(0.0, ahead_s, max(math.ceil(ahead_s / STEP_S), 2) + 1)
    caps = _caps(curve, times, near, loss)
    if ahead_s < curve.duration_s:
        caps[times > ACTS_S] = 1.0
    if caps.min() > WORTH:
        return None
    step = float(times[1])
    # Half-way to the next sample, and as far as the averages reach, the caps hold too.
    caps = minimum_filter1d(caps, 4 * REACH + 3, mode="nearest")
    speed = np.linalg.norm(curve.value(times, 1), axis=1)
    for share in BRAKING_SHARES:
        rates = _rates(caps, speed, step, share * limits.acceleration_m_s2)
        slowed = _flown(curve, times, rates)
        if _holds(slowed, curve, limits):
            return slowed
    return None


def _caps(
    curve: PiecewisePolynomial, times: NDArray[np.float64], near: BinaryMap, loss: StreamLoss
) -> NDArray[np.float64]:
    """Largest rates at times (N,) whose segments keep clear."""
    velocity = curve.value(times, 1)
    speed = np.maximum(np.linalg.norm(velocity, axis=1), 1e-9)
    direction = velocity / speed[:, None]
    free = _free_lengths(curve.value(times)[:, :2], direction[:, :2], loss.swept_m(speed), near)
    return np.asarray(np.minimum(1.0, np.maximum(loss.speed_for(free), SLOWEST_M_S) / speed))


def _free_lengths(
    places: NDArray[np.float64], directions: NDArray[np.float64], needed: NDArray[np.float64], near: BinaryMap
) -> NDArray[np.float64]:
    """How far straight segments from places (N, 2) along directions (N, 2) get; what is off the map is free."""
    step = near.cell_m / 2
    along = step * np.arange(math.ceil(float(needed.max()) / step) + 1)
    points = places[:, None] + along[None, :, None] * directions[:, None]
    cells = np.floor(near.cells(points)).astype(np.int64)
    on_map = np.asarray(((cells >= 0) & (cells < near.blocked.shape)).all(axis=2))
    cells = np.where(on_map[..., None], cells, 0)
    met = on_map & near.blocked[cells[..., 0], cells[..., 1]] & (along[None, :] <= needed[:, None] + step)
    first = np.where(met.any(axis=1), along[met.argmax(axis=1)], np.inf)
    return np.asarray(np.maximum(first - step, 0.0))


def _rates(
    caps: NDArray[np.float64], speed: NDArray[np.float64], step_s: float, braking_m_s2: float
) -> NDArray[np.float64]:
    """Rates from 1 on under caps, as far as braking allows, smooth."""
    steepest = np.minimum(2 * braking_m_s2 / np.maximum(speed, 1e-9), STEEPEST_PER_S)
    room = np.concatenate([[0.0], np.cumsum((steepest[1:] + steepest[:-1]) / 2 * step_s)])
    squared = np.minimum.accumulate((caps**2 + room)[::-1])[::-1] - room
    braked = 1.0 - np.maximum(room - room[min(2 * REACH, len(room) - 1)], 0.0)  # the present pace lasts that long
    squared = np.maximum(squared, braked)
    squared = np.minimum(np.minimum.accumulate(squared - room) + room, 1.0)
    kernel = np.ones(2 * REACH + 1) / (2 * REACH + 1)
    kernel = np.convolve(kernel, kernel)
    padded = np.pad(np.sqrt(squared), 2 * REACH, mode="edge")
    return np.asarray(np.convolve(padded, kernel, mode="valid"))


def _flown(curve: PiecewisePolynomial, times: NDArray[np.float64], rates: NDArray[np.float64]) -> SlowedCurve:
    warp = TimeWarp(times, rates)
    count = max(2, math.ceil(warp.duration_s / KNOT_S))
    knots = np.linspace(0.0, warp.duration_s, count + 1)
    at = warp.setpoint(curve, knots)
    slow = PiecewisePolynomial(hermite_pieces(*at, step_s=float(knots[1])), np.diff(knots))
    end_s, pace = float(times[-1]), float(rates[-1])
    if end_s < curve.duration_s:
        rest = part_of_curve(curve, end_s, curve.duration_s)
        slow = joined_curves(slow, PiecewisePolynomial(rest.coefficients, rest.durations_s / pace))
    return SlowedCurve(slow, knots, warp.plan_time(knots), pace)


def _holds(slowed: SlowedCurve, curve: PiecewisePolynomial, limits: FlightLimits) -> bool:
    """Whether the acceleration stays within the limit, or within what the curve itself has."""
    middles = (slowed.flown_s[1:] + slowed.flown_s[:-1]) / 2
    times = np.sort(np.concatenate([slowed.flown_s, middles]))
    reached = np.linalg.norm(slowed.curve.value(times, 2), axis=1)
    before = np.minimum(np.interp(times, slowed.flown_s, slowed.before_s), curve.duration_s)
    own = np.linalg.norm(curve.value(before, 2), axis=1)
    return bool((reached <= np.maximum(limits.acceleration_m_s2, own) * (1 + TOLERANCE)).all())
