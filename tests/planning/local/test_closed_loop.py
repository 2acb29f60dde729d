"""Lidar to curve, over and over: a vehicle flies among standing and moving obstacles that are in no plan."""

import math

import numpy as np
import pytest

from gcs.planning.local.evasion import EvasionOptions, evade
from gcs.planning.local.lidar_map import LidarMap
from gcs.planning.local.lidar_scan import LidarScan
from gcs.planning.local.moving_tracks import Tracker
from gcs.planning.local.scan_clusters import scan_discs
from gcs.planning.local.space_time import MovingClearance
from gcs.planning.trajectories.flight_limits import FlightLimits
from gcs.planning.trajectories.optimal_times import times_at_limits

LIMITS = FlightLimits(4.0, 2.5, 10.0)
GOAL = np.array([50.0, 0.0, 10.0])
HULL = 0.5
OPTIONS = EvasionOptions(safe_m=1.2, moving=MovingClearance(keep_m=1.4))
BEAMS = 360
PERIOD, FINE = 0.2, 0.05


def scan_of(position, circles, rng):
    bearings = 2 * math.pi / BEAMS * np.arange(BEAMS)
    rays = np.column_stack([np.cos(bearings), np.sin(bearings)])
    ranges = np.full(BEAMS, math.inf)
    for x, y, radius in circles:
        to = np.array([x, y]) - position
        along = rays @ to
        square = radius**2 - (to @ to - along**2)
        hit = (square > 0) & (along > 0)
        ranges[hit] = np.minimum(ranges[hit], along[hit] - np.sqrt(square[hit]))
    noisy = ranges + rng.normal(0.0, 0.02, BEAMS)
    return LidarScan(np.where(noisy < 20.0, np.maximum(noisy, 0.0), math.inf), 0.0, 2 * math.pi / BEAMS, 20.0)


def towards_goal(place):
    return times_at_limits(np.stack([place, GOAL]), LIMITS).piecewise_polynomial()


def fly(standing, moving, rng, seconds=120.0):
    """Least distance of the hull's surface from any obstacle, and whether the goal was reached.

    Args:
        standing: x, y, radius of each.
        moving: x, y, radius and velocity of each at time 0.
    """
    flown, at = towards_goal(np.array([0.0, 0.0, 10.0])), 0.0
    tracker, area = Tracker(), LidarMap(50.0, 0.2, 4.0)
    least = math.inf
    for step in range(round(seconds / PERIOD)):
        clock = step * PERIOD
        place = flown.value(at)
        if at >= flown.duration_s:
            if np.linalg.norm(place - GOAL) < 0.1:
                return least, True
            flown, at = towards_goal(place), 0.0
        circles = [*standing, *[(x + vx * clock, y + vy * clock, r) for x, y, r, vx, vy in moving]]
        scan = scan_of(place[:2], circles, rng)
        tracker.see(scan_discs(scan, place[:2], 0.0), clock)
        tracks = tracker.moving()
        discs = np.array([[*track.state[:2], track.radius_m] for track in tracks]).reshape(-1, 3)
        area.take(scan, place[:2], 0.0, clock, discs)
        evasion = evade(flown, at, area.blocked_at(clock), tracks, clock, LIMITS, OPTIONS)
        if evasion.kind == "detour":
            flown = evasion.detour.flown(flown)
        elif evasion.kind != "fly on":
            flown, at = evasion.curve, 0.0
        for _ in range(round(PERIOD / FINE)):
            at, clock = at + FINE, clock + FINE
            x, y, _ = flown.value(at)
            for cx, cy, radius in standing:
                least = min(least, math.hypot(x - cx, y - cy) - radius - HULL)
            for cx, cy, radius, vx, vy in moving:
                least = min(least, math.hypot(x - cx - vx * clock, y - cy - vy * clock) - radius - HULL)
    return least, False


@pytest.mark.parametrize("seed", range(6))
def test_nothing_is_touched_and_the_goal_is_reached(seed):
    rng = np.random.default_rng(seed)
    standing = [(rng.uniform(12, 42), rng.uniform(-2, 2), rng.uniform(0.3, 1.2)) for _ in range(2)]
    moving = []
    for _ in range(2):  # each crosses the straight way at some place and time
        meet, when = np.array([rng.uniform(10, 45), rng.normal(0.0, 1.0)]), rng.uniform(10.0, 20.0)
        turn, speed = rng.uniform(0.25, 0.75) * math.pi * rng.choice([-1, 1]), rng.uniform(0.5, 1.8)
        velocity = speed * np.array([math.cos(turn), math.sin(turn)])
        moving.append((*(meet - when * velocity), rng.uniform(0.3, 1.0), *velocity))
    least, reached = fly(standing, moving, rng)
    assert reached
    assert least > 0
