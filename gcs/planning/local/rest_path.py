"""Curves from rest to rest: round what stands, at heights that are scanned, or straight up and down.

At both ends velocity, acceleration and jerk are zero, so stretching all times changes nothing of the curve's shape: it
is first made free, and then as quick as the limits allow.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gcs.core.trajectory import PiecewisePolynomial
from gcs.planning.local.curve_clearance import CellCounts
from gcs.planning.local.detour_times import profile_times
from gcs.planning.local.map_ways import REFINEMENTS, at_heights, way_on_map, with_middles
from gcs.planning.numerics.bernstein import control_from_monomial
from gcs.planning.trajectories.flight_limits import FlightLimits
from gcs.planning.trajectories.unconstrained_minimum_snap import minimum_snap_spline

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from gcs.planning.local.binary_map import BinaryMap
    from gcs.planning.local.detour import DetourOptions
    from gcs.planning.local.search_budget import SearchBudget

CLIMB = FlightLimits(0.8, 0.8)
"""The scanned plane moves with the vehicle: what comes into view on the way up or down must stop it at once."""

SHARE_OF_LIMITS = 0.9

_STILL = [np.zeros(3)] * 3


def rest_path(
    place_m: NDArray[np.float64],
    goal_m: NDArray[np.float64],
    area: BinaryMap,
    limits: FlightLimits,
    options: DetourOptions,
    budget: SearchBudget,
) -> PiecewisePolynomial | None:
    """A free curve from one place to another, both at rest; None when none was found.

    Args:
        place_m: where it begins, shape (3,).
        goal_m: where it ends, at a height that is scanned.
        area: map of the plane, grown by the safe distance and all errors.
        limits: kept on the true extrema.
        options: margins that are tried, the heights that are scanned, and what is forbidden at them.
        budget: for the search and the curves along what it finds.
    """
    wall = CellCounts(area)
    for margin_m in options.margins_m:
        way = way_on_map(place_m[:2], goal_m[:2], area, margin_m, budget)
        if way is None:
            continue
        points = at_heights(way, float(place_m[2]), float(goal_m[2]))
        for _ in range(REFINEMENTS + 1):
            if not budget.curves:
                return None
            budget.curves -= 1
            curve = _through(points, limits)
            bad = options.bad_pieces(curve, wall)
            if not bad.any():
                return _as_quick_as(curve, limits)
            points = with_middles(points, bad)
    return None


def straight_path(
    place_m: NDArray[np.float64],
    goal_m: NDArray[np.float64],
    area: BinaryMap,
    limits: FlightLimits,
    options: DetourOptions,
) -> PiecewisePolynomial | None:
    """Straight to another place, see `rest_path`; None when that is not free."""
    curve = _through(np.stack([place_m, goal_m]), limits)
    return None if options.bad_pieces(curve, CellCounts(area)).any() else _as_quick_as(curve, limits)


def climb_to(place_m: NDArray[np.float64], height_m: float, limits: FlightLimits) -> PiecewisePolynomial:
    """Straight up or down from a place (3,) to a height, slowly."""
    slow = FlightLimits(
        min(CLIMB.speed_m_s, limits.speed_m_s), min(CLIMB.acceleration_m_s2, limits.acceleration_m_s2), limits.jerk_m_s3
    )
    return _as_quick_as(_through(np.stack([place_m, [*place_m[:2], height_m]]), limits), slow)


def _through(points: NDArray[np.float64], limits: FlightLimits) -> PiecewisePolynomial:
    lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
    times = profile_times(lengths, limits.speed_m_s / 2, limits.acceleration_m_s2 / 4, 0.0, 0.0)
    return minimum_snap_spline(points, times, _STILL, _STILL).piecewise_polynomial()


def _as_quick_as(curve: PiecewisePolynomial, limits: FlightLimits) -> PiecewisePolynomial:
    pieces = np.array([0, len(curve.durations_s)])
    peaks = limits.worst_peaks(pieces, control_from_monomial(curve.coefficients), curve.durations_s)[0]
    stretch = float(limits.stretch(peaks)) / SHARE_OF_LIMITS
    return PiecewisePolynomial(curve.coefficients, curve.durations_s * stretch)
