"""Splines of least squared derivative against extended precision, closed forms and perturbations."""

import math
from decimal import Decimal, localcontext

import numpy as np
import pytest

from gcs.core.errors import InputError
from gcs.planning.trajectories.snap_chain import rest_to_rest_cost
from gcs.planning.trajectories.unconstrained_minimum_snap import (
    MOST_UNEVEN,
    minimum_jerk_spline,
    minimum_snap_spline,
    yaw_spline,
)
from gcs.services.benchmarks.exact_spline import DIGITS, exact_spline

ENDS = {
    "at rest": ([0.0, 0.0, 0.0], [0.0, 0.0, 0.0]),
    "moving": ([3.0, -1.0, 0.5], [-2.0, 0.3, 1.0]),
    "free": ([None, None, None], [None, None, None]),
    "mixed": ([1.0, None, 0.0], [None, 0.5, None]),
}


def solve(order, points, times, start=None, end=None):
    points = np.asarray(points, dtype=float)
    if order == 2:
        return yaw_spline(points[:, 0], times, start=start, end=end)
    return (minimum_snap_spline if order == 4 else minimum_jerk_spline)(points, times, start, end)


def instance(segments, order, seed, axes=1):
    rng = np.random.default_rng(seed)
    # Angles stay within half a turn of each other, so that unwrapping leaves them alone.
    steps = rng.uniform(-1, 1, (segments + 1, axes)) * (3.0 if order == 2 else 10.0)
    return np.cumsum(steps, axis=0), np.exp(rng.uniform(np.log(0.05), np.log(20.0), segments))


def at_ends(coefficients, times):
    """Derivatives with respect to time at both ends of every segment, shape (S, 2, n, D)."""
    terms = coefficients.shape[1]
    falling = np.array([[math.perm(k, r) for k in range(terms)] for r in range(terms)], dtype=float)
    rates = times[:, None, None] ** -np.arange(terms)[:, None]
    start = (falling * np.eye(terms)) @ coefficients * rates
    return np.stack([start, falling @ coefficients * rates], axis=1)


DETERMINED = [
    (order, ends, segments)
    for order in (2, 3, 4)
    for ends, values in ENDS.items()
    for segments in (1, 2, 3, 60)
    if segments + 1 + sum(value is not None for end in values for value in end[: order - 1]) >= order
]


@pytest.mark.parametrize(("order", "ends", "segments"), DETERMINED)
def test_cost_and_curve_as_in_extended_precision(order, ends, segments):
    start, end = (values[: order - 1] for values in ENDS[ends])
    points, times = instance(segments, order, segments)
    spline = solve(order, points, times, start, end)
    pieces, cost = exact_spline(points[:, 0].tolist(), times.tolist(), order, start, end)
    truth = np.array([[float(value) for value in piece] for piece in pieces])
    # Free ends and few points cost nothing: rounding is then measured against a curve that stops at every point.
    stopping = (np.diff(points[:, 0]) ** 2 / times ** (2 * order - 1)).sum()
    assert spline.cost == pytest.approx(float(cost), rel=1e-9, abs=1e-20 * stopping)
    assert np.abs(spline.coefficients[:, :, 0] - truth).max() <= 1e-7 * np.abs(truth).max()


@pytest.mark.parametrize("order", [2, 3, 4])
def test_two_thousand_segments_from_0_05_to_20_s(order):
    points, times = instance(2000, order, 0)
    rest = [0.0] * (order - 1)
    _, cost = exact_spline(points[:, 0].tolist(), times.tolist(), order, rest, rest)
    assert abs(solve(order, points, times).cost / float(cost) - 1) <= 1e-9


@pytest.mark.parametrize("pattern", ["alternating", "step"])
def test_cost_at_the_most_uneven_times(pattern):
    points, _ = instance(60, 4, 1)
    long = np.arange(60) % 2 == 0 if pattern == "alternating" else np.arange(60) < 30
    times = np.where(long, 0.999 * MOST_UNEVEN, 1.0) * 1e-3
    _, cost = exact_spline(points[:, 0].tolist(), times.tolist(), 4, [0.0] * 3, [0.0] * 3)
    assert abs(minimum_snap_spline(points, times).cost / float(cost) - 1) <= 1e-9


@pytest.mark.parametrize("order", [2, 3, 4])
@pytest.mark.parametrize("ends", ["at rest", "moving", "mixed"])
def test_gradient_as_finite_differences_in_extended_precision(order, ends):
    start, end = (values[: order - 1] for values in ENDS[ends])
    points, times = instance(8, order, 3)
    gradient = solve(order, points, times, start, end).cost_gradient
    step = Decimal("1e-15")
    truth = []
    for segment in range(8):
        costs = []
        for sign in (1, -1):
            with localcontext(prec=DIGITS):
                moved = [Decimal(float(t)) for t in times]
                moved[segment] += sign * step
            costs.append(exact_spline(points[:, 0].tolist(), moved, order, start, end)[1])
        with localcontext(prec=DIGITS):
            truth.append(float((costs[0] - costs[1]) / (2 * step)))
    assert gradient == pytest.approx(truth, rel=1e-8, abs=1e-8 * np.abs(truth).max())


def test_gradient_of_a_long_curve_as_its_own_finite_differences():
    points, _ = instance(300, 4, 5, axes=3)
    times = np.random.default_rng(5).uniform(0.5, 3.0, 300)
    gradient = minimum_snap_spline(points, times).cost_gradient
    direction = np.random.default_rng(6).normal(size=300)
    step = 1e-5
    ahead, behind = (minimum_snap_spline(points, times + sign * step * direction).cost for sign in (1, -1))
    assert gradient @ direction == pytest.approx((ahead - behind) / (2 * step), rel=1e-6)


@pytest.mark.parametrize("order", [2, 3, 4])
def test_all_derivatives_that_should_be_are_continuous_and_the_points_are_met(order):
    points, _ = instance(40, order, 2, axes=1 if order == 2 else 3)
    times = np.random.default_rng(0).uniform(0.5, 2.0, 40)
    spline = solve(order, points, times)
    states = at_ends(spline.coefficients, times)
    assert states[:, 0, 0] == pytest.approx(points[:-1], abs=1e-12)
    assert states[:, 1, 0] == pytest.approx(points[1:], abs=1e-10)
    for k in range(1, 2 * order - 1):
        size = np.abs(states[:, :, k]).max()
        assert np.abs(states[1:, 0, k] - states[:-1, 1, k]).max() <= 1e-9 * size
    assert np.abs(states[0, 0, 1:order]).max() == 0
    assert np.abs(states[-1, 1, 1:order]).max() <= 1e-9 * np.abs(states).max()


def test_no_other_curve_through_the_points_costs_less():
    points, _ = instance(12, 4, 7, axes=2)
    times = np.random.default_rng(7).uniform(0.5, 2.0, 12)
    best = minimum_snap_spline(points, times)
    states = at_ends(best.coefficients, times)[:, 0, 1:4]
    rng = np.random.default_rng(8)
    for joint in range(1, 12):
        left = [states[0], states[joint] + 0.01 * rng.normal(size=(3, 2))]
        head = minimum_snap_spline(points[: joint + 1], times[:joint], None, list(left[1]))
        tail = minimum_snap_spline(points[joint:], times[joint:], list(left[1]), None)
        assert head.cost + tail.cost > best.cost
        same = list(states[joint])
        split = minimum_snap_spline(points[: joint + 1], times[:joint], None, same).cost
        split += minimum_snap_spline(points[joint:], times[joint:], same, None).cost
        assert split == pytest.approx(best.cost, rel=1e-9)


def test_one_straight_move_from_rest_to_rest():
    spline = minimum_snap_spline([[0.0, 0, 0], [3, 4, 0]], [2.5])
    assert spline.cost == pytest.approx(float(rest_to_rest_cost(5.0, np.array(2.5))), rel=1e-12)
    share = np.array([0, 0, 0, 0, 35, -84, 70, -20.0])
    assert spline.coefficients[0] == pytest.approx(share[:, None] * [3.0, 4.0, 0.0], abs=1e-12)
    assert spline.cost_gradient == pytest.approx([-7 * spline.cost / 2.5], rel=1e-12)


def test_free_ends_follow_a_cubic_at_no_cost():
    times = np.array([1.0, 0.5, 2.0, 1.5, 3.0])
    instants = np.concatenate([[0], np.cumsum(times)])
    cubic = np.polynomial.Polynomial([1.0, -2.0, 0.3, 0.05])
    spline = minimum_snap_spline(cubic(instants)[:, None], times, [None] * 3, [None] * 3)
    spots = np.linspace(0, 8, 50)
    assert spline.value(spots)[:, 0] == pytest.approx(cubic(spots), abs=1e-11)
    assert spline.cost == pytest.approx(0.0, abs=1e-18)


def test_end_derivatives_are_met_in_their_units():
    start = ([1.0, 2, 3], [0.1, 0.2, 0.3], [-1.0, 0, 1])
    points = np.random.default_rng(1).normal(size=(6, 3)) * 5
    spline = minimum_snap_spline(points, [0.7, 1.1, 3.0, 0.9, 2.0], start, (None, 0.5, None))
    for k in (1, 2, 3):
        assert spline.value(0.0, k) == pytest.approx(np.array(start[k - 1]), abs=1e-10)
    assert spline.value(7.7, 2) == pytest.approx(np.full(3, 0.5), abs=1e-9)
    # The natural conditions of the free velocity and jerk: derivatives 6 and 4 vanish.
    last = at_ends(spline.coefficients, spline.durations_s)[-1, 1]
    assert np.abs(last[[4, 6]]).max() <= 1e-8 * np.abs(spline.coefficients).max()


def test_axes_do_not_touch_each_other_and_place_and_pace_do_not_matter():
    points, times = instance(50, 4, 9, axes=3)
    together = minimum_snap_spline(points, times)
    alone = [minimum_snap_spline(points[:, [axis]], times) for axis in range(3)]
    assert together.coefficients[:, :, 1] == pytest.approx(alone[1].coefficients[:, :, 0], rel=1e-12, abs=1e-12)
    assert together.cost == pytest.approx(sum(one.cost for one in alone), rel=1e-12)
    assert minimum_snap_spline(points + 4096.0, times).cost == pytest.approx(together.cost, rel=1e-9)
    assert minimum_snap_spline(points, 1000 * times).cost == pytest.approx(1e-21 * together.cost, rel=1e-9)


@pytest.mark.parametrize("make", [minimum_snap_spline, minimum_jerk_spline])
def test_the_trajectory_is_the_same_curve(make):
    points = np.random.default_rng(4).normal(size=(9, 3)) * 10
    spline = make(points, np.full(8, 1.5))
    trajectory = spline.piecewise_polynomial()
    spots = np.linspace(-1, 13, 100)
    for order in range(4):
        assert trajectory.value(spots, order) == pytest.approx(spline.value(spots, order), abs=1e-9)
    assert trajectory.duration_s == 12.0
    with pytest.raises(InputError, match="three axes"):
        make(points[:, :2], np.full(8, 1.5)).piecewise_polynomial()


def test_the_callers_arrays_are_neither_kept_nor_changed():
    points, times = np.array([[0.0], [1.0], [3.0]]), np.array([1.0, 2.0])
    spline = minimum_snap_spline(points, times)
    times[0] = 9.0
    assert spline.durations_s.tolist() == [1.0, 2.0]
    assert points.tolist() == [[0.0], [1.0], [3.0]]


def test_yaw_goes_the_short_way_round_and_may_hold():
    yaw = yaw_spline(np.radians([170, -170, -170, 175, 0]), [1, 2, 1, 3.0])
    assert np.degrees(yaw.value([0, 1, 3, 4, 7])[:, 0]) == pytest.approx([170, 190, 190, 175, 0])
    assert yaw.coefficients.shape == (4, 4, 1)
    assert yaw.value([0.0, 7.0], 1)[:, 0] == pytest.approx([0, 0], abs=1e-12)


def test_yaw_of_least_acceleration_between_two_angles_is_the_smooth_step():
    spots = np.linspace(0, 2, 21)
    s = spots / 2
    assert yaw_spline([0.0, 1.2], [2.0]).value(spots)[:, 0] == pytest.approx(1.2 * (3 * s**2 - 2 * s**3))
    quintic = 1.2 * (10 * s**3 - 15 * s**4 + 6 * s**5)
    assert yaw_spline([0.0, 1.2], [2.0], "jerk").value(spots)[:, 0] == pytest.approx(quintic)


GOOD = np.arange(12.0).reshape(4, 3)


@pytest.mark.parametrize(
    ("points", "times", "field", "message"),
    [
        (np.zeros((0, 3)), [], "points_m", "at least two points, there is none"),
        ([[0.0, 0, 0]], [], "points_m", "at least two points, there is 1"),
        ([0.0, 1.0], [1], "points_m", "rows of coordinates"),
        ([[0.0, 0, 0], [1, 0, 0], [1, 0, 0]], [1, 1], "points_m", "segment 1 has no length"),
        ([[0.0, 0, 0], [1, 0, 0], [1, math.nan, 0]], [1, 1], "points_m", "segment 1: point 2 is not a finite"),
        ([[math.inf, 0, 0], [1, 0, 0]], [1], "points_m", "segment 0: point 0 is not a finite"),
        (GOOD, [1, 0, 1], "durations_s", "segment 1 lasts 0 s"),
        (GOOD, [1, 1, -2], "durations_s", "segment 2 lasts -2 s"),
        (GOOD, [1, math.nan, 1], "durations_s", "segment 1 lasts nan s"),
        (GOOD, [math.inf, 1, 1], "durations_s", "segment 0 lasts inf s"),
        (GOOD, [1, 1], "durations_s", "3 segments"),
        (GOOD, [1, 1e-5, 1], "durations_s", "segment 1 lasts 1e-05 s"),
        (GOOD * 1e307, [1, 1, 1], "points", "too large"),
    ],
)
@pytest.mark.parametrize("make", [minimum_snap_spline, minimum_jerk_spline])
def test_bad_input_names_the_segment(make, points, times, field, message):
    with pytest.raises(InputError, match=message) as caught:
        make(points, times)
    assert caught.value.field == field


@pytest.mark.parametrize(
    ("start", "message"),
    [
        ([0.0, 0.0], "velocity, acceleration, jerk"),
        ([math.nan, None, None], "velocity must be a finite"),
        ([None, [1.0, 2.0], None], "acceleration must be a finite number or one for each of 3 axes"),
    ],
)
def test_bad_end_derivatives_are_named(start, message):
    with pytest.raises(InputError, match=message):
        minimum_snap_spline(GOOD, [1, 1, 1], start)


@pytest.mark.parametrize(
    ("points", "start", "end"),
    [
        (2, [None] * 3, [None] * 3),
        (3, [None] * 3, [None] * 3),
        # The jerk of a cubic is the same at both ends: the second one says nothing new.
        (2, [None, None, 0.0], [None, None, 0.0]),
    ],
)
def test_curves_that_are_not_determined_are_refused(points, start, end):
    with pytest.raises(InputError, match="undetermined"):
        minimum_snap_spline(GOOD[:points], np.ones(points - 1), start, end)
    minimum_snap_spline(GOOD[:points], np.ones(points - 1), start, None)


def test_bad_yaw_is_named():
    with pytest.raises(InputError, match="segment 0: point 1 is not a finite") as caught:
        yaw_spline([0.0, math.nan, 1.0], [1, 1])
    assert caught.value.field == "yaw_rad"
    with pytest.raises(InputError, match="segment 1 lasts 0 s"):
        yaw_spline([0.0, 1.0, 1.0], [1, 0])
