"""Starts and waits that keep vehicles apart, proved by their curves."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest

from gcs.core.errors import InfeasibleError
from gcs.core.progress import SilentProgress
from gcs.core.trajectory import AngleProfile, PiecewisePolynomial
from gcs.planning.flights.fleet_schedule import schedule_fleet, with_waits
from gcs.planning.flights.separation import least_separation
from gcs.planning.trajectories.trajectory_builder import BuiltTrajectory

REST_TO_REST = np.array([0, 0, 0, 0, 35, -84, 70, -20], dtype=float)
LEG_S, REST_S = 5.0, 2.0


def flight(*stops):
    """Rest-to-rest legs between stops of 5 s each, 2 s of rest at all but the first and the last."""
    stops = np.array(stops, dtype=float)
    coefficients, durations, exposures = [], [], []
    for k, (a, b) in enumerate(itertools.pairwise(stops)):
        leg = REST_TO_REST[:, None] * (b - a)
        leg[0] += a
        coefficients.append(leg)
        durations.append(LEG_S)
        if k < len(stops) - 2:
            rest = np.zeros((8, 3))
            rest[0] = b
            coefficients.append(rest)
            durations.append(REST_S)
            exposures.append(sum(durations) - 0.5)
    total = sum(durations)
    knots = np.array([0.0, *(t + 0.5 for t in exposures), total])
    angles = AngleProfile(knots, np.linspace(0, 1, len(knots)))
    trajectory = PiecewisePolynomial(np.array(coefficients), np.array(durations))
    stops = np.ones(len(exposures), dtype=bool)
    return BuiltTrajectory(trajectory, np.zeros((len(durations), 2, 3)), angles, angles, np.array(exposures), stops)


ALONG_X = flight([-20, 0, 0], [-10, 0, 5], [10, 0, 5], [20, 0, 0])
ALONG_Y = flight([0, -20, 0], [0, -10, 5], [0, 10, 5], [0, 20, 0])


def names(count):
    return [f"vehicle {k + 1}" for k in range(count)]


def test_flights_that_are_apart_are_left_alone():
    far = flight([-20, 50, 0], [-10, 50, 5], [20, 50, 0])
    schedule = schedule_fleet([ALONG_X, far], 5.0, names(2), SilentProgress())
    assert [s.start_s for s in schedule] == [0.0, 0.0]
    for before, after in zip((ALONG_X, far), schedule, strict=True):
        np.testing.assert_array_equal(after.built.trajectory.durations_s, before.trajectory.durations_s)


def test_one_of_two_that_cross_waits():
    both = [ALONG_X, ALONG_Y]
    assert least_separation([s.curve for s in _unscheduled(both)], SilentProgress()).distance_m < 0.1
    schedule = schedule_fleet(both, 5.0, names(2), SilentProgress())
    assert least_separation([s.curve for s in schedule], SilentProgress()).distance_m >= 5.0
    ends = [s.curve.end_s for s in schedule]
    assert min(ends) == pytest.approx(ALONG_X.trajectory.duration_s)
    assert max(ends) < 2 * ALONG_X.trajectory.duration_s


def test_three_over_one_crossing():
    third = flight([-15, -15, 0], [-8, -8, 5], [8, 8, 5], [15, 15, 0])
    schedule = schedule_fleet([ALONG_X, ALONG_Y, third], 4.0, names(3), SilentProgress())
    assert least_separation([s.curve for s in schedule], SilentProgress()).distance_m >= 4.0


def test_pads_too_near_to_each_other():
    beside = flight([-20, 2, 0], [-10, 30, 5], [-20, 2, 0])
    with pytest.raises(InfeasibleError, match=r"separation_m.*pads further apart"):
        schedule_fleet([ALONG_X, beside], 5.0, names(2), SilentProgress())


def test_waits_move_what_comes_after_them():
    waits = np.array([3.0, 0.5])
    waited = with_waits(ALONG_X, waits)
    assert waited.trajectory.duration_s == pytest.approx(ALONG_X.trajectory.duration_s + 3.5)
    np.testing.assert_allclose(waited.exposures_s, ALONG_X.exposures_s + np.array([0.0, 3.0]))
    for built, t in ((ALONG_X, ALONG_X.exposures_s), (waited, waited.exposures_s)):
        np.testing.assert_allclose(built.trajectory.value(t), [[-10, 0, 5], [10, 0, 5]], atol=1e-9)
    np.testing.assert_allclose(waited.yaw.value(waited.exposures_s), ALONG_X.yaw.value(ALONG_X.exposures_s), atol=0.2)
    np.testing.assert_allclose(np.diff(waited.yaw.times_s), [10.0, 7.5, 5.0], atol=1e-9)
    assert math.isclose(waited.yaw.times_s[-1], waited.trajectory.duration_s)


def test_a_vehicle_waits_only_where_it_stops():
    passing = replace(ALONG_X, exposures_s=np.array([6.0, 9.5, 13.0]), stops=np.array([True, False, True]))
    waited = with_waits(passing, np.array([3.0, 0.5]))
    np.testing.assert_allclose(waited.exposures_s, [6.0, 12.5, 16.0])
    before, after = (b.trajectory.value(b.exposures_s) for b in (passing, waited))
    np.testing.assert_allclose(after, before, atol=1e-9)
    schedule = schedule_fleet([passing, ALONG_Y], 5.0, names(2), SilentProgress())
    assert least_separation([s.curve for s in schedule], SilentProgress()).distance_m >= 5.0


def _unscheduled(flights):
    from gcs.planning.flights.fleet_schedule import ScheduledFlight

    return [ScheduledFlight(f, 0.0) for f in flights]
