"""Trajectories as functions of time: piecewise polynomials and angle profiles. How they are found is not said here."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

DEGREE = 7


@dataclass(frozen=True, eq=False)
class PiecewisePolynomial:
    """A curve in scene ENU of degree-7 pieces on normalised time.

    Attributes:
        coefficients: shape (S, 8, 3), m: on segment s, `p = sum_k coefficients[s, k] u**k`, `u = (t - t_s) / T_s`.
        durations_s: shape (S,), all positive; the curve starts at t = 0.
    """

    coefficients: NDArray[np.float64]
    durations_s: NDArray[np.float64]

    @cached_property
    def starts_s(self) -> NDArray[np.float64]:
        """Start time of every segment and the end of the last, shape (S + 1,)."""
        return np.concatenate([[0.0], np.cumsum(self.durations_s)])

    @property
    def duration_s(self) -> float:
        """Length of the whole curve in time (s)."""
        return float(self.starts_s[-1])

    def value(self, t_s: ArrayLike, order: int = 0) -> NDArray[np.float64]:
        """Position or a derivative.

        Args:
            t_s: times (s), shape (...); held at the ends outside [0, duration].
            order: 0 position (m), 1 velocity (m/s), 2 acceleration, 3 jerk, ...

        Returns:
            Shape (..., 3).
        """
        t = np.clip(np.asarray(t_s, dtype=np.float64), 0.0, self.duration_s)
        segment = np.clip(np.searchsorted(self.starts_s, t, side="right") - 1, 0, len(self.durations_s) - 1)
        duration = self.durations_s[segment]
        u = (t - self.starts_s[segment]) / duration
        c = self.coefficients[segment]
        result = np.zeros((*t.shape, 3))
        for k in range(DEGREE, order - 1, -1):
            factor = float(np.prod(np.arange(k - order + 1, k + 1)))
            result = result * u[..., None] + factor * c[..., k, :]
        return result / duration[..., None] ** order


@dataclass(frozen=True, eq=False)
class AngleProfile:
    """An angle over time: rest at every knot, a smooth step (`3 s^2 - 2 s^3`) between knots.

    Attributes:
        times_s: knots, strictly increasing, shape (K,).
        angles_rad: angles at the knots, unwrapped, shape (K,).
    """

    times_s: NDArray[np.float64]
    angles_rad: NDArray[np.float64]

    def value(self, t_s: ArrayLike) -> NDArray[np.float64]:
        """The angle (rad, unwrapped) at times of shape (...)."""
        index, s, _ = self._locate(t_s)
        step = np.diff(self.angles_rad)[index]
        return self.angles_rad[index] + step * s * s * (3 - 2 * s)

    def rate(self, t_s: ArrayLike) -> NDArray[np.float64]:
        """The angular rate (rad/s) at times of shape (...)."""
        index, s, width = self._locate(t_s)
        return np.diff(self.angles_rad)[index] * 6 * s * (1 - s) / width

    def _locate(self, t_s: ArrayLike) -> tuple[NDArray[np.intp], NDArray[np.float64], NDArray[np.float64]]:
        t = np.asarray(t_s, dtype=np.float64)
        index = np.clip(np.searchsorted(self.times_s, t, side="right") - 1, 0, len(self.times_s) - 2)
        width = np.diff(self.times_s)[index]
        return index, np.clip((t - self.times_s[index]) / width, 0.0, 1.0), width
