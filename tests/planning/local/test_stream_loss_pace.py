"""Slowing down for the loss of the stream, against a vehicle that flies on and brakes, step by step."""

from __future__ import annotations

import numpy as np
import pytest

from gcs.core.trajectory import PiecewisePolynomial
from gcs.planning.local.binary_map import BinaryMap
from gcs.planning.local.curve_parts import part_of_curve
from gcs.planning.local.flown_leg import FlownLeg, slowed
from gcs.planning.local.stream_loss_pace import SLOWEST_M_S, slowed_for_stream_loss
from gcs.planning.trajectories.flight_limits import FlightLimits
from gcs.planning.trajectories.stream_loss import StreamLoss
from gcs.planning.trajectories.unconstrained_minimum_snap import minimum_snap_spline

LENGTH_M, DURATION_S, CELL_M = 40.0, 20.0, 0.2
LIMITS = FlightLimits(5.0, 2.5)
WALL_M = 30.0
ORIGIN_M = np.array([-5.0, -30.0])


@pytest.fixture
def leg():
    """Forty metres along x, from rest to rest."""
    coefficients = np.zeros((1, 8, 3))
    coefficients[0, 4:, 0] = LENGTH_M * np.array([35.0, -84.0, 70.0, -20.0])
    return PiecewisePolynomial(coefficients, np.array([DURATION_S]))


def seen(*boxes):
    """A map of boxes ((x0, x1), (y0, y1))."""
    blocked = np.zeros((300, 300), dtype=np.bool_)
    for box in boxes:
        (x0, x1), (y0, y1) = np.rint((np.array(box) - ORIGIN_M[:, None]) / CELL_M).astype(int)
        blocked[x0:x1, y0:y1] = True
    return BinaryMap(blocked, ORIGIN_M, CELL_M)


def stops_at(place_m, velocity_m_s, loss):
    """Where a vehicle comes to rest that flies on, and then brakes, in small steps of time."""
    place, velocity, dt = np.array(place_m), np.array(velocity_m_s), 1e-3
    for step in range(100_000):
        speed = np.linalg.norm(velocity)
        if step * dt >= loss.timeout_s:
            velocity = velocity * max(0.0, 1.0 - loss.deceleration_m_s2 * dt / max(speed, 1e-9))
        if speed < 1e-3:
            break
        place = place + velocity * dt
    return place


@pytest.mark.parametrize("timeout_s", [1.0, 3.0])
def test_its_own_stop_stays_before_a_wall_wherever_the_stream_ends(leg, timeout_s):
    loss = StreamLoss(timeout_s, 2.0)
    rest = part_of_curve(leg, 6.0, DURATION_S)
    wall = seen(((WALL_M, WALL_M + 2.0), (-4.0, 4.0)))
    slow = slowed_for_stream_loss(rest, wall, loss, LIMITS)
    times = np.linspace(0.0, slow.time_of(np.array(5.5)), 300)
    places, velocities = slow.curve.value(times), slow.curve.value(times, 1)
    speeds = np.linalg.norm(velocities, axis=1)
    minded = (speeds > 1.02 * SLOWEST_M_S) & (places[:, 0] < WALL_M)
    assert minded.sum() > 50
    for place, velocity in zip(places[minded][::7], velocities[minded][::7], strict=True):
        assert stops_at(place, velocity, loss)[0] <= WALL_M + 0.01


def test_the_same_way_smooth_and_within_the_limits(leg):
    rest = part_of_curve(leg, 8.0, DURATION_S)
    slow = slowed_for_stream_loss(rest, seen(((WALL_M, WALL_M + 2.0), (-4.0, 4.0))), StreamLoss(3.0, 2.0), LIMITS)
    for order in range(3):
        assert slow.curve.value(0.0, order) == pytest.approx(rest.value(0.0, order), abs=1e-9), "goes on as it flies"
    ends = np.cumsum(slow.curve.durations_s)[:-1]
    for order in range(3):
        assert slow.curve.value(ends - 1e-7, order) == pytest.approx(slow.curve.value(ends + 1e-7, order), abs=1e-4)
    times = np.linspace(0.0, slow.curve.duration_s, 5000)
    assert np.linalg.norm(slow.curve.value(times, 2), axis=1).max() <= LIMITS.acceleration_m_s2
    places = slow.curve.value(times)
    assert (np.diff(places[:, 0]) >= -1e-9).all()
    assert np.abs(places[:, 1:]).max() < 1e-9
    assert places[-1] == pytest.approx([LENGTH_M, 0.0, 0.0], abs=1e-6)
    before = np.linspace(0.0, rest.duration_s, 50)
    assert slow.curve.value(slow.time_of(before)) == pytest.approx(rest.value(before), abs=0.02)


def test_what_is_not_in_the_way_of_its_stop_costs_nothing(leg):
    loss = StreamLoss(3.0, 2.0)
    beside = seen(((10.0, 30.0), (1.0, 3.0)), ((10.0, 30.0), (-3.0, -1.0)))
    assert slowed_for_stream_loss(leg, beside, loss, LIMITS) is None
    assert slowed_for_stream_loss(leg, seen(((60.0, 62.0), (-4.0, 4.0))), loss, LIMITS) is None, "off the map"
    hovering = PiecewisePolynomial(np.zeros((1, 8, 3)), np.array([5.0]))
    assert slowed_for_stream_loss(hovering, seen(((-1.0, 1.0), (-1.0, 1.0))), loss, LIMITS) is None


def test_behind_the_obstacle_the_pace_is_its_own_again():
    """A bend before a wall: slow towards it, quick along it."""
    points = np.array([[0.0, 0.0, 0.0], [14.0, 0.0, 0.0], [22.0, 6.0, 0.0], [22.0, 20.0, 0.0], [22.0, 34.0, 0.0]])
    still = [np.zeros(3)] * 3
    bend = minimum_snap_spline(points, np.array([7.0, 5.0, 6.0, 8.0]), still, still).piecewise_polynomial()
    bend = part_of_curve(bend, 4.0, bend.duration_s)
    slow = slowed_for_stream_loss(bend, seen(((26.0, 28.0), (-4.0, 9.0))), StreamLoss(3.0, 2.0), LIMITS)
    ahead, behind = np.array([2.0, 4.0, 5.0]), np.array([13.0, 16.0, 19.0])
    assert (speed(slow.curve, slow.time_of(ahead)) < 0.97 * speed(bend, ahead)).any()
    assert speed(slow.curve, slow.time_of(behind)) == pytest.approx(speed(bend, behind), rel=0.02)


def speed(curve, times):
    return np.linalg.norm(curve.value(times, 1), axis=1)


def test_times_on_the_leg_stay_with_their_places(leg):
    knots = np.array([0.0, DURATION_S])
    flown = FlownLeg(leg, 100.0, knots, knots, 12.0)
    slow = slowed_for_stream_loss(
        part_of_curve(leg, 8.0, DURATION_S),
        seen(((WALL_M, WALL_M + 2.0), (-4.0, 4.0))),
        StreamLoss(1.0, 2.0),
        LIMITS,
    )
    later = slowed(flown, slow, 8.0, 108.0)
    assert later.on_leg(108.0) == pytest.approx(8.0)
    for clock_s in np.linspace(108.0, 108.0 + slow.curve.duration_s, 30):
        place = later.curve.value(later.at(clock_s))
        assert leg.value(later.on_leg(clock_s)) == pytest.approx(place, abs=0.03)
    assert leg.value(12.0) == pytest.approx(later.curve.value(later.joins_s), abs=0.03)
    away = slowed(FlownLeg(leg, 100.0, np.zeros(1), np.full(1, 3.0), np.inf), slow, 8.0, 108.0)
    assert (away.joins_s, away.on_leg(115.0)) == (np.inf, 3.0)
