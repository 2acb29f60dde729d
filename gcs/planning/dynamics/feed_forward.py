"""Drag and lag of a multirotor, learned from its own flight, and how much of them a stream of setpoints may use.

**Drag** shows in the tilt: with the thrust along the unit vector n and drag that is linear in the speed through the
air, `v' = (g + v_z' + k v_z) n_xy / n_z - k (v_xy - w)`, so that over a stretch of flight

    mean((g + v_z') n_xy / n_z) - change of v_xy / duration = k mean(v_xy - v_z n_xy / n_z) - k w,

which is linear in k (1/s) and in `k w`, wind and trim of the level together. Both are found by least squares whose
memory fades with the way flown. **Lag** is the delay by which the vehicle is where it was told to be: with the setpoint
s and its velocity u of the same moment, `s - x = lag u`, by least squares too. **Tilt lag** is the delay by which the
tilt follows what the position controller asks for: a first-order lag has `n_asked - n = lag n'`. An acceleration is to
be asked for that much earlier.

All are used with caution. Of the drag only what is certain, `k - 2 sigma`, is fed forward: an estimate that is too high
would push a vehicle on whose setpoints have stopped, one that is too low cannot. What is used is bounded, changes
slowly, and is nothing at all before a flight has shown enough motion. A later flight of the same vehicle starts from
what the last one ended with, a little less certain of it: propellers, payload and battery change in between.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.learned_dynamics import NOTHING_LEARNED, Estimate, LearnedDynamics
from gcs.planning.dynamics.quadrotor import GRAVITY_M_S2

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from gcs.core.motion import MotionSample

MAX_DRAG_S = 1.5
"""Drag over mass (1/s) beyond which nothing is believed: a vehicle of that much leans by 37 degrees at 5 m/s."""

MAX_LAG_S, MAX_TILT_LAG_S = 0.5, 0.3
DRAG_SLEW_S2 = 0.8
"""Change per second of the drag that is fed forward: 3 m/s^3 of jerk at 4 m/s."""

LAG_SLEW = 0.1

_STRETCH_S = 0.4
_GAP_S = 0.4
_STEEPEST = 0.5
"""Stretches in which the thrust leans by more than 60 degrees, or nearly straight up or down, do not tell of drag."""

_DRAG_MEMORY_M, _RESTING_M_S = 300.0, 0.3
"""Way after which an old observation of drag counts 1/e; a hover passes for a slow drift."""

_LAG_MEMORY_M = 40.0
_WIND_SPREAD_M_S2 = 3.0
_DRAG_SPREAD_S = 1.0
_NOISE_M_S2 = 0.2
"""Of one stretch at least, whatever the residuals say: trim, gusts and vibration do not average out."""

_PLACE_NOISE_M = 0.1
_LAG_SAMPLE_S = 1.0
"""Errors of position within this time are one error, not many."""

DRAG_SIGMA_S, LAG_SIGMA_S = 0.25, 0.1
"""What is not known better than this is not known."""

_TILT_NOISE = 0.02
"""Of the mean difference between two thrust axes over a stretch of flight."""

_MODEL_SIGMA_S = 0.02
"""No drag is known better than this, however long the flight: real drag is not quite linear."""

_CARRIED_DRAG_SIGMA_S, _CARRIED_LAG_SIGMA_S = 0.1, 0.05
"""By so much a vehicle may have changed from one flight to the next."""


class _Stretches:
    """Cuts a flight into stretches of some tenths of a second; a gap or a step back in time begins anew."""

    def __init__(self) -> None:
        self._samples: list[MotionSample] = []

    def add(self, sample: MotionSample) -> list[MotionSample] | None:
        """The next moment of the flight; the stretch that it ends, if any."""
        samples = self._samples
        if samples and not 0.0 < sample.vehicle_s - samples[-1].vehicle_s <= _GAP_S:
            samples.clear()
        samples.append(sample)
        if sample.vehicle_s - samples[0].vehicle_s < _STRETCH_S:
            return None
        self._samples = [sample]
        return samples


class DragEstimator:
    """Drag over mass from tilt against speed; the same along and across the vehicle, and in every direction.

    Args:
        start: what an earlier flight has shown; nothing is known when None.
    """

    def __init__(self, start: Estimate | None = None) -> None:
        expected, spread = (0.0, _DRAG_SPREAD_S) if start is None else (start.value, start.sigma)
        self._prior = np.diag([spread**-2, _WIND_SPREAD_M_S2**-2, _WIND_SPREAD_M_S2**-2])
        self._expected = self._prior @ [expected, 0.0, 0.0]
        self._information = np.zeros((3, 3))
        self._vector = np.zeros(3)
        self._squares, self._weight = 0.0, 0.0
        self._stretches = _Stretches()

    def add(self, sample: MotionSample) -> None:
        """Take the next moment of the flight."""
        stretch = self._stretches.add(sample)
        if stretch is not None and min(s.thrust_axis[2] for s in stretch) > _STEEPEST:
            self._take(stretch)

    @property
    def estimate(self) -> Estimate:
        """Drag over mass, 1/s."""
        covariance = np.linalg.inv(self._prior + self._information)
        noise = 1.0 if self._weight == 0.0 else max(1.0, self._squares / self._weight)
        sigma = math.hypot(math.sqrt(float(covariance[0, 0]) * noise), _MODEL_SIGMA_S)
        return Estimate(float((covariance @ (self._expected + self._vector))[0]), sigma)

    def _take(self, stretch: list[MotionSample]) -> None:
        t = np.array([s.vehicle_s for s in stretch])
        v = np.array([s.velocity_m_s for s in stretch])
        axis = np.array([s.thrust_axis for s in stretch])
        duration = t[-1] - t[0]
        change = (v[-1] - v[0]) / duration
        lean = _mean(axis[:, :2] / axis[:, 2:], t)
        speed = _mean(v, t)
        if abs(speed[2]) > 1.0 + np.hypot(speed[0], speed[1]):
            return
        asked = (GRAVITY_M_S2 + change[2]) * lean - change[:2]
        through = speed[:2] - speed[2] * lean
        rows = np.array([[through[0], 1.0, 0.0], [through[1], 0.0, 1.0]]) / _NOISE_M_S2
        seen = asked / _NOISE_M_S2
        way = max(float(np.linalg.norm(speed)), _RESTING_M_S) * duration
        fade = math.exp(-way / _DRAG_MEMORY_M)
        self._information = fade * self._information + rows.T @ rows
        self._vector = fade * self._vector + rows.T @ seen
        fitted = np.linalg.solve(self._prior + self._information, self._expected + self._vector)
        self._squares = fade * self._squares + float(np.sum((seen - rows @ fitted) ** 2))
        self._weight = fade * self._weight + 2.0


class LagEstimator:
    """Delay of the vehicle behind its setpoints.

    Args:
        start: what an earlier flight has shown; nothing is known when None.
    """

    def __init__(self, start: Estimate | None = None) -> None:
        self._moved, self._behind = _as_if_seen(start, _PLACE_NOISE_M)
        self._squares, self._weight = 0.0, 0.0
        self._last_s: float | None = None

    def add(
        self,
        vehicle_s: float,
        position_m: NDArray[np.float64],
        setpoint_m: NDArray[np.float64],
        setpoint_velocity_m_s: NDArray[np.float64],
    ) -> None:
        """Take a moment of the flight.

        Args:
            vehicle_s: when, on the vehicle's clock.
            position_m: where the vehicle was, shape (3,).
            setpoint_m: where it had been told to be at that moment, shape (3,).
            setpoint_velocity_m_s: velocity of the setpoint, shape (3,).
        """
        step = 0.0 if self._last_s is None else min(max(vehicle_s - self._last_s, 0.0), _LAG_SAMPLE_S)
        self._last_s = vehicle_s
        error, weight = setpoint_m - position_m, step / _LAG_SAMPLE_S
        speed = float(np.linalg.norm(setpoint_velocity_m_s))
        fade = math.exp(-speed * step / _LAG_MEMORY_M)
        self._moved = fade * self._moved + weight * speed**2
        self._behind = fade * self._behind + weight * float(error @ setpoint_velocity_m_s)
        left = error - self._lag() * setpoint_velocity_m_s
        self._squares = fade * self._squares + weight * float(left @ left)
        self._weight = fade * self._weight + weight

    @property
    def estimate(self) -> Estimate:
        """Lag, s; the standard deviation is that of a lag that changes from place to place."""
        noise = max(_PLACE_NOISE_M**2, self._squares / max(self._weight, 1e-9))
        return Estimate(self._lag(), math.sqrt(noise / max(self._moved, 1e-9)))

    def _lag(self) -> float:
        return self._behind / max(self._moved, 1e-9)


class TiltLagEstimator:
    """Delay of the tilt behind what the position controller asks for.

    Args:
        start: what an earlier flight has shown; nothing is known when None.
    """

    def __init__(self, start: Estimate | None = None) -> None:
        self._turned, self._behind = _as_if_seen(start, _TILT_NOISE)
        self._squares, self._count = 0.0, 0.0
        self._stretches = _Stretches()

    def add(self, sample: MotionSample) -> None:
        """Take the next moment of the flight; one that does not tell what was asked for is passed over."""
        if sample.asked_axis is None:
            return
        stretch = self._stretches.add(sample)
        if stretch is None:
            return
        t = np.array([s.vehicle_s for s in stretch])
        error = _mean(np.array([s.asked_axis - s.thrust_axis for s in stretch if s.asked_axis is not None]), t)
        rate = (stretch[-1].thrust_axis - stretch[0].thrust_axis) / (t[-1] - t[0])
        self._turned += float(rate @ rate)
        self._behind += float(error @ rate)
        left = error - self._lag() * rate
        self._squares += float(left @ left)
        self._count += 1.0

    @property
    def estimate(self) -> Estimate:
        """Lag, s."""
        noise = max(_TILT_NOISE**2, self._squares / max(self._count, 1.0))
        return Estimate(self._lag(), math.sqrt(noise / max(self._turned, 1e-9)))

    def _lag(self) -> float:
        return self._behind / max(self._turned, 1e-9)


@dataclass(frozen=True)
class FeedForward:
    """What a stream of setpoints makes use of.

    Attributes:
        drag_s: acceleration asked for in addition, per metre per second of the setpoint's velocity, 1/s.
        lead_s: how much earlier the setpoints are sent than the vehicle is to be there, s.
        tilt_lead_s: how much earlier than the rest of a setpoint its acceleration is sent, s.
    """

    drag_s: float = 0.0
    lead_s: float = 0.0
    tilt_lead_s: float = 0.0


NO_FEED_FORWARD = FeedForward()


def known(drag: Estimate, lag: Estimate, tilt_lag: Estimate) -> LearnedDynamics:
    """Of three estimates those that are good enough to be used.

    Args:
        drag: over mass, 1/s.
        lag: behind setpoints, s.
        tilt_lag: of the tilt behind what is asked for, s.
    """
    if not all(math.isfinite(number) for e in (drag, lag, tilt_lag) for number in (e.value, e.sigma)):
        return NOTHING_LEARNED
    return LearnedDynamics(
        drag if drag.sigma <= DRAG_SIGMA_S else None,
        lag if lag.sigma <= LAG_SIGMA_S else None,
        tilt_lag if tilt_lag.sigma <= LAG_SIGMA_S else None,
    )


def carried_over(learned: LearnedDynamics) -> LearnedDynamics:
    """What the next flight of the same vehicle may start with: the same, known a little less well."""

    def aged(estimate: Estimate | None, change: float) -> Estimate | None:
        return None if estimate is None else Estimate(estimate.value, math.hypot(estimate.sigma, change))

    return LearnedDynamics(
        aged(learned.drag, _CARRIED_DRAG_SIGMA_S),
        aged(learned.lag, _CARRIED_LAG_SIGMA_S),
        aged(learned.tilt_lag, _CARRIED_LAG_SIGMA_S),
    )


def usable(learned: LearnedDynamics) -> FeedForward:
    """What may be used of what is known: no more drag than is certain."""
    drag, lag, tilt_lag = learned.drag, learned.lag, learned.tilt_lag
    drag_s = 0.0 if drag is None else drag.value - 2.0 * drag.sigma
    lead_s = 0.0 if lag is None else lag.value
    tilt_lead_s = 0.0 if tilt_lag is None else tilt_lag.value
    return FeedForward(
        min(max(drag_s, 0.0), MAX_DRAG_S), min(max(lead_s, 0.0), MAX_LAG_S), min(max(tilt_lead_s, 0.0), MAX_TILT_LAG_S)
    )


def eased(present: FeedForward, wanted: FeedForward, step_s: float) -> FeedForward:
    """From what is used now toward what is wanted, as far as a time step allows.

    Args:
        present: in use.
        wanted: learned.
        step_s: time since `present` came into use, s.
    """
    drag, lag = DRAG_SLEW_S2 * max(step_s, 0.0), LAG_SLEW * max(step_s, 0.0)
    return FeedForward(
        present.drag_s + min(max(wanted.drag_s - present.drag_s, -drag), drag),
        present.lead_s + min(max(wanted.lead_s - present.lead_s, -lag), lag),
        present.tilt_lead_s + min(max(wanted.tilt_lead_s - present.tilt_lead_s, -lag), lag),
    )


def _as_if_seen(start: Estimate | None, noise: float) -> tuple[float, float]:
    """Sums of squares and of products that a lag of that value and deviation has left behind."""
    if start is None:
        return 0.0, 0.0
    seen = (noise / start.sigma) ** 2
    return seen, seen * start.value


def _mean(values: NDArray[np.float64], t: NDArray[np.float64]) -> NDArray[np.float64]:
    """Time mean by the trapezoidal rule, of values of shape (n, k)."""
    return np.asarray(np.trapezoid(values, t, axis=0) / (t[-1] - t[0]))
