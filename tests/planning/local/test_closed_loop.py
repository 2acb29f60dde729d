"""Scans to motion, over and over: a vehicle flies a plan among standing and moving obstacles that are not in it.

The lidar says the least range of each sector of 5 degrees, the position has a slow error, and the vehicle follows its
setpoints with a lag. Distances are those of the true vehicle from the true obstacles.
"""

import itertools
import math

import numpy as np
import pytest

from gcs.planning.local.curve_parts import joined_curves
from gcs.planning.local.navigator import LocalNavigator, Stop
from gcs.planning.trajectories.flight_limits import FlightLimits
from gcs.planning.trajectories.optimal_times import times_at_limits

LIMITS = FlightLimits(4.0, 2.5, 10.0)
HULL = 0.5
PERIOD, FINE, DWELL = 0.1, 0.05, 0.6
LAG_S, FED_FORWARD = 0.3, 0.7


class Vehicle:
    """A position loop about a velocity that follows with a lag."""

    def __init__(self, place):
        self.place, self.velocity = np.array(place), np.zeros(3)

    def step(self, motion, believed, seconds):
        wanted = motion[1] + (motion[0] - believed) + FED_FORWARD * LAG_S * motion[2]
        self.velocity = self.velocity + (wanted - self.velocity) / LAG_S * seconds
        self.place = self.place + self.velocity * seconds


def plan_through(points):
    legs = [times_at_limits(np.stack(ends), LIMITS).piecewise_polynomial() for ends in itertools.pairwise(points)]
    ends = np.cumsum([leg.duration_s for leg in legs])
    return joined_curves(*legs), [Stop(float(end), k) for k, end in enumerate(ends)]


def fly(points, obstacles, seed, sector_scan, seconds=150.0):
    """Least distance of the hull from any obstacle, viewpoints photographed, reports, the navigator.

    Args:
        obstacles: for each a radius and a function from time to its place.
    """
    rng = np.random.default_rng([seed, 5])
    trajectory, stops = plan_through(points)
    navigator = LocalNavigator(trajectory, stops, LIMITS)
    vehicle = Vehicle(points[0])
    least, photos, reports, since = math.inf, [], [], None
    heading = rng.uniform(-3, 3)
    for step in range(round(seconds / PERIOD)):
        clock = 100.0 + step * PERIOD
        wrong = 0.1 * np.array([math.sin(0.11 * clock + seed), math.cos(0.07 * clock), 0.0])
        circles = [(*place(clock - 100.0), radius) for radius, place in obstacles]
        navigator.see(sector_scan(vehicle.place[:2], heading, circles, rng), vehicle.place + wrong, heading, clock)
        reports += navigator.decide(clock)
        if navigator.arrived is None:
            since = None
        elif since is None:
            since = clock
        elif clock - since > DWELL:
            photos.append(navigator.arrived)
            navigator.go_on(navigator.arrived)
        if navigator.finished or navigator.gave_up:
            break
        for fine in range(round(PERIOD / FINE)):
            later = clock + (fine + 1) * FINE
            vehicle.step(navigator.motion(later), vehicle.place + wrong, FINE)
            for radius, place in obstacles:
                least = min(least, float(np.linalg.norm(vehicle.place[:2] - place(later - 100.0))) - radius - HULL)
    return least, photos, reports, navigator


def standing(x, y, radius):
    return radius, lambda time: np.array([x, y])


def crossing(meet, when, velocity, radius, stops_for=0.0):
    """Straight on, but for a stop at the place where it would be met."""

    def place(time):
        moved = time - when if time < when else max(time - when - stops_for, 0.0)
        return meet + moved * velocity

    return radius, place


def random_world(seed):
    rng = np.random.default_rng([seed, 7])
    points = [np.array([0.0, 0.0, 10.0])]
    for _ in range(2):
        points.append(points[-1] + np.array([rng.uniform(11, 17), rng.uniform(-4, 4), 0.0]))
    on_way = [points[0] + share * (points[1] - points[0]) for share in (0.4, 0.7)]
    obstacles = [
        standing(*(on_way[k][:2] + rng.normal(0, 0.7, 2)), rng.uniform(0.3, 1.0)) for k in range(rng.integers(3))
    ]
    for _ in range(2):
        radius, quickest = [(0.3, 1.8), (1.3, 3.0), (0.4, 4.0)][rng.integers(3)]
        turn = rng.uniform(0, 2 * math.pi)
        velocity = rng.uniform(0.5, quickest) * np.array([math.cos(turn), math.sin(turn)])
        meet = (points[1] + rng.uniform(-0.5, 0.8) * (points[2] - points[1]))[:2]
        mover = crossing(meet, rng.uniform(9, 16), velocity, radius, rng.choice([0.0, 12.0]))
        times = np.arange(0.0, 60.0, 0.2)
        unfair = min(np.linalg.norm(mover[1](time)) for time in np.arange(0.0, 4.0, 0.2)) < 6.0
        if not unfair and all(
            min(np.linalg.norm(mover[1](time) - place(time)) for time in times) > radius + other + 0.3
            for other, place in obstacles
        ):
            obstacles.append(mover)
    return points, obstacles


@pytest.mark.parametrize("seed", range(5))
def test_nothing_is_touched_and_every_viewpoint_is_photographed_or_left_out(seed, sector_scan):
    points, obstacles = random_world(seed)
    least, photos, reports, navigator = fly(points, obstacles, seed, sector_scan)
    assert least > 0
    assert navigator.finished or navigator.gave_up
    assert sorted([*photos, *(skipped for report in reports for skipped in report.skipped)]) == [0, 1]


def test_a_free_flight_is_the_plan(sector_scan):
    points = [np.array([0.0, 0.0, 10.0]), np.array([15.0, 2.0, 12.0])]
    _, photos, reports, navigator = fly(points, [standing(5.0, 9.0, 1.0)], 0, sector_scan)
    assert (photos, reports, navigator.finished) == ([0], [], True)


def test_a_parked_thing_on_the_way_is_flown_round_and_reported(sector_scan):
    points = [np.array([0.0, 0.0, 10.0]), np.array([25.0, 0.0, 10.0])]
    least, photos, reports, navigator = fly(points, [standing(13.0, 0.2, 1.0)], 0, sector_scan)
    assert least > 0.2
    assert photos == [0]
    assert navigator.finished
    x, y, _, *velocity = reports[0].obstacle
    assert math.dist((x, y), (13.0, 0.2)) < 0.7
    assert velocity == [0.0, 0.0]
    assert abs(reports[0].path_m[:, 1]).max() > 1.0
    assert reports[0].left_clock_s < reports[0].rejoined_clock_s


@pytest.mark.parametrize("heights", [(6.0, 14.0, 9.0), (14.0, 6.0, 12.0)])
def test_masts_on_climbing_legs_cost_no_viewpoint(heights, sector_scan):
    points = [np.array([x, y, z]) for (x, y), z in zip([(0.0, 0.0), (14.0, 1.0), (25.0, -3.0)], heights, strict=True)]
    masts = [standing(7.0, 0.7, 0.3), standing(20.0, -1.0, 0.4)]
    least, photos, reports, navigator = fly(points, masts, 3, sector_scan)
    assert least > 0.2
    assert photos == [0, 1]
    assert navigator.finished
    assert not any(report.skipped for report in reports)


def test_a_viewpoint_that_is_blocked_is_waited_for_and_left_out(sector_scan):
    points = [np.array([x, 0.0, 10.0]) for x in (0.0, 12.0, 26.0)]
    least, photos, reports, navigator = fly(points, [standing(12.2, 0.3, 0.8)], 0, sector_scan)
    assert least > 0.2
    assert photos == [1]
    assert navigator.finished
    assert [report.skipped for report in reports if report.skipped] == [(0,)]


def test_who_stands_at_a_viewpoint_for_a_while_is_waited_for(sector_scan):
    points = [np.array([x, 0.0, 10.0]) for x in (0.0, 12.0, 24.0)]
    person = crossing(np.array([12.0, 0.5]), 6.0, np.array([0.0, 1.2]), 0.3, stops_for=10.0)
    least, photos, reports, _ = fly(points, [person], 1, sector_scan)
    assert least > 0.2
    assert photos == [0, 1]
    assert not any(report.skipped for report in reports)


def test_an_end_that_stays_blocked_ends_the_flight_with_a_report(sector_scan):
    points = [np.array([0.0, 0.0, 10.0]), np.array([14.0, 0.0, 10.0])]
    least, photos, reports, navigator = fly(points, [standing(14.0, 0.0, 1.0)], 0, sector_scan)
    assert least > 0.2
    assert not photos
    assert "hovers" in navigator.gave_up
    assert reports[-1].skipped == (0,)
    assert reports[-1].rejoined_clock_s is None


@pytest.mark.parametrize("speed", [1.0, 3.0])
def test_a_vehicle_that_hovers_at_a_viewpoint_makes_way(speed, sector_scan):
    points = [np.array([0.0, 0.0, 10.0]), np.array([6.0, 0.0, 10.0]), np.array([12.0, 0.0, 10.0])]
    trajectory, stops = plan_through(points)
    navigator = LocalNavigator(trajectory, stops, LIMITS)
    vehicle, clock, least, went = Vehicle(points[0]), 0.0, math.inf, False
    while clock < 30.0:  # nobody says go on
        place = np.array([6.0, 0.3]) + (clock - 14.0) * np.array([0.0, speed])
        navigator.see(sector_scan(vehicle.place[:2], 0.0, [(*place, 1.2)]), vehicle.place, 0.0, clock)
        navigator.decide(clock)
        went |= navigator.away
        vehicle.step(navigator.motion(clock + PERIOD), vehicle.place, PERIOD)
        clock += PERIOD
        least = min(least, float(np.linalg.norm(vehicle.place[:2] - place)) - 1.2 - HULL)
    assert went
    assert least > 0.1
    assert navigator.arrived == 0  # it is back
