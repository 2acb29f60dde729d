"""The quick version of the benchmark runs and shows what it should; its reference profile against closed forms."""

import numpy as np
import pytest

from gcs.core.trajectory import PiecewisePolynomial
from gcs.planning.trajectories.flight_limits import FlightLimits
from gcs.planning.trajectories.unconstrained_minimum_snap import minimum_snap_spline
from gcs.services.benchmarks.time_optimal import time_optimal_s
from gcs.services.benchmarks.trajectories import run


def test_quick_rows_stay_in_the_corridor_at_the_references_cost():
    rows = {(row.case, row.figure): row for row in run(True)}
    for case in ("corridor-50", "tubes-50", "polytopes-50"):
        assert rows[case, "violation_m"].value == 0.0
        assert abs(rows[case, "cost_error"].value) < 1e-3
        assert rows[case, "ms"].value > 0
        assert rows[case, "ms"].reference == "PIQP"
    assert rows["fly-rows-slow", "over_time_optimal"].value < 1.15
    assert rows["stop-slow", "over_time_optimal"].value < 1.4
    assert rows["plan-20", "total_s"].value > 0
    for case in ("free-10", "free-100"):
        assert rows[case, "ms"].value > 0
        assert rows[case, "with_gradient_ms"].value > 0
        assert rows[case, "cost_error"].value < 1e-9
    assert rows["free-100", "ms"].reference == "minsnap-trajectories"
    assert rows["free-10", "ms"].reference == "spline-trajectory"


def straight(length_m):
    coefficients = np.zeros((1, 8, 3))
    coefficients[0, 4:, 0] = np.array([35, -84, 70, -20.0]) * length_m
    return PiecewisePolynomial(coefficients, np.array([3.0]))


def test_the_time_optimal_profile_without_jerk_is_bang_bang():
    assert time_optimal_s(straight(4.0), FlightLimits(100.0, 2.5)) == pytest.approx(2 * np.sqrt(4 / 2.5), rel=1e-4)
    assert time_optimal_s(straight(20.0), FlightLimits(5.0, 2.5)) == pytest.approx(20 / 5 + 5 / 2.5, rel=1e-4)


def test_the_time_optimal_profile_with_jerk_is_that_of_seven_phases_and_never_above():
    """With jerk J and acceleration A to full speed V: `L / V + V / A + A / J`; with J alone: `(32 L / J)^(1/3)`."""
    for length, limits, exact in [
        (30.0, FlightLimits(5.0, 2.5, 6.0), 30 / 5 + 5 / 2.5 + 2.5 / 6),
        (4.0, FlightLimits(100.0, 100.0, 3.0), (32 * 4 / 3) ** (1 / 3)),
    ]:
        assert exact * 0.98 < time_optimal_s(straight(length), limits) <= exact * (1 + 1e-6)


def test_on_a_circle_the_squared_speed_grows_like_a_sine():
    """`w' = 2 sqrt(A^2 - (w / r)^2)` gives `w = A r sin(2 s / r)` for the first and the last eighth of a turn."""
    share = np.polynomial.Polynomial([0, 0, 0, 0, 35, -84, 70, -20])(np.linspace(0, 1, 121))
    angle = 4 * np.pi * share
    points = 8.0 * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    around = minimum_snap_spline(points, np.full(120, 0.5)).piecewise_polynomial()
    exact = np.sqrt(8.0 / 2.0) * (3.5 * np.pi + 2.6220576)  # the integral of sin^-1/2 over a quarter turn
    assert time_optimal_s(around, FlightLimits(100.0, 2.0)) == pytest.approx(exact, rel=2e-3)
