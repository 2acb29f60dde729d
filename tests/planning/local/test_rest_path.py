"""Curves from rest to rest: free, within the limits and as quick as these allow, at heights that are scanned."""

import numpy as np
import pytest

from gcs.planning.local.binary_map import BinaryMap
from gcs.planning.local.detour import DetourOptions
from gcs.planning.local.rest_path import climb_to, rest_path
from gcs.planning.local.search_budget import SearchBudget
from gcs.planning.trajectories.flight_limits import FlightLimits

LIMITS = FlightLimits(4.0, 2.5, 10.0)
R = 1.2


def area_of(*circles, cell=0.2):
    middles = np.arange(200) * cell - 10 + cell / 2
    x, y = np.meshgrid(middles, middles, indexing="ij")
    blocked = np.zeros((200, 200), dtype=np.bool_)
    for cx, cy, radius in circles:
        blocked |= np.hypot(x - cx, y - cy) < radius
    return BinaryMap(blocked, np.array([-10.0, -10.0]), cell).grown(R)


def extremes(curve):
    times = np.linspace(0.0, curve.duration_s, 20_000)
    return [float(np.linalg.norm(curve.value(times, order), axis=1).max()) for order in (1, 2, 3)]


def assert_rests(curve, start, end):
    for time, place in ((0.0, start), (curve.duration_s, end)):
        assert np.allclose(curve.value(time), place, atol=1e-9)
        for order in (1, 2, 3):
            assert np.abs(curve.value(time, order)).max() < 1e-6


@pytest.mark.parametrize("seed", range(10))
def test_a_path_is_free_and_uses_its_limits(seed):
    rng = np.random.default_rng(seed)
    start, end = np.array([-7.0, rng.uniform(-3, 3), 10.0]), np.array([20.0, rng.uniform(-3, 3), 10.3])
    circles = [(x, rng.uniform(-3, 3), rng.uniform(0.2, 1.0)) for x in (0.0, 7.0, 14.0)]
    slab = (9.5, 10.5)
    curve = rest_path(start, end, area_of(*circles), LIMITS, DetourOptions(slab_m=slab), SearchBudget())
    assert_rests(curve, start, end)
    places = curve.value(np.linspace(0.0, curve.duration_s, 20_000))
    for x, y, radius in circles:
        assert np.hypot(places[:, 0] - x, places[:, 1] - y).min() >= radius + R - 0.15
    assert ((places[:, 2] >= slab[0]) & (places[:, 2] <= slab[1])).all()
    shares = np.array(extremes(curve)) / (4.0, 2.5, 10.0)
    assert (shares <= 1).all()
    # Times are stretched by one factor: one of the limits is nearly reached.
    assert max(shares ** (1 / np.arange(1, 4))) > 0.85


def test_where_there_is_no_way_it_says_none():
    walled = area_of(*[(3.0, y, 0.5) for y in np.arange(-10.0, 30.0, 0.5)])
    start, options = np.array([-5.0, 0.0, 10.0]), DetourOptions(slab_m=(9.5, 10.5))
    assert rest_path(start, np.array([15.0, 0.0, 10.0]), walled, LIMITS, options, SearchBudget()) is None
    assert rest_path(start, np.array([15.0, 0.0, 12.0]), area_of(), LIMITS, options, SearchBudget()) is None


def test_where_the_budget_is_spent_it_says_none():
    start, end, options = np.array([-5.0, 0.0, 10.0]), np.array([15.0, 0.0, 10.0]), DetourOptions()
    assert rest_path(start, end, area_of(), LIMITS, options, SearchBudget(curves=1)) is not None
    assert rest_path(start, end, area_of(), LIMITS, options, SearchBudget(curves=0)) is None
    assert rest_path(start, end, area_of(), LIMITS, options, SearchBudget(work=10)) is None


def test_a_climb_is_straight_and_slow_enough_to_stop_where_it_sees():
    start = np.array([2.0, 3.0, 10.0])
    for height in (10.2, 16.0, 4.0):
        curve = climb_to(start, height, LIMITS)
        assert_rests(curve, start, [2.0, 3.0, height])
        assert np.ptp(curve.value(np.linspace(0.0, curve.duration_s, 100))[:, :2], axis=0).max() < 1e-9
        speed, acceleration, jerk = extremes(curve)
        reacts_s = 0.2
        assert speed * reacts_s + speed**2 / (2 * 2.5) < 0.5
        assert acceleration <= 2.5
        assert jerk <= 10.0
