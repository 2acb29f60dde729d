"""What is asked where a curve passes a place: against velocities and times that are computed another way."""

import numpy as np
import pytest

from gcs.core.errors import InfeasibleError
from gcs.core.progress import SilentProgress
from gcs.core.trajectory import PiecewisePolynomial
from gcs.planning.numerics.bernstein import monomial_from_control
from gcs.planning.numerics.qp_solver import default_solvers
from gcs.planning.trajectories.corridor_checks import check_corridor
from gcs.planning.trajectories.flight_limits import FlightLimits
from gcs.planning.trajectories.passing import PASSED_WITHIN_M, Passing
from gcs.planning.trajectories.safe_corridor import LegCorridor, build_corridor, joined_corridor
from gcs.planning.trajectories.time_allocation import time_legs

LIMITS = FlightLimits(4.0, 2.0, 8.0)


def through(points, speeds, least=None, limits=LIMITS):
    """The corridor through points, all of which but the ends are passed."""
    points = np.asarray(points, float)
    legs = [build_corridor(points[k : k + 2], 0.5, 2.0) for k in range(len(points) - 1)]
    joints = np.cumsum([len(leg.boxes_m) for leg in legs])[:-1]
    least = np.zeros(len(legs)) if least is None else np.asarray(least, float)
    return joined_corridor(legs, Passing(joints, np.asarray(speeds, float), least))


def flown(chain, limits=LIMITS):
    (leg,) = time_legs([chain], limits, default_solvers(), SilentProgress())
    curve = PiecewisePolynomial(monomial_from_control(leg.control), leg.durations_s)
    return leg, curve, curve.starts_s[chain.passing.joints]


def test_the_factor_is_what_speeds_and_times_ask_for():
    rng = np.random.default_rng(3)
    control = rng.normal(size=(6, 8, 3))
    control[1:, 0] = control[:-1, 7]
    times = rng.uniform(0.5, 2.0, 6)
    control[1:, 1] = control[1:, 0] + (control[:-1, 7] - control[:-1, 6]) * (times[1:] / times[:-1])[:, None]
    curve = PiecewisePolynomial(monomial_from_control(control), times)
    asked = Passing(np.array([2, 5]), np.array([0.5, 3.0]), np.array([1.0, 9.0, 0.1]))
    at = curve.starts_s[asked.joints]
    factors = [np.linalg.norm(curve.value(t, 1)) / v for t, v in zip(at, asked.speeds_m_s, strict=True)]
    parts = np.diff([0.0, *at, curve.duration_s])
    factors += list(asked.least_s / parts)
    assert asked.stretch(control, times) == pytest.approx(max(factors), rel=2e-3)
    np.testing.assert_allclose(asked.part_times_s(times), parts)
    longer = asked.part_times_s(asked.lengthened(times))
    np.testing.assert_allclose(longer, np.maximum(parts, asked.least_s), rtol=2e-3)


CORNERS = [(0, 0, 5), (5, 0, 5), (9, 3, 6), (9, 9, 6), (4, 9, 9), (4, 4, 9)]


@pytest.mark.parametrize("speed", [10.0, 1.2, 0.3])
def test_places_are_passed_exactly_and_no_faster_than_asked(speed):
    chain = through(CORNERS, [speed, speed, 2 * speed, speed])
    leg, curve, at = flown(chain)
    assert np.abs(curve.value(at) - CORNERS[1:-1]).max() <= PASSED_WITHIN_M
    speeds = np.linalg.norm(curve.value(at, 1), axis=1)
    assert (speeds <= chain.passing.speeds_m_s).all()
    assert speeds.min() > min(0.8 * speed, 0.5), "and it does not stop there"
    t = np.linspace(0.0, curve.duration_s, 20_001)
    for order, limit in ((1, 4.0), (2, 2.0), (3, 8.0)):
        assert np.linalg.norm(curve.value(t, order), axis=1).max() <= limit
    assert (leg.control >= chain.boxes_m[:, :1]).all()
    assert (leg.control <= chain.boxes_m[:, 1:]).all()


def test_slow_places_cost_little_more_than_their_own_slowness():
    """Between two places on a straight, a vehicle that passes them slowly is no slower than one that rests there."""
    straight = [(4.0 * k, 0.0, 5.0) for k in range(8)]
    legs = [build_corridor(np.array(straight[k : k + 2]), 0.5, 2.0) for k in range(7)]
    resting = sum(leg.total_s for leg in time_legs(legs, LIMITS, default_solvers(), SilentProgress()))
    slow, _, _ = flown(through(straight, np.full(6, 0.2)))
    quick, _, _ = flown(through(straight, np.full(6, 9.0)))
    assert quick.total_s < 0.6 * slow.total_s
    assert slow.total_s < resting


def test_parts_last_as_long_as_asked_and_the_others_lose_nothing():
    free, _, _ = flown(through(CORNERS, np.full(4, 9.0)))
    chain = through(CORNERS, np.full(4, 9.0), [0.0, 0.0, 6.0, 0.0, 0.0])
    held, _, _ = flown(chain)
    parts = chain.passing.part_times_s(held.durations_s)
    before = chain.passing.part_times_s(free.durations_s)
    assert 6.0 <= parts[2] < 7.0
    assert parts.sum() - parts[2] < 1.25 * (before.sum() - before[2])


def test_a_place_outside_of_its_boxes_is_refused():
    chain = through([(0, 0, 5), (4, 0, 5), (8, 0, 5)], [1.0])
    joints = chain.joints_m.copy()
    joints[chain.passing.joints] += [0.0, 0.9, 0.0]
    with pytest.raises(InfeasibleError, match="not connected"):
        check_corridor(LegCorridor(joints, chain.boxes_m, chain.passing))
