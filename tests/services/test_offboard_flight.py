"""Setpoints of an offboard flight: position, velocity and acceleration belong together, also at gates and in pauses."""

from __future__ import annotations

import itertools
import math
from types import SimpleNamespace

import numpy as np
import pytest

from gcs.core.errors import RefusedError
from gcs.core.trajectory import AngleProfile, PiecewisePolynomial
from gcs.planning.dynamics.feed_forward import NO_FEED_FORWARD, FeedForward
from gcs.planning.trajectories.retiming import TimeWarp
from gcs.services.home_column import column_times
from gcs.services.offboard_flight import OffboardFlight

STEP_S = 0.005


def smooth_leg(start, end):
    """Coefficients of a rest-to-rest leg, 35 u^4 - 84 u^5 + 70 u^6 - 20 u^7."""
    leg = np.zeros((8, 3))
    leg[0] = start
    leg[4:] = np.array([35.0, -84.0, 70.0, -20.0])[:, None] * (np.asarray(end) - start)
    return leg


@pytest.fixture
def plan():
    """Up 5 m, along to a viewpoint, back over home, down; 10 s each."""
    places = [np.array(p, float) for p in ((0, 0, 0), (0, 0, 5), (12, 6, 9), (0, 0, 5), (0, 0, 0))]
    legs = np.array([smooth_leg(a, b) for a, b in itertools.pairwise(places)])
    return SimpleNamespace(
        trajectory=PiecewisePolynomial(legs, np.full(4, 10.0)),
        yaw=AngleProfile(np.array([0.0, 40.0]), np.array([0.0, 3.0])),
        scenario=SimpleNamespace(home_m=(0.0, 0.0, 0.0)),
    )


@pytest.fixture
def make_flight(plan):
    times = np.linspace(0.0, 40.0, 41)
    warp = TimeWarp(times, 1.0 - 0.4 * np.exp(-(((times - 15.0) / 4.0) ** 2)))  # slowed about the middle of a leg
    vehicle = SimpleNamespace(takes_acceleration_forward=True)
    return lambda: OffboardFlight(plan, warp, vehicle, SimpleNamespace(), SimpleNamespace())


@pytest.fixture
def flight(make_flight):
    return make_flight()


def test_it_takes_over_at_the_top_of_the_column_and_hands_over_above_home_again(plan, flight):
    leave, enter = column_times(plan)
    assert 10.0 < leave < 12.0
    assert 28.0 < enter < 30.0
    for t in (leave, enter):
        assert 0.1 < np.hypot(*plan.trajectory.value(t)[:2]) < 0.21
        assert plan.trajectory.value(t)[2] > 4.5, "well above the ground"
    assert flight.plan_time_s == pytest.approx(leave, abs=1e-6)


def test_velocity_and_acceleration_are_the_derivatives_of_position_all_the_way(flight):
    flight.resume()
    times = np.arange(0.0, 20.0, STEP_S)
    setpoints = []
    for t in times:
        if t == pytest.approx(6.0):
            flight.pause()
        if t == pytest.approx(10.0):
            flight.resume()
        setpoints.append(flight.setpoint(100.0 + t))
    position = np.array([s.position_m for s in setpoints])
    velocity = np.array([s.velocity_m_s for s in setpoints])
    acceleration = np.array([s.acceleration_m_s2 for s in setpoints])
    assert np.abs(np.gradient(position, STEP_S, axis=0) - velocity)[2:-2].max() < 0.02
    changes = np.abs(np.gradient(velocity, STEP_S, axis=0) - acceleration)[2:-2].max(axis=1)
    assert np.sort(changes)[-20] < 0.1, "but for the few samples at which the clock begins or ends to change its rate"
    held = (times > 9.0) & (times < 9.9)
    assert np.abs(velocity[held]).max() == 0.0
    assert np.ptp(position[held], axis=0).max() == 0.0
    assert np.linalg.norm(velocity, axis=1).max() > 1.0


def test_it_waits_at_a_gate_at_rest(flight):
    flight.resume()
    flight._clock.gate_s = gate = flight._warp.time_of(20.0)
    for t in np.arange(0.0, gate + 8.0, 0.02):
        setpoint = flight.setpoint(t)
    assert setpoint.position_m == pytest.approx([12.0, 6.0, 9.0], abs=1e-6)
    assert np.abs(setpoint.velocity_m_s).max() < 1e-6
    assert np.abs(setpoint.acceleration_m_s2).max() < 1e-6
    assert flight.plan_time_s == pytest.approx(20.0, abs=1e-6)


def test_setpoints_are_given_about_the_estimators_origin(flight):
    turn = math.radians(1.0)
    flight._rotation = np.array([[math.cos(turn), -math.sin(turn), 0], [math.sin(turn), math.cos(turn), 0], [0, 0, 1]])
    flight._shift = np.array([20.0, 20.0, -1.0])
    here = flight.setpoint(0.0)
    assert here.position_m == pytest.approx([20.0, 20.0, 4.0], abs=0.25)


class Learned:
    """A learner that knows everything from the start."""

    def __init__(self, feed_forward):
        self._feed_forward = feed_forward
        self.sent_setpoints = []

    def at(self, vehicle_s):
        return self._feed_forward

    def sent(self, vehicle_s, position_m, velocity_m_s):
        self.sent_setpoints.append((vehicle_s, position_m, velocity_m_s))


def setpoints(flight, feed_forward, gate=None):
    """All setpoints of the first half of the plan, at the rate of the stream."""
    flight._feed_forward = learner = Learned(feed_forward)
    flight.resume()
    if gate is not None:
        flight._clock.gate_s = flight._warp.time_of(gate)
    flown = [flight.setpoint(t) for t in np.arange(0.0, 14.0, 0.02)]
    assert [s[1] is f.position_m for s, f in zip(learner.sent_setpoints, flown, strict=True)] == [True] * len(flown)
    return flown


def test_what_was_learned_changes_neither_the_path_nor_the_speed_of_the_setpoints(make_flight):
    plain = setpoints(make_flight(), NO_FEED_FORWARD, gate=20.0)
    fed = setpoints(make_flight(), FeedForward(1.2, 0.4, 0.25), gate=20.0)
    for one, other in zip(plain, fed, strict=True):
        assert np.array_equal(one.position_m, other.position_m)
        assert np.array_equal(one.velocity_m_s, other.velocity_m_s)
    last = fed[-1]
    assert last.position_m == pytest.approx([12.0, 6.0, 9.0], abs=1e-6)
    assert np.abs(last.acceleration_m_s2).max() < 1e-6, "no acceleration is asked for beyond the gate"


def test_drag_is_fed_forward_along_the_horizontal_velocity(make_flight):
    plain = setpoints(make_flight(), NO_FEED_FORWARD)
    fed = setpoints(make_flight(), FeedForward(drag_s=0.8))
    for one, other in zip(plain, fed, strict=True):
        extra = other.acceleration_m_s2 - one.acceleration_m_s2
        assert extra == pytest.approx(0.8 * one.velocity_m_s * [1.0, 1.0, 0.0], abs=1e-12)


def test_the_acceleration_comes_earlier_by_the_lag_of_the_tilt(make_flight):
    plain = np.array([s.acceleration_m_s2 for s in setpoints(make_flight(), NO_FEED_FORWARD)])
    fed = np.array([s.acceleration_m_s2 for s in setpoints(make_flight(), FeedForward(tilt_lead_s=0.2))])
    whole = slice(200, 600)  # the clock runs at its full rate
    assert fed[whole] == pytest.approx(plain[210:610], abs=0.002)
    assert np.abs(plain[whole] - plain[210:610]).max() > 0.03


def test_the_yaw_follows_the_vehicle_and_not_the_lead_of_the_stream(make_flight):
    plain = np.array([s.yaw_rad for s in setpoints(make_flight(), NO_FEED_FORWARD)])
    flight = make_flight()
    fed = np.array([s.yaw_rad for s in setpoints(flight, FeedForward(lead_s=0.3))])
    assert fed[300:] == pytest.approx(plain[285:-15], abs=1e-3)
    assert flight._warp.plan_time(flight._clock.time_s) - flight.plan_time_s == pytest.approx(0.3, rel=0.5)


class AheadSession:
    """Asks for setpoints up to 0.3 s ahead of the vehicle's time, and for all of them again when it is told to."""

    active = True

    def __init__(self):
        self.now = 0.0
        self.queue = {}
        self.flown = []

    def vehicle_now(self):
        return self.now

    def fly(self, source):
        self.source = source
        self.queue.clear()

    def run(self, until):
        while self.now < until:
            for k in range(1, 16):
                due = round(self.now + 0.02 * k, 2)
                if due not in self.queue:
                    self.queue[due] = self.source(due)
            self.now = round(self.now + 0.02, 2)
            self.flown.append(self.queue.pop(self.now))


def test_setpoints_made_ahead_change_neither_what_is_flown_nor_where_it_is_told_to_be(make_flight):
    flights = make_flight(), make_flight()
    ahead = flights[0]._session = AheadSession()
    ahead.fly(flights[0].setpoint)
    told, just_in_time = [], []
    for t in np.arange(0.02, 16.0, 0.02):
        if t == pytest.approx(0.1):
            for flight in flights:
                flight.resume()
                flight._open_to(flight._warp.time_of(20.0))
        if t == pytest.approx(6.0):
            [flight.pause() for flight in flights]
        if t == pytest.approx(9.0):
            [flight.resume() for flight in flights]
        if t == pytest.approx(15.0):
            [flight._open_to(math.inf) for flight in flights]
        ahead.run(round(t, 2))
        just_in_time.append(flights[1].setpoint(round(t, 2)))
        told.append(flights[0].plan_time_s - flights[1].plan_time_s)
    for one, other in zip(ahead.flown, just_in_time, strict=True):
        assert one.position_m == pytest.approx(other.position_m, abs=1e-9)
        assert one.velocity_m_s == pytest.approx(other.velocity_m_s, abs=1e-9)
        assert one.acceleration_m_s2 == pytest.approx(other.acceleration_m_s2, abs=1e-9)
    assert np.abs(told).max() < 1e-9
    sent = [s[0] for s in flights[0]._feed_forward._sent]
    assert sent == sorted(set(sent)), "what was made anew is remembered once"


def test_the_clock_halts_at_stops_only(plan, flight):
    plan.viewpoints = [
        SimpleNamespace(time_s=t, stops=stops) for t, stops in ((14.0, False), (20.0, True), (23.0, False))
    ]
    gates = [flight._next_gate_s(v) for v in plan.viewpoints]
    assert gates == [flight._warp.time_of(20.0)] * 2 + [math.inf]
    flight._clock.gate_s = gates[0]
    flight.resume()
    speeds = [np.linalg.norm(flight.setpoint(t).velocity_m_s) for t in np.arange(0.0, gates[0] + 2.0, 0.02)]
    passed = round((flight._warp.time_of(14.0) - flight._warp.time_of(column_times(plan)[0])) / 0.02)
    assert min(speeds[passed - 20 : passed + 20]) > 0.5, "it flies on where it does not stop"
    assert speeds[-1] < 1e-6


@pytest.mark.parametrize(("off_m", "refused"), [(2.5, False), (3.5, True)])
def test_a_vehicle_that_does_not_follow_is_noticed_in_passing(plan, flight, off_m, refused):
    view = SimpleNamespace(name="V1", position_m=np.array([6.0, 3.0, 7.0]))
    flight._vehicle.identity = SimpleNamespace(name="px4-1")
    place = SimpleNamespace(value=view.position_m + np.array([0.0, off_m, 0.0]))
    flight._vehicle.telemetry = SimpleNamespace(local_position_m=place)
    if refused:
        with pytest.raises(RefusedError, match="does not follow the stream: at V1 it is 4 m from"):
            flight._require_near(view, 3.0)
    else:
        flight._require_near(view, 3.0)
