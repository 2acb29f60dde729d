"""Time warps: the same path flown slower in places, without a jump in velocity or acceleration.

A warp says which plan time s is flown at which flight time t. Its rate ds/dt is between 0 and 1. With
`sigma = ds/dt` the velocity is `sigma v(s)` and the acceleration `sigma^2 a(s) + (d sigma/dt) v(s)`.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.ndimage import maximum_filter1d, minimum_filter1d
from scipy.optimize import brentq

from gcs.core.errors import InfeasibleError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from gcs.core.trajectory import PiecewisePolynomial

STEP_S = 0.02
"""Grid of plan time on which a warp is computed."""

BLEND_S = 0.12
"""Half-width in plan time over which the rate is averaged, so that it has no kinks."""

STEEPEST_PER_S = 1.0
"""Largest change of the rate per second of plan time, also where the vehicle hardly moves."""

_SHARE = 0.9
"""Share of the acceleration limit for the changes of the rate; averaging needs some room."""

_LOWERED = 0.97
_MOST_ROUNDS = 30


class Setpoint(NamedTuple):
    """Position (m), velocity (m/s) and acceleration (m/s^2) in scene ENU, shape (..., 3) each."""

    position_m: NDArray[np.float64]
    velocity_m_s: NDArray[np.float64]
    acceleration_m_s2: NDArray[np.float64]


class TimeWarp:
    """Plan time as a smooth function of flight time.

    The rate is a monotone cubic between the knots (continuous with its derivative), plan time its integral.

    Args:
        plan_times_s: grid of plan time from 0 to the plan's duration, strictly increasing, shape (N,).
        rates: rate at each, in (0, 1], shape (N,).
    """

    def __init__(self, plan_times_s: NDArray[np.float64], rates: NDArray[np.float64]) -> None:
        steps = 2 * np.diff(plan_times_s) / (rates[1:] + rates[:-1])
        times = np.concatenate([[0.0], np.cumsum(steps)])
        self._rate = PchipInterpolator(times, rates)
        self._slope = self._rate.derivative()
        self._plan = self._rate.antiderivative()
        self._end_s = float(times[-1])
        self._end_rate = float(rates[-1])
        self.plan_duration_s = float(plan_times_s[-1])
        # The cubic's integral is a little off the trapezium's: the end comes that much later or earlier.
        self.duration_s = self._end_s + (self.plan_duration_s - float(self._plan(self._end_s))) / self._end_rate

    def plan_time(self, t_s: ArrayLike) -> NDArray[np.float64]:
        """Plan time (s) at flight times (s) of any shape; held at the ends."""
        t = np.asarray(t_s, dtype=np.float64)
        beyond = np.maximum(t - self._end_s, 0.0) * self._end_rate
        inside = np.clip(t, 0.0, self._end_s)
        return np.asarray(np.clip(self._plan(inside) + beyond, 0.0, self.plan_duration_s))

    def time_of(self, plan_time_s: float) -> float:
        """Flight time (s) at which a plan time is reached; held at the ends."""
        if plan_time_s <= 0.0:
            return 0.0
        if plan_time_s >= self.plan_duration_s:
            return self.duration_s
        return float(brentq(lambda t: float(self.plan_time(t)) - plan_time_s, 0.0, self.duration_s, xtol=1e-9))

    def rate(self, t_s: ArrayLike) -> NDArray[np.float64]:
        """ds/dt at flight times of any shape; 0 before the start and after the end."""
        t = np.asarray(t_s, dtype=np.float64)
        flying = (t >= 0) & (t <= self.duration_s)
        return np.where(flying, self._rate(np.clip(t, 0.0, self._end_s)), 0.0)

    def acceleration(self, t_s: ArrayLike) -> NDArray[np.float64]:
        """d2s/dt2 (1/s) at flight times of any shape; 0 outside the flight."""
        t = np.asarray(t_s, dtype=np.float64)
        flying = (t >= 0) & (t <= min(self.duration_s, self._end_s))
        return np.where(flying, self._slope(np.clip(t, 0.0, self._end_s)), 0.0)

    def setpoint(self, trajectory: PiecewisePolynomial, t_s: ArrayLike) -> Setpoint:
        """What is flown at flight times (s) of any shape."""
        s = self.plan_time(t_s)
        rate, change = self.rate(t_s)[..., None], self.acceleration(t_s)[..., None]
        velocity = trajectory.value(s, 1)
        acceleration = rate**2 * trajectory.value(s, 2) + change * velocity
        return Setpoint(trajectory.value(s), rate * velocity, acceleration)


def identity_warp(duration_s: float) -> TimeWarp:
    """The warp that changes nothing."""
    return TimeWarp(np.array([0.0, duration_s]), np.ones(2))


def warp_under_caps(trajectory: PiecewisePolynomial, caps: NDArray[np.float64], acceleration_m_s2: float) -> TimeWarp:
    """The quickest smooth warp found that keeps under caps on the rate and within the acceleration limit.

    With `x = sigma^2` the acceleration is `x a + x'/2 v` (Bobrow, Dubowsky and Gibson 1985), and x' = 0 is always
    admissible for x <= 1: one pass backwards and one forwards find the largest x. Taking the least over a window and
    averaging over the same window smooths without passing a cap.

    Args:
        trajectory: within the limit at rate 1.
        caps: largest rate on each of N equal intervals of plan time, in (0, 1], shape (N,).
        acceleration_m_s2: limit of the norm of the warped acceleration.

    Raises:
        InfeasibleError: smoothing leaves the acceleration limit.
    """
    intervals = len(caps)
    grid = np.linspace(0.0, trajectory.duration_s, intervals + 1)
    step = float(grid[1])
    at_knots = np.minimum(np.concatenate([caps[:1], caps]), np.concatenate([caps, caps[-1:]]))
    if at_knots.min() >= 1.0:
        return identity_warp(trajectory.duration_s)
    velocity, acceleration = trajectory.value(grid, 1), trajectory.value(grid, 2)
    reach = max(1, math.ceil(BLEND_S / step))
    # Two averages over `reach` to each side: rates and their derivative stay continuous in the limit.
    floor = minimum_filter1d(at_knots, 4 * reach + 1, mode="nearest")
    kernel = np.ones(2 * reach + 1) / (2 * reach + 1)
    kernel = np.convolve(kernel, kernel)
    for _ in range(_MOST_ROUNDS):
        rates = np.sqrt(_passes(floor**2, velocity, acceleration, step, _SHARE * acceleration_m_s2))
        padded = np.pad(rates, len(kernel) // 2, mode="edge")
        warp = TimeWarp(grid, np.minimum(np.convolve(padded, kernel, mode="valid"), 1.0))
        times = np.arange(0.0, warp.duration_s, step / 2)
        reached = np.linalg.norm(warp.setpoint(trajectory, times).acceleration_m_s2, axis=1)
        over = reached > acceleration_m_s2
        if not over.any():
            return warp
        # Averaging took the rate a little over what the passes found: lower it about those places.
        knots = np.unique(np.round(warp.plan_time(times[over]) / step).astype(np.int64))
        near = np.zeros(len(grid), dtype=np.bool_)
        near[knots] = True
        floor = np.where(maximum_filter1d(near, 8 * reach + 1), np.minimum(floor, _LOWERED * rates), floor)
    raise InfeasibleError(
        f"slowing down for a lost stream needs {reached.max():.2f} m/s^2 where {acceleration_m_s2:.2f} are allowed: "
        "plan with a lower speed"
    )


def _passes(
    caps: NDArray[np.float64],
    velocity: NDArray[np.float64],
    acceleration: NDArray[np.float64],
    step_s: float,
    limit: float,
) -> NDArray[np.float64]:
    """Largest squared rates under caps whose changes keep the acceleration limit, shape (N,)."""
    speed = np.linalg.norm(velocity, axis=1)
    along = np.einsum("id,id->i", velocity, acceleration) / np.maximum(speed, 1e-9)
    own = np.linalg.norm(acceleration, axis=1)
    across = np.sqrt(np.maximum(own**2 - along**2, 0.0))
    limits = np.maximum(limit, own)
    x = caps.copy()
    for order in (-1, 1):
        indices = range(len(x) - 2, -1, -1) if order < 0 else range(1, len(x))
        for i in indices:
            before = i - order
            at = float(x[before])
            if x[i] <= at:
                continue
            room = math.sqrt(max(limits[before] ** 2 - (at * across[before]) ** 2, 0.0))
            slope = 2 * (room + (-order) * at * along[before]) / max(float(speed[before]), 1e-6)
            steepest = 2 * math.sqrt(at) * STEEPEST_PER_S
            x[i] = min(x[i], at + step_s * min(max(slope, 0.0), steepest))
    return x
