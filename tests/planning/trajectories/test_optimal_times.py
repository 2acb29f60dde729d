"""Times that minimise squared snap plus a price of time, and the same shares stretched to limits."""

import math

import numpy as np
import pytest

from gcs.core.errors import InputError, OperationCancelled
from gcs.planning.trajectories.flight_limits import LIMIT_MARGIN, FlightLimits
from gcs.planning.trajectories.optimal_times import priced_times, times_at_limits
from gcs.planning.trajectories.unconstrained_minimum_snap import minimum_snap_spline


def wandering(segments, seed):
    return np.cumsum(np.random.default_rng(seed).normal(size=(segments + 1, 3)) * [3, 3, 1], axis=0)


def worth(spline, price):
    return spline.cost + price * spline.durations_s.sum()


@pytest.mark.parametrize("price", [0.01, 1.0, 1e6])
def test_one_straight_move_in_closed_form(price):
    spline = priced_times([[0.0, 0, 0], [3, 4, 0]], price)
    assert spline.durations_s == pytest.approx([(7 * 100800 * 25 / price) ** (1 / 8)], rel=1e-9)


@pytest.mark.parametrize("segments", [2, 3, 20, 150])
def test_a_second_more_on_any_segment_saves_what_it_costs(segments):
    spline = priced_times(wandering(segments, segments), 5.0)
    assert spline.cost_gradient == pytest.approx(np.full(segments, -5.0), rel=1e-3)


def test_no_other_times_are_worth_more():
    points = np.array([[0.0, 0, 0], [5, 0, 1], [6, 4, 0]])
    best = priced_times(points, 10.0)
    grid = np.linspace(0.2, 4.0, 60)
    others = [worth(minimum_snap_spline(points, best.durations_s * [a, b]), 10.0) for a in grid for b in grid]
    assert worth(best, 10.0) <= min(others)
    assert worth(best, 10.0) == pytest.approx(min(others), rel=0.01)


def test_a_path_read_backwards_takes_the_same_times():
    points = wandering(15, 3)
    there, back = priced_times(points, 1.0), priced_times(points[::-1], 1.0)
    assert there.durations_s == pytest.approx(back.durations_s[::-1], rel=1e-4)


@pytest.mark.parametrize(
    "limits", [FlightLimits(3.0, 2.0), FlightLimits(50.0, 1.0), FlightLimits(2.0, 40.0), FlightLimits(5.0, 3.0, 2.0)]
)
def test_limits_are_kept_and_one_is_used_up(limits):
    spline = times_at_limits(wandering(12, 5), limits)
    spots = np.linspace(0, spline.durations_s.sum(), 200_000)
    bounds = [limits.speed_m_s, limits.acceleration_m_s2, limits.jerk_m_s3 or math.inf]
    use = [np.linalg.norm(spline.value(spots, k), axis=1).max() / bound for k, bound in enumerate(bounds, start=1)]
    assert 1 - 2 * LIMIT_MARGIN < max(use) <= 1.0


def test_quicker_than_times_in_proportion_to_the_lengths():
    points = wandering(40, 6)
    limits = FlightLimits(1e3, 2.0)
    lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
    plain = minimum_snap_spline(points, lengths)
    spots = np.linspace(0, lengths.sum(), 100_000)
    stretch = math.sqrt(np.linalg.norm(plain.value(spots, 2), axis=1).max() / 2.0)
    assert times_at_limits(points, limits).durations_s.sum() < 0.7 * stretch * lengths.sum()


def test_it_stops_when_asked():
    class Stop:
        def report(self, stage, fraction):
            assert stage == "trajectory"
            raise OperationCancelled("stopped")

    with pytest.raises(OperationCancelled):
        priced_times(wandering(30, 0), 1.0, Stop())


@pytest.mark.parametrize(
    ("points", "price", "message"),
    [
        ([[0.0, 0, 0]], 1.0, "at least two points"),
        (np.zeros((0, 3)), 1.0, "at least two points"),
        ([[0.0, 0, 0], [1, 0, 0], [1, 0, 0]], 1.0, "segment 1 has no length"),
        ([[0.0, 0, 0], [math.nan, 0, 0]], 1.0, "segment 0: point 1"),
        (np.eye(3), 0.0, "price of time"),
        (np.eye(3), math.inf, "price of time"),
        (np.eye(3), math.nan, "price of time"),
    ],
)
def test_bad_input_is_named(points, price, message):
    with pytest.raises(InputError, match=message):
        priced_times(points, price)
