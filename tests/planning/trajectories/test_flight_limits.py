"""Limits on true extrema: closed forms, dense samples, and the vehicle's attitude and thrust computed the plain way."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs.core.errors import GcsError, InputError
from gcs.core.progress import SilentProgress
from gcs.core.scenario import VehicleSpec
from gcs.core.trajectory import PiecewisePolynomial
from gcs.planning.numerics.bernstein import monomial_from_control
from gcs.planning.numerics.curve_samples import sampled
from gcs.planning.numerics.qp_solver import default_solvers
from gcs.planning.trajectories.flight_limits import (
    GRAVITY_M_S2,
    LIMIT_MARGIN,
    FlightLimits,
    RotorLimits,
    largest_thrust_ratio,
    largest_tilt_rad,
    limits_of,
)
from gcs.planning.trajectories.safe_corridor import build_corridor
from gcs.planning.trajectories.time_allocation import TimedLeg, fit_limits, time_legs

G = GRAVITY_M_S2


def densely(timed, order, count=3001):
    curve = PiecewisePolynomial(monomial_from_control(timed.control), timed.durations_s)
    # Pieces need not join: the end of each is taken from its own side.
    inside = np.linspace(0, 1 - 1e-9, count // len(timed.durations_s) + 2)
    times = (curve.starts_s[:-1, None] + inside * timed.durations_s[:, None]).ravel()
    return curve.value(times, order)


def tilt_and_thrust(timed):
    thrust = densely(timed, 2) + np.array([0, 0, G])
    size = np.linalg.norm(thrust, axis=1)
    return np.arccos(thrust[:, 2] / size).max(), size.max()


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10_000), st.sampled_from(["tilt", "thrust", "both"]))
def test_a_fitted_curve_uses_tilt_or_thrust_up_and_passes_neither(seed, which):
    rng = np.random.default_rng(seed)
    limits = RotorLimits(
        1e3,
        1e3,
        None,
        tilt_rad=None if which == "thrust" else rng.uniform(0.1, 1.2),
        thrust_m_s2=None if which == "tilt" else rng.uniform(1.05, 2.5) * G,
    )
    timed = fit_limits(rng.normal(size=(3, 8, 3)) * 5, rng.uniform(0.5, 2, 3), limits)
    assert keeps(timed, limits)
    assert not keeps(TimedLeg(timed.control, timed.durations_s * 0.995), limits)


def keeps(timed, limits):
    tilt, thrust = tilt_and_thrust(timed)
    return (limits.tilt_rad is None or tilt <= limits.tilt_rad) and (
        limits.thrust_m_s2 is None or thrust <= limits.thrust_m_s2
    )


def test_without_rotor_limits_they_are_flight_limits():
    rng = np.random.default_rng(1)
    control, durations = rng.normal(size=(4, 8, 3)), rng.uniform(0.5, 2, 4)
    first = np.array([0, 1, 4])
    for plain, rotor in [(FlightLimits(5, 2.5, 6), RotorLimits(5, 2.5, 6))]:
        np.testing.assert_array_equal(
            plain.worst_peaks(first, control, durations), rotor.worst_peaks(first, control, durations)
        )
        np.testing.assert_array_equal(plain.use(control, durations), rotor.use(control, durations))


def test_each_curve_has_its_own_peaks():
    rng = np.random.default_rng(2)
    control, durations = rng.normal(size=(5, 8, 3)), rng.uniform(0.5, 2, 5)
    limits = FlightLimits(5.0, 2.5, 6.0)
    together = limits.worst_peaks(np.array([0, 2, 3, 5]), control, durations)
    for row, (a, b) in zip(together, [(0, 2), (2, 3), (3, 5)], strict=True):
        (alone,) = limits.worst_peaks(np.array([0, b - a]), control[a:b], durations[a:b])
        np.testing.assert_array_equal(row, alone)


def test_a_climb_is_slower_than_a_descent_where_the_thrust_is_small():
    """Straight up only `F - g` is left to speed up with; straight down there is g at most, and F - g to brake."""
    limits = RotorLimits(1e3, 1e3, None, thrust_m_s2=1.2 * G)
    up, level = (build_corridor(np.array([[0, 0, 5.0], way]), 0.5, 50.0) for way in ([0, 0, 25.0], [20.0, 0, 5]))
    upward, across = time_legs([up, level], limits, default_solvers(), SilentProgress())
    # The straight polynomial's peak acceleration is 7.5132 L / T^2.
    assert upward.total_s == pytest.approx(math.sqrt(7.5132 * 20 / (0.2 * G)), rel=5e-3)
    assert across.total_s == pytest.approx(math.sqrt(7.5132 * 20 / (math.sqrt(1.2**2 - 1) * G)), rel=5e-3)


def test_planned_legs_keep_the_tilt():
    rng = np.random.default_rng(3)
    legs = [build_corridor(np.cumsum(rng.normal(size=(n, 3)) * 8, axis=0), 0.5, 2.5) for n in (2, 3, 5)]
    limits = RotorLimits(5.0, 6.0, None, tilt_rad=math.radians(12), thrust_m_s2=1.3 * G)
    for timed in time_legs(legs, limits, default_solvers(), SilentProgress()):
        tilt, thrust = tilt_and_thrust(timed)
        speed = np.linalg.norm(densely(timed, 1), axis=1).max()
        assert tilt <= limits.tilt_rad
        assert thrust <= limits.thrust_m_s2
        assert max(tilt / limits.tilt_rad, speed / 5.0) > 0.98


@pytest.mark.parametrize(
    ("limits", "field"),
    [
        (FlightLimits(0.0, 2.5), "speed_m_s"),
        (FlightLimits(5.0, -1.0), "acceleration_m_s2"),
        (FlightLimits(5.0, math.nan), "acceleration_m_s2"),
        (FlightLimits(math.inf, 2.5), "speed_m_s"),
        (FlightLimits(5.0, 2.5, 0.0), "jerk_m_s3"),
        (RotorLimits(5.0, 2.5, None, tilt_rad=0.0), "tilt_rad"),
        (RotorLimits(5.0, 2.5, None, tilt_rad=1.6), "tilt_rad"),
        (RotorLimits(5.0, 2.5, None, thrust_m_s2=9.0), "thrust_m_s2"),
    ],
)
def test_limits_that_cannot_be_met_are_refused_by_name(limits, field):
    leg = build_corridor(np.array([[0, 0, 0], [4.0, 0, 0]]), 0.5)
    with pytest.raises(InputError) as error:
        time_legs([leg], limits, default_solvers(), SilentProgress())
    assert isinstance(error.value, GcsError)
    assert error.value.field == field


def test_the_margin_is_left_unused():
    timed = fit_limits(np.random.default_rng(4).normal(size=(2, 8, 3)), np.ones(2), FlightLimits(1e3, 2.0))
    assert np.linalg.norm(densely(timed, 2), axis=1).max() == pytest.approx(2.0 * (1 - LIMIT_MARGIN), rel=1e-5)


@pytest.mark.parametrize("order", [0, 1, 2, 3])
def test_compiled_samples_are_the_curve(order):
    rng = np.random.default_rng(5)
    curve = PiecewisePolynomial(rng.normal(size=(6, 8, 3)), rng.uniform(0.2, 2, 6))
    times = np.sort(np.concatenate([[-1.0], curve.starts_s, rng.uniform(0, curve.duration_s, 200), [1e3]]))
    found = sampled(curve.coefficients, curve.durations_s, times, order)
    np.testing.assert_allclose(found, curve.value(times, order), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("seed", range(5))
def test_the_largest_tilt_and_thrust_are_those_of_dense_samples(seed):
    rng = np.random.default_rng(seed)
    timed = TimedLeg(rng.normal(size=(3, 8, 3)), rng.uniform(3, 6, 3))
    tilt, thrust = tilt_and_thrust(timed)
    assert tilt * (1 - 1e-9) <= largest_tilt_rad(timed.control, timed.durations_s) <= tilt + 1e-3
    ratio = largest_thrust_ratio(timed.control, timed.durations_s)
    assert thrust / G * (1 - 1e-9) <= ratio <= thrust / G * (1 + 1e-3)


def test_the_limits_of_a_vehicle_are_those_of_its_scenario():
    assert limits_of(VehicleSpec(max_speed_m_s=3.0, max_jerk_m_s3=4.0)) == FlightLimits(3.0, 2.5, 4.0)
    found = limits_of(VehicleSpec(max_tilt_deg=20.0))
    assert found == RotorLimits(5.0, 2.5, None, math.radians(20), None)
    assert limits_of(VehicleSpec(max_thrust_ratio=1.5)).thrust_m_s2 == pytest.approx(1.5 * G)
