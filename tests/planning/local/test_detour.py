"""Detours: they join smoothly, hold the limits, keep off what is in the way, and say when there is none."""

import itertools
import math

import numpy as np
import pytest

from gcs.core.errors import InfeasibleError, InputError
from gcs.planning.local.binary_map import BinaryMap
from gcs.planning.local.curve_parts import joined_curves
from gcs.planning.local.detour import DetourOptions, plan_detour
from gcs.planning.trajectories.flight_limits import FlightLimits
from gcs.planning.trajectories.optimal_times import times_at_limits

LIMITS = FlightLimits(5.0, 2.5, 10.0)
HEIGHT = 10.0
R = 1.5


def straight(*points):
    """Flown from stop to stop."""
    legs = [times_at_limits(np.array(leg, dtype=float), LIMITS) for leg in itertools.pairwise(points)]
    return joined_curves(*[leg.piecewise_polynomial() for leg in legs])


@pytest.fixture(scope="module")
def trajectory():
    return straight((0, 0, HEIGHT), (60, 0, HEIGHT))


def map_of_circles(*circles, cell=0.2):
    middles = [np.arange(n) * cell + low + cell / 2 for n, low in ((350, -5.0), (200, -20.0))]
    x, y = np.meshgrid(*middles, indexing="ij")
    blocked = np.zeros((350, 200), dtype=np.bool_)
    for cx, cy, radius in circles:
        blocked |= np.hypot(x - cx, y - cy) < radius
    return BinaryMap(blocked, np.array([-5.0, -20.0]), cell).grown(R)


@pytest.mark.parametrize("seed", range(25))
def test_a_detour_keeps_off_holds_the_limits_and_joins_smoothly(trajectory, seed):
    rng = np.random.default_rng(seed)
    circle = (rng.uniform(25, 35), rng.uniform(-1.5, 1.5), rng.uniform(0.5, 2.5))
    now = rng.uniform(0.0, 9.0)
    slab = (HEIGHT - 0.5, HEIGHT + 0.5)
    detour = plan_detour(trajectory, now, map_of_circles(circle), LIMITS, DetourOptions(slab_m=slab))
    assert now < detour.leave_s < detour.rejoin_s
    for order in range(4):  # position, velocity, acceleration, jerk
        ends = detour.curve.value([0.0, detour.curve.duration_s], order)
        wanted = trajectory.value([detour.leave_s, detour.rejoin_s], order)
        assert np.allclose(ends, wanted * [[1.0], [detour.pace**order]], atol=1e-6)
    flown = detour.flown(trajectory)
    assert flown.duration_s == pytest.approx(trajectory.duration_s + detour.delay_s)
    times = np.linspace(0.0, flown.duration_s, 20_000)
    points = flown.value(times)
    assert np.hypot(points[:, 0] - circle[0], points[:, 1] - circle[1]).min() >= circle[2] + R - 0.15
    for order, most in ((1, 5.0), (2, 2.5), (3, 10.0)):
        assert np.linalg.norm(flown.value(times, order), axis=1).max() <= most * (1 + 1e-9)
    assert ((points[:, 2] >= slab[0]) & (points[:, 2] <= slab[1])).all()
    assert (np.linalg.norm(np.diff(points, axis=0), axis=1) < 5.0 * np.diff(times) + 1e-9).all()


def test_nothing_in_the_way_is_no_detour(trajectory):
    assert plan_detour(trajectory, 1.0, map_of_circles((30.0, 9.0, 2.0)), LIMITS) is None
    behind = plan_detour(trajectory, 20.0, map_of_circles((10.0, 0.0, 2.0)), LIMITS)
    assert behind is None


def test_the_same_is_planned_every_time(trajectory):
    area = map_of_circles((30.0, 0.5, 2.0))
    one, other = (plan_detour(trajectory, 3.0, area, LIMITS) for _ in range(2))
    assert (one.curve.coefficients == other.curve.coefficients).all()


def test_a_viewpoint_that_can_be_reached_is_not_skipped_and_one_that_cannot_is_said():
    flight = straight((0, 0, HEIGHT), (15, 0, HEIGHT), (35, 0, HEIGHT), (60, 0, HEIGHT))
    ends = flight.starts_s[[0, 1, 2]].tolist()
    stops = ends[1:]
    reachable = plan_detour(flight, 0.5, map_of_circles((25.0, 0.0, 1.0)), LIMITS, stops_s=stops)
    assert reachable.leave_s == pytest.approx(stops[0])
    assert reachable.skipped(stops) == []
    covered = plan_detour(flight, 0.5, map_of_circles((35.0, 0.5, 1.0)), LIMITS, stops_s=stops)
    assert covered.leave_s == pytest.approx(stops[0])
    assert covered.skipped(stops) == [1]


def test_two_obstacles_one_behind_the_other(trajectory):
    circles = ((22.0, 0.5, 1.0), (38.0, -0.5, 1.0))
    area = map_of_circles(*circles)
    flight, now = trajectory, 2.0
    for _ in range(3):
        detour = plan_detour(flight, now, area, LIMITS)
        if detour is None:
            break
        flight, now = detour.flown(flight), detour.leave_s + detour.curve.duration_s - 0.5
    assert detour is None
    points = flight.value(np.linspace(0, flight.duration_s, 10_000))
    for x, y, radius in circles:
        assert np.hypot(points[:, 0] - x, points[:, 1] - y).min() >= radius + R - 0.15


def test_with_a_lidar_in_the_plane_it_does_not_rejoin_above_the_slab():
    climbing = straight((0, 0, HEIGHT), (40, 0, HEIGHT), (40, 0, 30), (60, 0, 30))
    area = map_of_circles((39.0, 0.0, 1.5))
    assert plan_detour(climbing, 8.0, area, LIMITS) is not None
    with pytest.raises(InfeasibleError, match="no way round"):
        plan_detour(climbing, 8.0, area, LIMITS, DetourOptions(slab_m=(HEIGHT - 0.5, HEIGHT + 0.5)))


def test_what_was_seen_below_counts_where_the_trajectory_climbs_into_it():
    climbing = straight((0, 0, HEIGHT), (20, 0, 30))
    mast = map_of_circles((12.0, 0.0, 0.5))
    slab = DetourOptions(slab_m=(HEIGHT - 0.5, HEIGHT + 0.5))
    with pytest.raises(InfeasibleError, match="no way round"):  # it would be met at 22 m
        plan_detour(climbing, 0.0, mast, LIMITS, slab)


def test_what_is_only_forbidden_does_not_block_the_trajectory_itself(trajectory):
    area, standing = map_of_circles((30.0, 0.0, 1.0)), map_of_circles()
    assert plan_detour(trajectory, 2.0, area, LIMITS, standing=standing) is None
    assert plan_detour(trajectory, 2.0, area, LIMITS) is not None


def test_a_wall_is_said(trajectory):
    area = map_of_circles(*[(30.0, y, 0.5) for y in np.arange(-20.0, 20.0, 0.5)])
    with pytest.raises(InfeasibleError, match="hold or back off"):
        plan_detour(trajectory, 2.0, area, LIMITS)


def test_an_obstacle_that_is_there_at_once_is_said(trajectory):
    place = trajectory.value(13.0)
    with pytest.raises(InfeasibleError, match="before a detour can begin"):
        plan_detour(trajectory, 13.0, map_of_circles((place[0] + 1.0, 0.0, 1.0)), LIMITS)


def test_where_the_trajectory_has_no_speed_to_spare_it_is_joined_slower_until_it_next_stands():
    quick = straight((0, 0, HEIGHT), (30, 0, HEIGHT), (80, 0, HEIGHT))
    stop = float(quick.starts_s[1])
    whole = map_of_circles((10.0, 0.3, 1.5))
    near = BinaryMap(whole.blocked[:145], whole.origin_m, whole.cell_m)  # the lidar sees no further than 24 m
    detour = plan_detour(quick, 0.0, near, LIMITS, stops_s=[stop])
    assert detour.pace < 1
    assert detour.own_pace_s == stop
    flown = detour.flown(quick)
    assert flown.duration_s == pytest.approx(quick.duration_s + detour.delay_s)
    late = np.linspace(0.01, quick.duration_s - stop, 50)
    assert np.allclose(flown.value(stop + detour.delay_s + late), quick.value(stop + late), atol=1e-6)
    joints = flown.starts_s[1:-1]
    for order in range(4):
        step = 1e-7
        before, after = flown.value(joints - step, order), flown.value(joints + step, order)
        assert np.allclose(before, after, atol=1e-3)


@pytest.mark.parametrize("now", [-1.0, 1e3, math.nan])
def test_a_time_off_the_trajectory_is_refused(trajectory, now):
    with pytest.raises(InputError) as error:
        plan_detour(trajectory, now, map_of_circles(), LIMITS)
    assert error.value.field == "now_s"
