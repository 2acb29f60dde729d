"""Whether a new curve holds the vehicle's limits and stays between the heights that a lidar in the plane scans."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from gcs.planning.numerics.bernstein import control_from_monomial
from gcs.planning.trajectories.flight_limits import TOLERANCE

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from gcs.core.trajectory import PiecewisePolynomial
    from gcs.planning.trajectories.flight_limits import FlightLimits


def within_limits(curve: PiecewisePolynomial, limits: FlightLimits) -> bool:
    """Whether the limits hold on the true extrema."""
    pieces = np.array([0, len(curve.durations_s)])
    peaks = limits.worst_peaks(pieces, control_from_monomial(curve.coefficients), curve.durations_s)[0]
    jerk = math.inf if limits.jerk_m_s3 is None else limits.jerk_m_s3
    most = np.array([limits.speed_m_s, limits.acceleration_m_s2, jerk])
    return bool((peaks <= most * (1 + TOLERANCE)).all())


def heights_in_slab(curve: PiecewisePolynomial, slab_m: tuple[float, float] | None) -> NDArray[np.bool_]:
    """Which pieces of a curve are proved, by their control points, to stay between two heights, shape (S,)."""
    heights = control_from_monomial(curve.coefficients)[:, :, 2]
    low, high = slab_m or (-math.inf, math.inf)
    return np.asarray((heights.min(axis=1) >= low) & (heights.max(axis=1) <= high))
