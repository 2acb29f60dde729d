"""Tours with pictures in flight, against tours that stop; angles by finite differences."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from gcs.core.progress import SilentProgress
from gcs.planning.trajectories import fly_through
from gcs.planning.trajectories.time_allocation import time_legs
from gcs.planning.trajectories.trajectory_builder import build_trajectory
from gcs.planning.views.viewing_angles import HOLD_S, SETTLE_S, STEADY_S, YAW_RATE_RAD_S

HOME = np.array([-20.0, -20.0, 0.0])


def tour(places):
    """Legs from home over the places and back."""
    above = HOME + np.array([0.0, 0.0, 8.0])
    legs = [np.array(pair) for pair in itertools.pairwise(places)]
    return [np.array([HOME, above, places[0]]), *legs, np.array([places[-1], above, HOME])]


def rows(count=3):
    """Places on rows to and fro, 4 m apart, seen from one side."""
    xs = np.arange(-8.0, 9.0, 4.0)
    return np.array([(x, -9.0, 8 + 3.0 * r) for r in range(count) for x in xs[:: 1 if r % 2 == 0 else -1]])


def built(scenario, places, speed, yaw=None, pitch=None, holds=None, interval=0.5):
    count = len(places)
    camera = scenario.camera.model_copy(update={"min_interval_s": interval})
    return build_trajectory(
        tour(places),
        np.full(count, 1.5) if yaw is None else np.asarray(yaw, float),
        np.zeros(count) if pitch is None else np.asarray(pitch, float),
        scenario.model_copy(update={"camera": camera}),
        SilentProgress(),
        passing_speeds_m_s=np.broadcast_to(np.asarray(speed, float), count),
        holds_s=holds,
    )


def test_flying_through_is_much_quicker_and_passes_every_place(tower_scenario):
    places = rows()
    stopping, passing = built(tower_scenario, places, 0.0), built(tower_scenario, places, 1.5)
    assert stopping.stops.all()
    assert not passing.stops.any()
    assert passing.trajectory.duration_s < 0.6 * stopping.trajectory.duration_s
    np.testing.assert_allclose(passing.trajectory.value(passing.exposures_s), places, atol=2e-4)
    speeds = np.linalg.norm(passing.trajectory.value(passing.exposures_s, 1), axis=1)
    assert 0.3 < speeds.min() <= speeds.max() <= 1.5
    assert len(passing.corridor_m) == len(passing.trajectory.durations_s)
    for order in range(4):
        ends = passing.trajectory.starts_s[1:-1]
        before, after = passing.trajectory.value(ends - 1e-9, order), passing.trajectory.value(ends + 1e-9, order)
        np.testing.assert_allclose(before, after, atol=1e-4)


def test_exposures_keep_the_cameras_interval(tower_scenario):
    places = rows(1)
    quick, slow = built(tower_scenario, places, 3.0, interval=0.1), built(tower_scenario, places, 3.0, interval=3.5)
    assert np.diff(quick.exposures_s).min() < 2.5
    assert not slow.stops.any()
    assert 3.5 <= np.diff(slow.exposures_s).min() < 3.7


def test_angles_are_reached_in_motion_within_their_rates(tower_scenario):
    places = rows()
    rng = np.random.default_rng(5)
    yaw, pitch = 1.5 + rng.uniform(-0.6, 0.6, len(places)), rng.uniform(-0.7, 0.2, len(places))
    flight = built(tower_scenario, places, 2.0, yaw, pitch)
    assert flight.stops.mean() < 0.5
    step = 1e-3
    t = np.arange(0.0, flight.trajectory.duration_s, step)
    gimbal_rate = np.radians(tower_scenario.camera.gimbal.rate_deg_s)
    assert np.abs(np.diff(flight.yaw.value(t))).max() <= YAW_RATE_RAD_S * step * (1 + 1e-6)
    assert np.abs(np.diff(flight.gimbal_pitch.value(t))).max() <= gimbal_rate * step * (1 + 1e-6)
    for k, exposure in enumerate(flight.exposures_s):
        around = exposure + np.linspace(-STEADY_S, HOLD_S, 15)
        np.testing.assert_allclose(flight.yaw.value(around), yaw[k], atol=1e-6)
        np.testing.assert_allclose(flight.gimbal_pitch.value(around), pitch[k], atol=1e-6)


@pytest.mark.parametrize("seed", range(4))
def test_it_never_takes_longer_than_stopping_everywhere(tower_scenario, seed):
    rng = np.random.default_rng(seed)
    places = np.array([0.0, -15.0, 14.0]) + rng.uniform(-1, 1, size=(9, 3)) * [9.0, 4.0, 4.0]
    yaw = rng.uniform(-3, 3, 9)
    speed = np.where(rng.random(9) < 0.2, 0.0, rng.uniform(0.1, 2.0, 9))
    passing, stopping = built(tower_scenario, places, speed, yaw), built(tower_scenario, places, 0.0, yaw)
    assert passing.trajectory.duration_s <= stopping.trajectory.duration_s + 1e-6
    assert passing.stops[speed == 0].all()
    speeds = np.linalg.norm(passing.trajectory.value(passing.exposures_s, 1), axis=1)
    assert (speeds <= speed + 1e-9).all()


def test_it_stops_where_turning_takes_as_long_anyway(tower_scenario):
    """On 1 m it turns by half a circle: slowing down for that saves nothing."""
    places = np.array([[-8.0, -9, 10], [0, -9, 10], [1, -9, 10], [9, -9, 10]])
    flight = built(tower_scenario, places, 3.0, [0.0, 0.0, 3.0, 3.0])
    ahead = built(tower_scenario, places, 0.0, [0.0, 0.0, 3.0, 3.0])
    assert flight.trajectory.duration_s < ahead.trajectory.duration_s
    turn = 1.5 * 3.0 / YAW_RATE_RAD_S
    between = flight.exposures_s[2] - flight.exposures_s[1]
    assert turn <= between < turn + SETTLE_S + HOLD_S + STEADY_S + 0.5


@pytest.mark.parametrize("bad", [0, 5, 13, 14])
def test_where_no_good_curve_goes_through_a_place_it_stops_there_and_flies_through_most_others(
    tower_scenario, monkeypatch, bad
):
    """A place that only straight moves get through, as when no solver settles, spoils its whole way at first."""
    places = rows()

    def spoiled(chains, *rest):
        legs = time_legs(chains, *rest)
        through = [
            chain.passing and (chain.joints_m[chain.passing.joints] == places[bad]).all(1).any() for chain in chains
        ]
        return [
            replace(leg, durations_s=9 * leg.durations_s) if no else leg for leg, no in zip(legs, through, strict=True)
        ]

    monkeypatch.setattr(fly_through, "time_legs", spoiled)
    flight = built(tower_scenario, places, 1.5)
    assert flight.stops[bad]
    assert flight.stops.sum() <= 5
    np.testing.assert_allclose(flight.trajectory.value(flight.exposures_s), places, atol=2e-4)


def test_it_stands_as_long_as_asked_and_flies_through_the_others(tower_scenario):
    places, holds = rows(1), np.array([0.0, 0.0, 6.0, 0.0, 0.0])
    flight = built(tower_scenario, places, np.where(holds > 0, 0.0, 1.5), holds=holds)
    assert flight.stops.tolist() == [False, False, True, False, False]
    still = flight.exposures_s[2] + np.linspace(-SETTLE_S, 6.0 - SETTLE_S - 1e-6, 20)
    np.testing.assert_allclose(flight.trajectory.value(still), np.broadcast_to(places[2], (20, 3)), atol=1e-9)
    everywhere = built(tower_scenario, places, 0.0, holds=holds)
    without = built(tower_scenario, places, 0.0)
    assert everywhere.trajectory.duration_s == pytest.approx(without.trajectory.duration_s + 6.0 - SETTLE_S - HOLD_S)


def test_pictures_in_two_directions_from_one_place_are_taken_at_rest(tower_scenario):
    places = np.repeat(rows(1), [1, 1, 2, 1, 1], axis=0)
    flight = built(tower_scenario, places, 1.5, [1.5, 1.5, 1.5, 0.5, 1.5, 1.5])
    assert flight.stops[2:4].all()
    assert not flight.stops[[0, 1, 4, 5]].any()
    np.testing.assert_allclose(flight.trajectory.value(flight.exposures_s), places, atol=2e-4)
