"""Drag, lag and tilt lag from flights of known drag, lag and tilt lag; and nothing from flights that do not tell."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gcs.core.learned_dynamics import Estimate, LearnedDynamics
from gcs.core.motion import MotionSample, thrust_axis
from gcs.planning.dynamics.feed_forward import (
    DRAG_SLEW_S2,
    LAG_SLEW,
    MAX_DRAG_S,
    MAX_LAG_S,
    MAX_TILT_LAG_S,
    NO_FEED_FORWARD,
    DragEstimator,
    FeedForward,
    LagEstimator,
    TiltLagEstimator,
    carried_over,
    eased,
    known,
    usable,
)

G = 9.80665
UNKNOWN = Estimate(0.0, 1e3)


def weave(t):
    """Velocity and acceleration of a vehicle that weaves, climbs and sinks."""
    v = np.array([3.0 * math.sin(0.7 * t), 2.0 * math.sin(0.45 * t + 1.0), 0.8 * math.sin(0.3 * t)])
    a = np.array([2.1 * math.cos(0.7 * t), 0.9 * math.cos(0.45 * t + 1.0), 0.24 * math.cos(0.3 * t)])
    return v, a


def samples(seconds, drag, wind=(0.0, 0.0, 0.0), motion=weave, rate_hz=10.0, rng=None, start_s=0.0):
    """What a vehicle would tell whose thrust is exactly what the motion takes."""
    for i in range(round(seconds * rate_hz)):
        t = start_s + i / rate_hz
        v, a = motion(t)
        force = a + [0.0, 0.0, G] + drag * (v - np.array(wind))
        axis = force / np.linalg.norm(force)
        if rng is not None:
            v = v + rng.normal(0.0, 0.05, 3)
            axis = axis + rng.normal(0.0, 0.01, 3)
            axis = axis / np.linalg.norm(axis)
        yield MotionSample(t, np.zeros(3), v, axis)


def learned(flight):
    estimator = DragEstimator()
    for sample in flight:
        estimator.add(sample)
    return estimator.estimate


@pytest.mark.parametrize(("roll", "pitch", "yaw", "axis"), [
    (0.0, -0.3, 0.0, (math.sin(0.3), 0.0, math.cos(0.3))),  # nose down, facing east: leans east
    (0.0, -0.3, math.pi / 2, (0.0, math.sin(0.3), math.cos(0.3))),  # facing north: leans north
    (0.3, 0.0, math.pi / 2, (math.sin(0.3), 0.0, math.cos(0.3))),  # right side down, facing north: leans east
])  # fmt: skip
def test_the_thrust_leans_where_the_nose_or_the_low_side_points(roll, pitch, yaw, axis):
    assert thrust_axis(roll, pitch, yaw) == pytest.approx(axis, abs=1e-12)


@pytest.mark.parametrize("drag", [0.0, 0.12, 0.5, 1.0])
@pytest.mark.parametrize("wind", [(0.0, 0.0, 0.0), (6.0, -3.0, 0.0)])
def test_drag_is_found_with_and_without_wind(drag, wind):
    estimate = learned(samples(60.0, drag, wind))
    assert estimate.value == pytest.approx(drag, abs=0.01 + 0.02 * drag)
    assert estimate.sigma < 0.05


def test_the_deviation_that_is_told_covers_the_error_of_noisy_flights():
    rng = np.random.default_rng(4)
    estimates = [learned(samples(20.0, 0.6, (2.0, 1.0, 0.0), rng=rng)) for _ in range(40)]
    errors = np.array([abs(e.value - 0.6) / e.sigma for e in estimates])
    assert (errors <= 2.0).mean() >= 0.9
    assert max(e.sigma for e in estimates) < 0.15


def test_a_hover_and_a_steady_flight_in_one_direction_teach_nothing():
    """In both, drag and wind cannot be told apart: the tilt of a straight flight may be a headwind's."""
    still = learned(samples(60.0, 1.0, (4.0, 0.0, 0.0), motion=lambda t: (np.zeros(3), np.zeros(3))))
    steady = learned(samples(60.0, 1.0, (4.0, 0.0, 0.0), motion=lambda t: (np.array([3.0, 0.0, 0.0]), np.zeros(3))))
    for estimate in (still, steady):
        assert usable(known(estimate, UNKNOWN, UNKNOWN)) == NO_FEED_FORWARD


def test_vertical_flight_teaches_nothing_of_drag():
    flight = samples(60.0, 1.0, motion=lambda t: (np.array([0.2, 0.0, 4.0 * math.sin(t)]), np.zeros(3)))
    assert usable(known(learned(flight), UNKNOWN, UNKNOWN)) == NO_FEED_FORWARD


def test_gaps_repeats_and_a_clock_that_steps_back_do_no_harm():
    broken = []
    for sample in samples(120.0, 0.8):
        if 5.0 < sample.vehicle_s % 11.0 < 6.5:
            continue
        broken += [sample, sample] if sample.vehicle_s % 4.0 < 0.15 else [sample]
    broken += list(samples(30.0, 0.8, start_s=2.0))
    assert learned(broken).value == pytest.approx(0.8, abs=0.03)


def test_a_drag_that_changes_is_forgotten_with_the_way():
    estimator = DragEstimator()
    for sample in samples(300.0, 0.2):
        estimator.add(sample)
    for sample in samples(600.0, 0.9, start_s=300.0):
        estimator.add(sample)
    assert estimator.estimate.value == pytest.approx(0.9, abs=0.08)


def path(t):
    return np.array([5.0 * math.sin(0.5 * t), 3.0 * t, 2.0]), np.array([2.5 * math.cos(0.5 * t), 3.0, 0.0])


@pytest.mark.parametrize("lag", [0.0, 0.05, 0.28])
def test_lag_behind_setpoints(lag):
    estimator = LagEstimator()
    for i in range(400):
        t = 0.1 * i
        setpoint, velocity = path(t)
        estimator.add(t, path(t - lag)[0], setpoint, velocity)
    assert estimator.estimate.value == pytest.approx(lag, abs=0.01)
    assert estimator.estimate.sigma < 0.05


def test_a_vehicle_that_stands_still_has_no_lag():
    estimator = LagEstimator()
    for i in range(600):
        estimator.add(0.1 * i, np.array([0.3, 0.0, 0.0]), np.zeros(3), np.zeros(3))
    assert usable(known(UNKNOWN, estimator.estimate, UNKNOWN)) == NO_FEED_FORWARD


@pytest.mark.parametrize("lag", [0.1, 0.25])
def test_tilt_lag_of_a_first_order_answer(lag):
    def asked(t):
        return np.array([0.3 * math.sin(1.3 * t), 0.2 * math.sin(0.9 * t), 1.0])

    estimator, axis = TiltLagEstimator(), asked(0.0)
    for i in range(40_000):
        t = i * 0.001
        axis = axis + 0.001 / lag * (asked(t) - axis)
        if i % 100 == 0:
            estimator.add(MotionSample(t, np.zeros(3), np.zeros(3), axis, asked(t)))
    assert estimator.estimate.value == pytest.approx(lag, abs=0.02)
    assert estimator.estimate.sigma < 0.05


def test_a_tilt_that_nobody_tells_the_aim_of_has_no_lag():
    estimator = TiltLagEstimator()
    for sample in samples(30.0, 0.5):
        estimator.add(sample)
    assert usable(known(UNKNOWN, UNKNOWN, estimator.estimate)) == NO_FEED_FORWARD


def test_only_what_is_certain_of_the_drag_is_used_and_everything_is_bounded():
    certain = Estimate(0.2, 0.01)
    assert usable(known(Estimate(1.0, 0.1), certain, certain)) == FeedForward(0.8, 0.2, 0.2)
    assert usable(known(Estimate(0.15, 0.1), certain, certain)).drag_s == 0.0
    much, less = Estimate(9.0, 0.01), Estimate(-3.0, 0.01)
    assert usable(LearnedDynamics(much, much, much)) == FeedForward(MAX_DRAG_S, MAX_LAG_S, MAX_TILT_LAG_S)
    assert usable(LearnedDynamics(less, less, less)) == NO_FEED_FORWARD
    for number in (math.nan, math.inf):
        assert usable(known(Estimate(number, 0.01), certain, certain)) == NO_FEED_FORWARD
        assert usable(known(Estimate(1.0, number), certain, certain)).drag_s == 0.0


def test_what_is_used_changes_slowly_and_never_backwards_in_time():
    present, wanted = NO_FEED_FORWARD, FeedForward(1.2, 0.4, 0.2)
    for _ in range(50):
        after = eased(present, wanted, 0.02)
        assert 0.0 <= after.drag_s - present.drag_s <= DRAG_SLEW_S2 * 0.02 + 1e-12
        assert 0.0 <= after.lead_s - present.lead_s <= LAG_SLEW * 0.02 + 1e-12
        present = after
    assert present.drag_s == pytest.approx(DRAG_SLEW_S2)
    assert eased(present, wanted, -3.0) == present
    assert eased(present, NO_FEED_FORWARD, 1e3) == NO_FEED_FORWARD


def test_a_flight_starts_where_the_last_one_ended_and_believes_its_own_motion_more():
    start = carried_over(known(learned(samples(60.0, 0.8)), UNKNOWN, UNKNOWN)).drag
    assert DragEstimator(start).estimate.value == pytest.approx(0.8, abs=0.02)
    assert 0.1 < DragEstimator(start).estimate.sigma < 0.2
    # Since then it was given guards: after a few seconds of flight that is what counts.
    changed = DragEstimator(start)
    for sample in samples(8.0, 1.2):
        changed.add(sample)
    assert changed.estimate.value == pytest.approx(1.2, abs=0.05)


@pytest.mark.parametrize("estimator", [LagEstimator, TiltLagEstimator])
def test_lags_start_where_the_last_flight_ended(estimator):
    start = estimator(Estimate(0.2, 0.06)).estimate
    assert (start.value, start.sigma) == (pytest.approx(0.2), pytest.approx(0.06))


def test_a_lag_of_an_earlier_flight_is_soon_forgotten():
    late = LagEstimator(Estimate(0.3, 0.05))
    for i in range(200):
        t = 0.1 * i
        velocity = np.array([3.0 * math.sin(0.7 * t), 2.0, 0.0])
        late.add(t, np.zeros(3), 0.1 * velocity, velocity)
    assert late.estimate.value == pytest.approx(0.1, abs=0.02)


def test_what_is_carried_over_again_and_again_without_flying_is_given_up():
    learned = LearnedDynamics(Estimate(0.8, 0.05), Estimate(0.1, 0.02), Estimate(0.2, 0.02))
    for _ in range(10):
        learned = known(*(e or UNKNOWN for e in vars(carried_over(learned)).values()))
    assert learned == LearnedDynamics()
