"""What a simulated vehicle believes of its place, as an error: it grows without position fixes, and they correct it.

Modelled on each axis apart, as autopilots' estimators behave: inertial dead reckoning whose speed drifts by noise of
the accelerometer and by its bias (what the tilt's error shows as), and a Kalman filter that knows these figures. The
attitude is taken to be known. Heights have a barometer beside, which wanders slowly.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_NOISE_M_S2 = 0.03
"""Noise of the accelerometer, m/s^2 in a bandwidth of 1 Hz."""
_BIAS_M_S2 = 0.02
"""Deviation of its bias at the start: 2 mrad of tilt."""
_BIAS_WALK_M_S3 = 0.001
_BAROMETER_M, _BAROMETER_WANDER_M, _BAROMETER_WANDER_S = 0.1, 0.1, 60.0
_BAROMETER_EVERY_S = 0.1
_REMEMBERED_S = 0.6


class PositionEstimator:
    """Error of position and velocity (belief less truth), and what the filter thinks of it.

    Args:
        seed: of all that is left to chance.
    """

    def __init__(self, seed: int) -> None:
        self._rng = np.random.default_rng(seed)
        self._error = np.zeros((3, 3))  # axis; position, velocity, bias of the acceleration
        self._error[:, 2] = self._rng.normal(0.0, _BIAS_M_S2, 3)
        self._covariance = np.tile(np.diag([1.0, 0.1, _BIAS_M_S2**2]), (3, 1, 1))
        self._barometer_m = 0.0
        self._barometer_s = 0.0
        self._past: deque[tuple[float, Array]] = deque()  # time; position and velocity as believed, shape (2, 3)
        self._now_s = 0.0

    @property
    def error_m(self) -> Array:
        """Of the position, ENU."""
        return self._error[:, 0].copy()

    @property
    def error_m_s(self) -> Array:
        """Of the velocity, ENU."""
        return self._error[:, 1].copy()

    def advance(self, dt_s: float, true_m: Array, true_m_s: Array) -> None:
        """Let time pass.

        Args:
            dt_s: how much.
            true_m: position afterwards, ENU.
            true_m_s: velocity afterwards, ENU.
        """
        step = np.array([[1.0, dt_s, dt_s**2 / 2], [0.0, 1.0, dt_s], [0.0, 0.0, 1.0]])
        growth = np.diag([0.0, _NOISE_M_S2**2 * dt_s, _BIAS_WALK_M_S3**2 * dt_s])
        self._error = self._error @ step.T + self._rng.normal(0.0, 1.0, (3, 3)) * np.sqrt(np.diag(growth))
        self._covariance = step @ self._covariance @ step.T + growth
        self._now_s += dt_s
        self._past.append((self._now_s, np.stack([true_m, true_m_s]) + self._error.T[:2]))
        while self._past[0][0] < self._now_s - _REMEMBERED_S:
            self._past.popleft()
        wander = _BAROMETER_WANDER_M * math.sqrt(2 * dt_s / _BAROMETER_WANDER_S)
        self._barometer_m += -self._barometer_m * dt_s / _BAROMETER_WANDER_S + wander * self._rng.normal()
        if self._now_s - self._barometer_s >= _BAROMETER_EVERY_S:
            self._barometer_s = self._now_s
            measured = self._barometer_m + self._rng.normal(0.0, _BAROMETER_M) - self._error[2, 0]
            self._correct(2, 0, measured, math.hypot(_BAROMETER_M, _BAROMETER_WANDER_M))

    def take(self, axis: int, part: int, value: float, ago_s: float, deviation: float) -> None:
        """Fuse a measurement on one axis.

        Args:
            axis: 0 east, 1 north, 2 up.
            part: 0 of the position, 1 of the velocity.
            value: the measured one.
            ago_s: how long ago it was so.
            deviation: of the measured value.
        """
        _, motion = min(self._past, key=lambda entry: abs(entry[0] - (self._now_s - ago_s)))
        self._correct(axis, part, value - float(motion[part, axis]), deviation)

    def take_own_fix(self, deviation_m: float, deviation_m_s: float) -> None:
        """Fuse what its own receiver measures: the truth with noise, in place and speed."""
        for axis in range(3):
            off_m, off_m_s = -self._error[axis, :2] + self._rng.normal(0.0, (deviation_m, deviation_m_s))
            self._correct(axis, 0, off_m, deviation_m)
            self._correct(axis, 1, off_m_s, deviation_m_s)

    def _correct(self, axis: int, part: int, off: float, deviation: float) -> None:
        """Fuse a measured value less the believed one."""
        covariance = self._covariance[axis]
        gain = covariance[:, part] / (covariance[part, part] + deviation**2)
        self._error[axis] += gain * off
        shrunk = covariance - np.outer(gain, covariance[part])
        self._covariance[axis] = (shrunk + shrunk.T) / 2
        for _, motion in self._past:  # the past is seen with what is known now
            motion[:, axis] += gain[:2] * off
