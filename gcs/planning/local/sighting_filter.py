"""Sighted positions over time: where the vehicle is and how fast it goes, at any moment close by.

A Kalman filter of motion at constant velocity that is disturbed by white acceleration. The error of the observer's own
place is not among what it filters: it is the same in all sightings, and no number of them averages it away. It is added
to what comes out.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.errors import InputError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from gcs.planning.local.cooperative_position import PositionFix

RESTART_S = 1.0
"""After so long without a sighting it begins anew."""

FIRST_SPEED_M_S = 3.0
"""Standard deviation of what the speed may be at first, on each axis."""


@dataclass(frozen=True, eq=False)
class SightedMotion:
    """Where a vehicle is and how it moves, and how sure that is.

    Attributes:
        position_m: ENU, shape (3,).
        velocity_m_s: ENU, shape (3,).
        position_covariance_m2: shape (3, 3), with the observer's own error.
        velocity_covariance_m2_s2: shape (3, 3).
    """

    position_m: NDArray[np.float64]
    velocity_m_s: NDArray[np.float64]
    position_covariance_m2: NDArray[np.float64]
    velocity_covariance_m2_s2: NDArray[np.float64]


class SightingFilter:
    """Follows one vehicle by the sightings of one observer.

    Args:
        acceleration_m_s2: by how much the vehicle's velocity changes within a second, standard deviation on each axis.
    """

    def __init__(self, acceleration_m_s2: float = 0.7) -> None:
        self._density = acceleration_m_s2**2
        self._state = np.zeros(6)
        self._covariance = np.zeros((6, 6))
        self._observer_m2 = np.zeros((3, 3))
        self._at_s: float | None = None

    def add(self, at_s: float, fix: PositionFix, observer: PositionFix) -> None:
        """Take a sighted position.

        Args:
            at_s: when it was sighted.
            fix: where the vehicle was, with the errors of sighting and observer, as `sighted_position` gives it.
            observer: what it was sighted from.

        Raises:
            InputError: it is no later than the one before.
        """
        noise = fix.covariance_m2 - observer.covariance_m2
        self._observer_m2 = observer.covariance_m2
        if self._at_s is not None and at_s <= self._at_s:
            raise InputError("it is no later than the one before", field="at_s")
        if self._at_s is None or at_s - self._at_s > RESTART_S:
            self._state = np.concatenate([fix.position_m, np.zeros(3)])
            self._covariance = np.zeros((6, 6))
            self._covariance[:3, :3], self._covariance[3:, 3:] = noise, FIRST_SPEED_M_S**2 * np.eye(3)
        else:
            state, covariance = self._predicted(at_s)
            gain = np.linalg.solve(covariance[:3, :3] + noise, covariance[:3]).T
            self._state = state + gain @ (fix.position_m - state[:3])
            shrunk = covariance - gain @ covariance[:3]
            self._covariance = (shrunk + shrunk.T) / 2
        self._at_s = at_s

    def motion(self, at_s: float) -> SightedMotion:
        """The motion at a time near the last sighting, before or after it.

        Raises:
            InputError: nothing was sighted yet.
        """
        if self._at_s is None:
            raise InputError("nothing was sighted yet", field="at_s")
        state, covariance = self._predicted(at_s)
        return SightedMotion(state[:3], state[3:], covariance[:3, :3] + self._observer_m2, covariance[3:, 3:])

    def _predicted(self, at_s: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """State and covariance at another time; going back the uncertainty grows as it does going ahead."""
        dt = at_s - (at_s if self._at_s is None else self._at_s)
        step = np.eye(6)
        step[:3, 3:] = dt * np.eye(3)
        size = abs(dt)
        growth = np.block(
            [
                [size**3 / 3 * np.eye(3), dt * size / 2 * np.eye(3)],
                [dt * size / 2 * np.eye(3), size * np.eye(3)],
            ]
        )
        return step @ self._state, step @ self._covariance @ step.T + self._density * growth
