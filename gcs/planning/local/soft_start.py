"""Going on along the plan from rest, where the vehicle hovers on it: the plan's own way, however steep it is there."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.trajectory import PiecewisePolynomial
from gcs.planning.local.curve_checks import within_limits
from gcs.planning.local.curve_parts import joined_curves, part_of_curve
from gcs.planning.local.flown_leg import FlownLeg
from gcs.planning.trajectories.warped_curve import hermite_pieces

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from gcs.planning.trajectories.flight_limits import FlightLimits

NEAR_M = 0.5
"""Who is no further from a place on the plan is on it."""

DURATIONS_S = (1.0, 1.5, 2.0, 3.0, 4.5, 7.0, 10.0)
"""Tried for coming to the plan's own pace."""

KNOT_S = 0.1


def soft_start(
    place_m: NDArray[np.float64], leg: PiecewisePolynomial, from_s: float, limits: FlightLimits, clock_s: float
) -> FlownLeg | None:
    """Fly a leg on from a time on it, from rest beside its place then, as soon at its own pace as limits allow.

    The rate rises as `3 u^2 - 2 u^3` from 0 to 1, and what the vehicle is beside the leg vanishes meanwhile.

    Args:
        place_m: where the vehicle hovers, shape (3,).
        leg: scene ENU.
        from_s: time on the leg.
        limits: kept on the true extrema.
        clock_s: now.

    Returns:
        None when the vehicle is elsewhere, the leg ends too soon, or no duration keeps the limits.
    """
    beside = place_m - leg.value(from_s)
    if np.linalg.norm(beside) > NEAR_M:
        return None
    for duration_s in DURATIONS_S:
        joins_s = from_s + duration_s / 2
        if joins_s >= leg.duration_s:
            return None
        start, times, legs = _from_rest(beside, leg, from_s, duration_s)
        if within_limits(start, limits):
            curve = joined_curves(start, part_of_curve(leg, joins_s, leg.duration_s))
            times, legs = np.append(times, curve.duration_s), np.append(legs, leg.duration_s)
            return FlownLeg(curve, clock_s, times, legs, duration_s)
    return None


def _from_rest(
    beside_m: NDArray[np.float64], leg: PiecewisePolynomial, from_s: float, duration_s: float
) -> tuple[PiecewisePolynomial, NDArray[np.float64], NDArray[np.float64]]:
    """The curve until the leg's own pace, and times on it with those on the leg that belong to them."""
    times = np.linspace(0.0, duration_s, math.ceil(duration_s / KNOT_S) + 1)
    u = times / duration_s
    legs = from_s + duration_s * (u**3 - u**4 / 2)
    rate, change = 3 * u**2 - 2 * u**3, 6 * (u - u**2) / duration_s
    left = np.stack(
        [
            1 - u**3 * (10 - 15 * u + 6 * u**2),
            -30 * (u * (1 - u)) ** 2 / duration_s,
            -60 * u * (1 - u) * (1 - 2 * u) / duration_s**2,
        ]
    )[..., None] * np.asarray(beside_m)
    velocity = leg.value(legs, 1)
    position = leg.value(legs) + left[0]
    acceleration = rate[:, None] ** 2 * leg.value(legs, 2) + change[:, None] * velocity + left[2]
    pieces = hermite_pieces(position, rate[:, None] * velocity + left[1], acceleration, float(times[1]))
    return PiecewisePolynomial(pieces, np.diff(times)), times, legs
