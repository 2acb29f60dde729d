"""Place, velocity and attitude brought together; and what the real autopilot's recorded flights teach of it."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.mavlink.framing import FrameParser
from gcs.mavlink.motion_samples import MotionSampler
from gcs.planning.dynamics.feed_forward import DragEstimator, LagEstimator, TiltLagEstimator

RECORDS = Path(__file__).resolve().parents[2] / "../shared/records/px4"


def attitude(t, roll=0.0, pitch=0.0, heading=0.0):
    return mavlink.MAVLink_attitude_message(round(t * 1e3), roll, pitch, heading, 0, 0, 0)


def place(t, north=0.0):
    return mavlink.MAVLink_local_position_ned_message(round(t * 1e3), north, 2.0, -3.0, 0.1, 0.2, -0.3)


def target(t, q):
    return mavlink.MAVLink_attitude_target_message(round(t * 1e3), 0, q, 0, 0, 0, 0.5)


def taken(*messages):
    sampler = MotionSampler()
    return [sample for sample in map(sampler.take, messages) if sample is not None]


def test_the_attitude_is_that_of_the_moment_of_the_position():
    first, second = taken(attitude(1.0), place(1.05, 7.0), attitude(1.1, pitch=-0.2), place(1.1), place(1.2))
    assert first.vehicle_s == 1.05
    assert first.position_m == pytest.approx([2.0, 7.0, 3.0])
    assert first.velocity_m_s == pytest.approx([0.2, 0.1, 0.3])
    assert math.atan2(first.thrust_axis[1], first.thrust_axis[2]) == pytest.approx(0.1, abs=1e-3)
    assert second.thrust_axis == pytest.approx([0.0, math.sin(0.2), math.cos(0.2)])
    assert second.asked_axis is None


def test_the_wanted_attitude_comes_along():
    q = [math.cos(0.15), 0.0, -math.sin(0.15), 0.0]  # 0.3 rad nose down, facing north
    (sample,) = taken(attitude(1.0), target(1.0, q), place(1.0), place(1.1))
    assert sample.asked_axis == pytest.approx([0.0, math.sin(0.3), math.cos(0.3)])


def test_what_is_old_repeated_far_apart_or_no_number_is_passed_over():
    nan = math.nan
    assert taken(attitude(1.0), attitude(1.5), place(1.2), place(1.3)) == []
    assert taken(attitude(1.0), place(1.0, nan), place(1.1)) == []
    assert taken(attitude(1.0, nan), place(1.0), place(1.1)) == []
    once = taken(attitude(1.0), place(1.0), place(1.0), place(0.9), attitude(1.1), place(1.1), place(1.1))
    assert [s.vehicle_s for s in once] == [1.0]
    (sample,) = taken(attitude(1.0), target(1.0, [0.0] * 4), target(1.0, [nan] * 4), place(1.0), place(1.1))
    assert sample.asked_axis is None


def test_after_a_reboot_it_begins_anew():
    flown = taken(attitude(500.0), place(500.0), place(500.1), attitude(0.5), place(0.5), place(0.6))
    assert [s.vehicle_s for s in flown] == [500.0, 0.5]


def recorded(name):
    """Messages of a recorded flight's autopilot side."""
    if not (RECORDS / name).is_file():
        pytest.skip("no recorded flights here")
    data, parser = (RECORDS / name).read_bytes(), FrameParser()
    at = 0
    while at + 10 < len(data):
        size = data[at + 9] + (25 if data[at + 10] & 1 else 12)
        yield from (m for m in parser.feed(data[at + 8 : at + 8 + size]) if m is not None)
        at += 8 + size


@pytest.mark.filterwarnings("ignore")
def test_drag_and_tilt_lag_of_a_real_flight():
    """The quadrotor of that simulation has a drag of 1.0 N s/m at 1 kg; its tilt follows in a good 0.2 s."""
    sampler, drag, tilt_lag = MotionSampler(), DragEstimator(), TiltLagEstimator()
    for message in recorded("offboard_circles_gaps.tlog"):
        sample = sampler.take(message)
        if sample is not None:
            drag.add(sample)
            tilt_lag.add(sample)
    assert drag.estimate.value == pytest.approx(1.0, abs=0.04)
    assert abs(drag.estimate.value - 1.0) < 2.0 * drag.estimate.sigma
    assert tilt_lag.estimate.value == pytest.approx(0.23, abs=0.03)


def recorded_lag(name):
    """What the last 40 m of a recorded flight show."""
    estimator, setpoint = LagEstimator(), None
    for m in recorded(f"dense/{name}.tlog"):
        if m.get_type() == "SET_POSITION_TARGET_LOCAL_NED":
            setpoint = m
        elif m.get_type() == "LOCAL_POSITION_NED" and setpoint is not None:
            since = (m.time_boot_ms - setpoint.time_boot_ms) * 1e-3
            velocity = np.array([setpoint.vy, setpoint.vx, -setpoint.vz])
            asked = np.array([setpoint.y, setpoint.x, -setpoint.z]) + since * velocity
            if 0.0 <= since < 0.3:
                estimator.add(m.time_boot_ms * 1e-3, np.array([m.y, m.x, -m.z]), asked, velocity)
    return estimator.estimate


def test_lag_of_real_flights():
    """Behind what was sent, so it is the same where it was sent ahead of its time; with drag fed forward it is gone."""
    plain, ahead, fed = map(recorded_lag, ("C_O_20Hz_lead0", "C_O_20Hz_lead0.3", "C_O_20Hz_lead0_drag1.0"))
    assert plain.value == pytest.approx(0.48, abs=0.05)
    assert ahead.value == pytest.approx(plain.value, abs=0.02)
    assert fed.value == pytest.approx(0.0, abs=0.03)
    assert max(plain.sigma, ahead.sigma, fed.sigma) < 0.1
