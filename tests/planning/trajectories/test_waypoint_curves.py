"""Curves through the corners of legs: rest, limits, which points are passed, and bad input."""

import itertools

import numpy as np
import pytest

from gcs.core.errors import InfeasibleError, InputError, OperationCancelled
from gcs.core.progress import SilentProgress
from gcs.core.trajectory import PiecewisePolynomial
from gcs.planning.trajectories.flight_limits import FlightLimits
from gcs.planning.trajectories.waypoint_curves import LegEnds, hull_boxes, waypoint_curves, waypoints

LIMITS = FlightLimits(5.0, 2.5, 10.0)
VARIANTS = ("plain", "corrected", "geometric")
HALF_WIDTH_M = 0.5
CORNERED = np.array([[0.0, 0, 10], [12, 0, 10], [12, 9, 14], [20, 9, 14]])
FROM_HOME = np.array([[-20.0, -20, 0], [-20, -20, 8], [0, -20, 12], [0, -5, 12]])


def curve(variant, leg=CORNERED, end=LegEnds(), limits=LIMITS, **options):  # noqa: B008
    (spline,) = waypoint_curves(variant, [leg], [end], limits, HALF_WIDTH_M, SilentProgress(), **options)
    return PiecewisePolynomial(spline.coefficients, spline.durations_s)


def densely(trajectory, order=0):
    return trajectory.value(np.linspace(0, trajectory.duration_s, 20_001), order)


def nearest(trajectory, point):
    return np.linalg.norm(densely(trajectory) - point, axis=1).min()


@pytest.mark.parametrize("variant", VARIANTS)
def test_it_rests_at_the_stops_and_uses_a_limit_up_without_passing_any(variant):
    trajectory = curve(variant)
    for t, stop in ((0.0, CORNERED[0]), (trajectory.duration_s, CORNERED[-1])):
        np.testing.assert_allclose(trajectory.value(t), stop, atol=1e-9)
        for order in (1, 2, 3):
            np.testing.assert_allclose(trajectory.value(t, order), 0.0, atol=1e-6)
    shares = [
        np.linalg.norm(densely(trajectory, order), axis=1).max() / limit
        for order, limit in enumerate(vars(LIMITS).values(), start=1)
    ]
    assert 0.99 < max(shares) <= 1.0


@pytest.mark.parametrize("variant", VARIANTS)
def test_position_to_jerk_have_no_jumps(variant):
    trajectory = curve(variant)
    joints = trajectory.starts_s[1:-1]
    for order in range(4):
        jump = trajectory.value(joints + 1e-9, order) - trajectory.value(joints - 1e-9, order)
        assert np.abs(jump).max() < 1e-5


def test_plain_goes_through_the_corners_and_the_others_past_them_within_the_deviation():
    for corner in CORNERED[1:-1]:
        assert nearest(curve("plain"), corner) < 1e-3
    for variant, count in (("corrected", 2), ("geometric", 4)):
        points = waypoints(variant, CORNERED, np.zeros(4, dtype=bool), HALF_WIDTH_M)
        assert len(points) == 2 + 2 * count
        away = np.linalg.norm(points[:, None] - CORNERED[None, 1:-1], axis=2).min()
        assert away > 0.1
        trajectory = curve(variant)
        assert max(nearest(trajectory, point) for point in points) < 1e-3
        for corner in CORNERED[1:-1]:
            middle = np.linspace(0, 1, 400)[:, None]
            past = np.concatenate([a + middle * (b - a) for a, b in itertools.pairwise(points)])
            assert 0.05 < np.linalg.norm(past - corner, axis=1).min() <= HALF_WIDTH_M + 1e-4


@pytest.mark.parametrize("variant", ["corrected", "geometric"])
def test_points_that_are_to_be_passed_are_never_cut_away(variant):
    passed = np.array([False, True, False, False])
    trajectory = curve(variant, passed=[passed])
    assert nearest(trajectory, CORNERED[1]) < 1e-3
    assert np.linalg.norm(trajectory.value(trajectory.starts_s, 1), axis=1)[1:-1].min() > 0.1  # without a stop
    assert nearest(curve(variant), CORNERED[1]) > 0.05


@pytest.mark.parametrize("variant", VARIANTS)
def test_take_off_and_landing_are_straight_up_and_down(variant):
    home = FROM_HOME[0]
    for leg, end in ((FROM_HOME, LegEnds(column_at_start=True)), (FROM_HOME[::-1], LegEnds(column_at_end=True))):
        points = densely(curve(variant, leg, end))
        low = points[points[:, 2] < 7.9]
        assert len(low) > 500
        np.testing.assert_allclose(low[:, :2], np.broadcast_to(home[:2], (len(low), 2)), atol=1e-9)
        assert points[:, 2].min() >= -1e-9
    column = np.array([home, FROM_HOME[1], home])
    there = densely(curve(variant, column, LegEnds(True, True)))
    np.testing.assert_allclose(there[:, :2], np.broadcast_to(home[:2], (len(there), 2)), atol=1e-9)
    assert there[:, 2].max() == pytest.approx(8.0, abs=1e-6)


class Wall:
    """Free where y is less than half a metre: corners at y = 0 cannot be rounded by more."""

    def segment_free(self, a, b):
        return bool(max(a[1], b[1]) <= 0.1)


def test_the_new_points_keep_the_clearance():
    leg = np.array([[0.0, 0.1, 10], [10, 0, 10], [20, 0.1, 10]])
    turned = np.array([[0.0, 3, 10], [10, 0, 10], [20, 3, 10]])
    for variant in ("corrected", "geometric"):
        free = waypoints(variant, leg, np.zeros(3, dtype=bool), HALF_WIDTH_M, Wall())
        assert len(free) > 3
        points = waypoints(variant, turned, np.zeros(3, dtype=bool), HALF_WIDTH_M, Wall())
        inner = points[1:-1]
        assert inner[:, 1].max() <= 0.1
        assert len(points) == len(free)
        assert inner[:, 1].max() > 0.05  # as large as there is room for


@pytest.mark.parametrize("variant", VARIANTS)
def test_the_boxes_hold_the_curve(variant):
    trajectory = curve(variant)
    boxes = hull_boxes(trajectory.coefficients)
    t = np.linspace(0, trajectory.duration_s, 20_001)
    segment = np.clip(np.searchsorted(trajectory.starts_s, t, side="right") - 1, 0, len(boxes) - 1)
    points = trajectory.value(t)
    assert (points >= boxes[segment, 0] - 1e-9).all()
    assert (points <= boxes[segment, 1] + 1e-9).all()
    assert np.ptp(boxes, axis=1).max() < 3 * np.linalg.norm(np.diff(CORNERED, axis=0), axis=1).max()


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize(
    ("leg", "message"),
    [
        (CORNERED[:1], "at least two points"),
        (CORNERED[[0, 1, 1, 2]], "one place"),
        (np.where(np.arange(12).reshape(4, 3) == 5, np.nan, CORNERED), "not a finite number"),
        (np.where(np.arange(12).reshape(4, 3) == 5, np.inf, CORNERED), "not a finite number"),
    ],
)
def test_bad_legs_are_refused_with_the_stops_named(variant, leg, message):
    with pytest.raises(InputError, match=rf"between stops 1 and 2: .*{message}"):
        waypoint_curves(variant, [CORNERED, leg], [LegEnds()] * 2, LIMITS, HALF_WIDTH_M, SilentProgress())


@pytest.mark.parametrize(
    ("limits", "field"),
    [
        (FlightLimits(0.0, 2.5), "speed_m_s"),
        (FlightLimits(5.0, -1.0), "acceleration_m_s2"),
        (FlightLimits(5.0, float("nan")), "acceleration_m_s2"),
        (FlightLimits(5.0, 2.5, 0.0), "jerk_m_s3"),
        (FlightLimits(float("inf"), 2.5), "speed_m_s"),
    ],
)
def test_limits_that_are_none_are_refused_by_name(limits, field):
    with pytest.raises(InputError, match=f"{field}: a limit must be positive"):
        curve("plain", limits=limits)


@pytest.mark.parametrize("limits", [FlightLimits(1e-300, 2.5), FlightLimits(5.0, 1e-9), FlightLimits(5.0, 2.5, 1e-14)])
def test_limits_that_cannot_be_met_are_one_clear_error(limits):
    with pytest.raises(InfeasibleError, match=r"between stops 0 and 1: .* raise them"):
        curve("plain", limits=limits)


def test_a_deviation_that_is_not_positive_is_refused():
    for bad in (0.0, -1.0, float("nan")):
        with pytest.raises(InputError, match="the deviation must be positive"):
            waypoints("geometric", CORNERED, np.zeros(4, dtype=bool), bad)


class Counted:
    def __init__(self, most):
        self.fractions, self.most = [], most

    def report(self, stage, fraction):
        assert stage == "trajectory"
        self.fractions.append(fraction)
        if len(self.fractions) > self.most:
            raise OperationCancelled("stop")


def test_it_tells_how_far_it_is_and_can_be_stopped():
    legs, ends = [CORNERED, CORNERED + 1.0], [LegEnds()] * 2
    told = Counted(10_000)
    waypoint_curves("geometric", legs, ends, LIMITS, HALF_WIDTH_M, told)
    assert told.fractions == sorted(told.fractions)
    assert told.fractions[-1] == 1.0
    with pytest.raises(OperationCancelled):
        waypoint_curves("geometric", legs, ends, LIMITS, HALF_WIDTH_M, Counted(3))
