"""The simulated body: governor, limits, landing, detour bump, battery."""

import numpy as np
import pytest

from sitl_mocks.airframe import Airframe, Battery, FlightLimits, FlightSetpoint
from sitl_mocks.flight_control import FlightControl
from sitl_mocks.flight_tasks import DescentProfile, Land, ReturnHome

LIMITS = FlightLimits(5.0, 4.0, 3.0, 3.0, 2.5, 10.0)


def flying(limits=LIMITS, height=10.0):
    airframe = Airframe([0.0, 0.0, 0.0], limits)
    airframe.go_to([0.0, 0.0, height])
    airframe.step(250 * round(8 + height / 3))
    return airframe


def fly(airframe, seconds, sample=lambda a: a.position_m):
    rows = []
    for _ in range(round(seconds / 0.02)):
        airframe.step(5)
        rows.append(sample(airframe))
    return np.array(rows)


def test_stands_still_with_the_motors_off():
    airframe = Airframe([3.0, 4.0, 5.0], LIMITS)
    airframe.step(1000)
    assert airframe.position_m == pytest.approx([3.0, 4.0, 5.0], abs=0.003)
    assert airframe.on_ground


def test_falls_when_the_motors_are_cut():
    airframe = flying()
    airframe.cut_motors()
    airframe.step(125)
    assert 8.7 < airframe.height_m < 9.3  # half a second: 1.2 m less the motors' spin-down


@pytest.mark.parametrize("target", [[30.0, 0.0, 10.0], [0.0, 20.0, 25.0], [-8.0, 6.0, 4.0], [0.0, 0.0, 11.0]])
def test_goes_straight_to_a_target_within_its_limits_and_does_not_overshoot(target):
    airframe = flying()
    start, target = airframe.position_m, np.array(target)
    airframe.go_to(target)
    flown = fly(airframe, 16.0)
    velocity = np.diff(flown, axis=0) / 0.02
    assert np.hypot(velocity[:, 0], velocity[:, 1]).max() < 5.0 * 1.05
    assert velocity[:, 2].max() < 4.0 * 1.05
    assert velocity[:, 2].min() > -3.0 * 1.05
    assert flown[-1] == pytest.approx(target, abs=0.02)
    direction = (target - start) / np.linalg.norm(target - start)
    along = (flown - start) @ direction
    off = np.linalg.norm(flown - start - along[:, None] * direction, axis=1)
    assert off.max() < 0.12
    assert along.max() < np.linalg.norm(target - start) + 0.1


@pytest.mark.parametrize("direction", [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [-0.77, 0.06, 0.63], [0.6, 0.6, -0.53]])
def test_legs_of_every_length_end_without_overshoot(direction):
    limits = FlightLimits(5.0, 5.0, 5.0, 4.0, 4.0, 10.0)
    airframe = flying(limits, 60.0)
    direction = np.array(direction) / np.linalg.norm(direction)
    for length in (0.3, 1.0, 2.0, 4.0, 7.0, 11.0, 16.0, 25.0):
        start = airframe.position_m
        airframe.go_to(start + length * direction)
        along = (fly(airframe, 10.0) - start) @ direction
        assert along.max() < length + 0.03
        assert along[-1] == pytest.approx(length, abs=0.01)


def test_a_corner_taken_at_speed_is_followed_by_a_stop_near_the_target():
    airframe = flying(FlightLimits(5.0, 5.0, 5.0, 4.0, 4.0, 10.0), 20.0)
    airframe.go_to([30.0, 0.0, 20.0])
    while airframe.position_m[0] < 29.0:
        airframe.step(5)
    target = np.array([30.0, 3.0, 20.0])
    airframe.go_to(target)
    off = np.linalg.norm(fly(airframe, 8.0) - target, axis=1)
    arrived = int(np.argmax(off < 0.5))
    assert 0 < arrived < 250
    assert off[arrived:].max() < 0.55
    assert off[-1] < 0.02


def test_the_reference_keeps_acceleration_and_jerk_limits():
    airframe = flying()
    airframe.go_to([40.0, 0.0, 10.0])
    velocity = fly(airframe, 15.0, lambda a: a.reference_velocity_m_s)
    acceleration = np.diff(velocity, axis=0) / 0.02
    jerk = np.diff(acceleration, axis=0) / 0.02
    assert np.abs(acceleration[:, 0]).max() <= 3.0 + 1e-6
    assert np.abs(jerk).max() <= 10.0 + 1e-6


def test_yaw_turns_at_its_rate_the_short_way():
    airframe = flying()
    airframe.turn_to(np.pi / 2 + 3.0)
    yaw = np.unwrap(fly(airframe, 6.0, lambda a: [a.yaw_rad])[:, 0])
    rate = np.diff(yaw) / 0.02
    assert np.median(rate[50:120]) == pytest.approx(np.radians(60.0), rel=0.02)
    assert rate.max() < np.radians(72.0)
    assert yaw[-1] - yaw[0] == pytest.approx(3.0, abs=0.05)


def test_a_stop_brakes_and_stays_where_the_braking_ends():
    airframe = flying()
    airframe.go_to([60.0, 0.0, 10.0])
    airframe.step(250 * 5)
    airframe.stop()
    stopped = airframe.target_m
    x = fly(airframe, 8.0)[:, 0]
    assert x[-1] == pytest.approx(stopped[0], abs=0.02)
    assert x.max() < stopped[0] + 0.3  # no rebound to speak of


def test_setpoints_are_tracked_closely():
    airframe = flying()
    w, radius = 3.0 / 20.0, 20.0
    errors = []
    for k in range(60 * 50):
        t = k * 0.02
        c, s = np.cos(w * t), np.sin(w * t)
        position = np.array([radius * s, radius * (1 - c), 10.0])
        velocity = 3.0 * np.array([c, s, 0.0])
        airframe.follow(FlightSetpoint(position, velocity, 3.0 * w * np.array([-s, c, 0.0])))
        airframe.step(5)
        errors.append(np.linalg.norm(airframe.position_m - position))
    assert max(errors[500:]) < 0.25


def test_px4_clips_setpoints_faster_than_its_limits_and_ardupilot_does_not():
    for clips, slowest in ((True, 2.0), (False, 4.5)):
        airframe = flying(FlightLimits(5.0, 2.0, 2.0, 3.0, 3.0, 10.0, clips_setpoints=clips), 30.0)
        for k in range(150):
            airframe.follow(FlightSetpoint(np.array([0, 0, 30.0 + 0.1 * k]), np.array([0, 0, 5.0]), np.zeros(3)))
            airframe.step(5)
        climb = airframe.velocity_m_s[2]
        assert climb == pytest.approx(2.0, abs=0.2) if clips else climb > slowest


def test_lands_softly():
    airframe = flying()
    task = Land(airframe, LIMITS, DescentProfile(5.0, 0.7))
    control = FlightControl(airframe, lambda: LIMITS)
    control.landed = False
    control.begin(task)
    speeds = []
    for _ in range(50 * 40):
        airframe.step(5)
        if airframe.height_m > 0.02:
            speeds.append(airframe.velocity_m_s[2])
        if control.run(0.02):
            break
    assert control.landed
    assert airframe.on_ground
    assert not airframe.running
    assert speeds[-1] == pytest.approx(-0.7, abs=0.1)


def test_return_climbs_before_it_flies_home():
    airframe = flying()
    airframe.go_to([25.0, 0.0, 10.0])
    airframe.step(250 * 12)
    control = FlightControl(airframe, lambda: LIMITS)
    control.landed = False
    control.begin(ReturnHome(airframe, LIMITS, DescentProfile(5.0, 0.7), np.zeros(3), 20.0))
    flown = []
    for _ in range(50 * 120):
        airframe.step(5)
        flown.append(airframe.position_m)
        if control.run(0.02):
            break
    flown = np.array(flown)
    assert control.landed
    away = flown[(flown[:, 0] < 24.0) & (flown[:, 0] > 1.0)]
    assert away[:, 2].min() > 19.0
    assert np.linalg.norm(flown[-1, :2]) < 0.3


def test_the_battery_runs_down_at_hover_power():
    airframe = flying()
    before = airframe.battery.used_wh
    airframe.step(250 * 60)
    used_w = (airframe.battery.used_wh - before) * 60.0
    assert used_w == pytest.approx(airframe.battery.hover_power_w(airframe.parameters), rel=0.02)
    # Momentum theory by hand: 4 rotors of radius 0.6 x 0.32 m, 3 kg, figure of merit 0.6, 15 W of avionics.
    area = 4 * np.pi * (0.6 * 0.32) ** 2
    ideal = (3.0 * 9.80665) ** 1.5 / np.sqrt(2 * 1.225 * area)
    assert used_w == pytest.approx(ideal / 0.6 + 15.0, rel=0.02)


def test_an_empty_battery_says_so():
    battery = Battery(10.0, Airframe([0, 0, 0], LIMITS).parameters)
    battery.used_wh = 12.0
    assert battery.remaining == 0.0


def hover_in_gusts(seed):
    airframe = Airframe([0.0, 0.0, 0.0], LIMITS, wind_m_s=(4.0, 0.0, 0.0), gust_m_s=2.0, seed=seed)
    airframe.go_to([0.0, 0.0, 10.0])
    airframe.step(250 * 12)
    return fly(airframe, 20.0)


def test_gusts_push_it_about_by_their_seed():
    one, again, other = hover_in_gusts(5), hover_in_gusts(5), hover_in_gusts(6)
    assert np.array_equal(one, again)
    assert np.abs(one - other).max() > 0.01
    assert 0.005 < one.std(axis=0).max() < 0.3
    assert np.abs(one - [0.0, 0.0, 10.0]).max() < 0.5
