"""Ways back to a leg: straight to its end, in passing, or by stepping stones where the leg is at other heights."""

import math

import numpy as np
import pytest

from gcs.planning.local.binary_map import BinaryMap
from gcs.planning.local.detour import DetourOptions
from gcs.planning.local.evasion import EvasionOptions, standing_room
from gcs.planning.local.known_room import KnownRoom
from gcs.planning.local.moving_tracks import Track
from gcs.planning.local.space_time import MovingClearance
from gcs.planning.local.surroundings import Scene
from gcs.planning.local.way_back import WayBack
from gcs.planning.trajectories.flight_limits import FlightLimits
from gcs.planning.trajectories.optimal_times import times_at_limits

LIMITS = FlightLimits(4.0, 2.5, 10.0)
SAFE, HALF = 1.2, 0.5


def leg_through(*points):
    return times_at_limits(np.array(points, dtype=float), LIMITS).piecewise_polynomial()


def seen_map(*circles):
    middles = np.arange(250) * 0.2 - 25 + 0.1
    x, y = np.meshgrid(middles, middles, indexing="ij")
    blocked = np.zeros(x.shape, dtype=np.bool_)
    for cx, cy, radius in circles:
        blocked |= np.hypot(x - cx, y - cy) < radius
    return BinaryMap(blocked, np.array([-25.0, -25.0]), 0.2)


def find(leg, place, *circles, left_s=0.0, last_s=None, tracks=(), known=None):
    place = np.asarray(place, dtype=float)
    slab = (place[2] - HALF, place[2] + HALF)
    room = None if known is None else KnownRoom(known, leg)
    seen = seen_map(*circles)
    forbidden = None if room is None else room.forbidden(seen, place)
    scene = Scene(50.0, seen, list(tracks), np.empty((0, 3)), forbidden, slab, room)
    options = EvasionOptions(SAFE, MovingClearance(SAFE), DetourOptions(slab_m=slab, known=room))
    last_s = leg.duration_s if last_s is None else last_s
    way = WayBack(leg, left_s, last_s, scene, standing_room(scene, SAFE), LIMITS, options)
    return way.find(place, left_s)


def path_of(flown):
    return flown.curve.value(np.linspace(0.0, flown.curve.duration_s, 5000))


def assert_keeps_off(flown, *circles):
    places = path_of(flown)
    for x, y, radius in circles:
        assert np.hypot(places[:, 0] - x, places[:, 1] - y).min() >= radius + SAFE - 0.15


LEVEL = leg_through((0, 0, 10), (15, 0, 10))
CLIMBING = leg_through((0, 0, 10), (15, 0, 18))


def test_where_the_end_can_be_seen_it_flies_straight_there():
    mast = (7.0, 0.2, 0.4)
    flown = find(LEVEL, (4.0, 0.0, 10.0), mast)
    assert_keeps_off(flown, mast)
    assert np.allclose(flown.curve.value(flown.curve.duration_s), (15, 0, 10))
    assert flown.joins_s == flown.curve.duration_s
    assert flown.leg_at(flown.joins_s) == pytest.approx(LEVEL.duration_s)
    assert flown.on_leg(50.0) == 0.0  # until it joins, the time on the leg is that at which it was left


def test_viewpoints_that_are_passed_are_not_cut_off():
    passes_s = LEVEL.duration_s * 0.7
    flown = find(LEVEL, (1.0, 3.0, 10.0), left_s=0.5, last_s=passes_s)
    assert flown.joins_s < flown.curve.duration_s
    assert flown.leg_at(flown.joins_s) < passes_s
    joined = flown.curve.value(flown.joins_s)
    assert np.allclose(joined, LEVEL.value(flown.leg_at(flown.joins_s)), atol=1e-4)


def test_at_the_end_it_is_back():
    flown = find(LEVEL, (15.0, 0.0, 10.0))
    assert flown.joins_s == 0.0
    assert flown.leg_at(0.0) == pytest.approx(LEVEL.duration_s)


def test_a_mast_on_a_climbing_leg_is_passed_level_and_then_climbed_beside():
    mast = (8.0, 0.1, 0.3)
    place = np.array([5.0, 0.0, 12.0])
    climbed = []
    for _ in range(6):
        flown = find(CLIMBING, place, mast)
        assert_keeps_off(flown, mast)
        places = path_of(flown)
        if flown.joins_s < math.inf:
            break
        level = np.ptp(places[:, 2]) < 1e-6
        upright = np.ptp(places[:, :2]) < 1e-6 or np.ptp(places[:, :2], axis=0).max() < 1e-6
        assert level or upright
        climbed.append(not level)
        place = flown.curve.value(flown.curve.duration_s)
    assert climbed == [False, True]
    assert np.allclose(flown.curve.value(flown.curve.duration_s), (15, 0, 18), atol=1e-6)


def test_under_a_known_roof_it_does_not_climb():
    blocked = np.zeros((80, 80, 60), dtype=np.bool_)
    blocked[:, :, 28:32] = True  # from 14 to 16 m, but for a shaft of 3 m about (13, 6)
    blocked[63:69, 49:55, 28:32] = False
    roof = BinaryMap(blocked, np.array([-20.0, -20.0, 0.0]), 0.5)
    leg = leg_through((0, 0, 10), (13, 6, 18))  # through the roof it is certified: the map is coarse
    off = find(leg, (2.0, -5.0, 12.0), known=roof)
    end = off.curve.value(off.curve.duration_s)
    assert end[2] == pytest.approx(12.0)
    assert np.hypot(end[0] - 13.0, end[1] - 6.0) < 1.5  # below the shaft
    up = find(leg, end, known=roof)
    assert np.ptp(path_of(up)[:, :2], axis=0).max() < 1e-6
    assert up.curve.value(up.curve.duration_s)[2] > 16.0


def test_a_blocked_end_is_flown_nearer_to_and_no_further():
    parked = (15.0, 0.0, 0.8)
    place = np.array([3.0, 0.0, 10.0])
    flown = find(LEVEL, place, parked)
    assert flown.joins_s == math.inf
    assert_keeps_off(flown, parked)
    end = flown.curve.value(flown.curve.duration_s)
    assert 2.0 < 15.0 - end[0] < 3.0
    assert find(LEVEL, end, parked) is None


@pytest.mark.parametrize(
    ("parked", "place"),
    [
        ([(7.0, -0.8, 0.6), (10.6, 0.2, 1.2)], (5.77, 0.83, 10.0)),
        ([(7.0, 1.2, 1.2), (10.5, -1.4, 1.2)], (5.65, 3.43, 10.0)),
        ([(7.0, -0.1, 0.5), (9.9, -0.1, 1.2)], (5.70, -1.68, 10.0)),
    ],
)
def test_from_the_very_edge_of_what_blocks_it_first_comes_away(parked, place):
    """No curve could begin along what it stands so near to."""
    place = np.array(place)
    for _ in range(4):
        flown = find(LEVEL, place, *parked)
        assert flown is not None
        assert_keeps_off(flown, *parked)
        place = flown.curve.value(flown.curve.duration_s)
        if flown.joins_s < math.inf:
            break
    assert np.allclose(place, (15, 0, 10), atol=1e-6)


@pytest.mark.parametrize("seed", range(10))
def test_what_comes_is_kept_off(seed):
    rng = np.random.default_rng(seed)
    meet, turn = np.array([rng.uniform(3, 14), rng.uniform(-2, 2)]), rng.uniform(0, 2 * math.pi)
    velocity = rng.uniform(0.5, 3.0) * np.array([math.cos(turn), math.sin(turn)])
    comes = Track(1, 50.0, np.array([*(meet - 3.0 * velocity), *velocity]), 0.01 * np.eye(4), 0.1, 0.5, 9, 50.0)
    flown = find(LEVEL, (4.0, 0.0, 10.0), tracks=[comes])
    if flown is None:
        assert np.linalg.norm(meet - 3.0 * velocity - (4.0, 0.0)) < 12.0  # it is near enough to matter
        return
    times = np.linspace(0.0, 5.0, 500)
    away = flown.curve.value(np.minimum(times, flown.curve.duration_s))[:, :2] - comes.positions(50.0 + times)
    assert np.linalg.norm(away, axis=1).min() >= SAFE + 0.5 + 0.3


def test_walled_in_it_finds_none():
    ring = [(4 + 3 * math.cos(a), 3 * math.sin(a), 0.5) for a in np.linspace(0, 2 * math.pi, 40)]
    assert find(LEVEL, (4.0, 0.0, 10.0), *ring) is None
