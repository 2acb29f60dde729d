"""Segment times: closed forms for straight legs, extrema against dense samples, limits on corners."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs.core.errors import OperationCancelled
from gcs.core.progress import SilentProgress
from gcs.core.trajectory import PiecewisePolynomial
from gcs.planning.numerics.bernstein import monomial_from_control
from gcs.planning.numerics.qp_solver import PiqpSolver, default_solvers
from gcs.planning.trajectories.flight_limits import FlightLimits, peaks, segment_peaks
from gcs.planning.trajectories.safe_corridor import build_corridor
from gcs.planning.trajectories.speed_profile import initial_times
from gcs.planning.trajectories.time_allocation import time_legs

LIMITS = FlightLimits(5.0, 2.5)


def sampled_peaks(control, durations, count=4001):
    """Each piece is sampled on its own, both ends included: pieces need not join."""
    pieces = [
        PiecewisePolynomial(m[None], d[None]) for m, d in zip(monomial_from_control(control), durations, strict=True)
    ]
    times = np.linspace(0, 1, count)
    return np.array(
        [max(np.linalg.norm(p.value(times * p.duration_s, k), axis=1).max() for p in pieces) for k in (1, 2, 3)]
    )


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10_000), st.integers(1, 6))
def test_peaks_are_the_true_extrema(seed, count):
    rng = np.random.default_rng(seed)
    control = rng.normal(size=(count, 8, 3))
    durations = rng.uniform(0.3, 3.0, count)
    found, sampled = peaks(control, durations), sampled_peaks(control, durations)
    assert (found >= sampled * (1 - 1e-9)).all()
    np.testing.assert_allclose(found, sampled, rtol=1e-3)
    assert (segment_peaks(control, durations).max(axis=0) <= found * (1 + 1e-9)).all()


def test_a_short_straight_takes_the_time_of_the_seventh_order_polynomial():
    """Its largest acceleration is 7.5132 L / T^2 and its largest speed 2.1875 L / T."""
    leg = build_corridor(np.array([[0.0, 0, 0], [4, 0, 0]]), 0.5, 5.0)
    (timed,) = time_legs([leg], LIMITS, default_solvers(), SilentProgress())
    assert timed.durations_s.sum() == pytest.approx(np.sqrt(7.5132 * 4 / 2.5), rel=2e-3)


@pytest.mark.parametrize("length", [8.0, 30.0, 120.0])
def test_long_straights_come_near_the_time_of_constant_acceleration_and_cruise(length):
    leg = build_corridor(np.array([[0.0, 0, 0], [length * 0.6, length * 0.8, 0]]), 0.5, 2.5)
    (timed,) = time_legs([leg], LIMITS, default_solvers(), SilentProgress())
    least = length / 5 + 2 if length > 10 else 2 * np.sqrt(length / 2.5)
    assert least <= timed.durations_s.sum() < 1.38 * least


@pytest.mark.parametrize("limits", [LIMITS, FlightLimits(5.0, 2.5, 3.0), FlightLimits(2.0, 4.0)])
def test_limits_hold_and_one_of_them_is_reached(limits):
    rng = np.random.default_rng(4)
    legs = [build_corridor(np.cumsum(rng.normal(size=(n, 3)) * 8, axis=0), 0.5, 2.5) for n in (2, 2, 3, 4, 6)]
    for timed, leg in zip(time_legs(legs, limits, default_solvers(), SilentProgress()), legs, strict=True):
        speed, acceleration, jerk = sampled_peaks(timed.control, timed.durations_s)
        use = [speed / limits.speed_m_s, acceleration / limits.acceleration_m_s2]
        use += [jerk / limits.jerk_m_s3] if limits.jerk_m_s3 else []
        assert 0.995 < max(use) <= 0.9991
        assert (timed.control >= leg.boxes_m[:, :1]).all()
        assert (timed.control <= leg.boxes_m[:, 1:]).all()


def test_scaling_all_times_scales_the_peaks():
    rng = np.random.default_rng(5)
    control, durations = rng.normal(size=(3, 8, 3)), rng.uniform(0.5, 2, 3)
    np.testing.assert_allclose(
        peaks(control, 1.7 * durations), peaks(control, durations) / 1.7 ** np.array([1, 2, 3]), rtol=1e-9
    )


def test_corners_are_given_more_time_than_straights():
    straight = build_corridor(np.array([[0.0, 0, 0], [20, 0, 0], [40, 0, 0]]), 0.5, 2.5)
    corner = build_corridor(np.array([[0.0, 0, 0], [20, 0, 0], [20, 20, 0]]), 0.5, 2.5)
    corner_speed = np.sqrt(2.5 * 0.5 / (np.sqrt(2) - 1))
    lost = (5 - corner_speed) ** 2 / (2.5 * 5)
    found = initial_times(corner, LIMITS, 0.6).sum() - initial_times(straight, LIMITS, 0.6).sum()
    assert found == pytest.approx(lost, rel=0.05)


class FailsAt:
    """PIQP that says no at some of the calls."""

    name = "fails"

    def __init__(self, *calls):
        self.calls, self.count = calls, 0

    def solve(self, problem):
        self.count += 1
        answer = PiqpSolver().solve(problem)
        return replace(answer, solved=False) if self.count in self.calls else answer


def test_times_without_a_solution_are_passed_over_and_without_any_solution_the_straights_are_flown():
    leg = build_corridor(np.array([[0.0, 0, 0], [6, 0, 0], [6, 6, 1]]), 0.5, 2.5)
    (alone,) = time_legs([leg], LIMITS, [PiqpSolver()], SilentProgress())
    for call in (1, 5, 8):
        (timed,) = time_legs([leg], LIMITS, [FailsAt(call)], SilentProgress())
        assert timed.durations_s.sum() == pytest.approx(alone.durations_s.sum(), rel=0.1)
    (timed,) = time_legs([leg], LIMITS, [FailsAt(*range(1, 100))], SilentProgress())
    assert alone.durations_s.sum() < timed.durations_s.sum() < 2 * alone.durations_s.sum()
    at_corner = np.flatnonzero(np.abs(leg.joints_m - [6, 0, 0]).max(axis=1) < 1e-9)[0]
    np.testing.assert_allclose(timed.control[at_corner, :4], [[6, 0, 0]] * 4, atol=1e-9)
    assert (timed.control >= leg.boxes_m[:, :1]).all()
    assert (timed.control <= leg.boxes_m[:, 1:]).all()


def test_it_stops_when_told():
    class Stop:
        def report(self, stage, fraction):
            raise OperationCancelled("stop")

    leg = build_corridor(np.array([[0.0, 0, 0], [4, 0, 0]]), 0.5)
    with pytest.raises(OperationCancelled):
        time_legs([leg], LIMITS, default_solvers(), Stop())
