"""Curves that bring a moving vehicle to rest at a place."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gcs.core.trajectory import DEGREE, PiecewisePolynomial
from gcs.planning.local.curve_checks import within_limits
from gcs.planning.trajectories.unconstrained_minimum_snap import minimum_snap_spline

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from gcs.planning.trajectories.flight_limits import FlightLimits

STRETCHES = 1.15 ** np.arange(14)
"""Tried multiples of the shortest time that could do."""

NEAREST_M = 1e-3


def curve_to_rest(
    state: NDArray[np.float64], goal_m: NDArray[np.float64], limits: FlightLimits
) -> PiecewisePolynomial | None:
    """The quickest of some minimum-snap curves to rest at a place; None when all exceed the limits.

    Args:
        state: position, velocity, acceleration and jerk now, scene ENU, shape (4, 3).
        goal_m: shape (3,).
        limits: kept on the true extrema.
    """
    away = float(np.linalg.norm(goal_m - state[0]))
    if away < NEAREST_M:
        return hover(state[0]) if not np.abs(state[1:]).max() > NEAREST_M else None
    speed = float(np.linalg.norm(state[1]))
    shortest = max(away / limits.speed_m_s, speed / limits.acceleration_m_s2, (away / limits.acceleration_m_s2) ** 0.5)
    for stretch in STRETCHES:
        spline = minimum_snap_spline(np.stack([state[0], goal_m]), [1.2 * shortest * stretch], list(state[1:]))
        curve = spline.piecewise_polynomial()
        if within_limits(curve, limits):
            return curve
    return None


def hover(place_m: NDArray[np.float64]) -> PiecewisePolynomial:
    """Standing still at a place (3,) for a second; curves rest at their ends."""
    coefficients = np.zeros((1, DEGREE + 1, 3))
    coefficients[0, 0] = place_m
    return PiecewisePolynomial(coefficients, np.ones(1))
