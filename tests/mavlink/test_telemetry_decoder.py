import math
from pathlib import Path

import numpy as np
import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.core.vehicle import FlightMode, LandedState, MissionState, Telemetry
from gcs.mavlink.autopilots.ardupilot import ArduPilot
from gcs.mavlink.autopilots.px4 import Px4
from gcs.mavlink.framing import FrameParser
from gcs.mavlink.telemetry_decoder import TelemetryDecoder

RECORDS = Path(__file__).resolve().parents[2] / "../shared/records"


def decode(*messages, stack=None, **options):
    decoder, telemetry = TelemetryDecoder(stack or Px4()), Telemetry()
    for i, message in enumerate(messages):
        telemetry = decoder.apply(telemetry, message, 5.0 + i, **options)
    return telemetry


def test_positions_velocities_and_angles_in_enu():
    t = decode(
        mavlink.MAVLink_global_position_int_message(2500, 313622000, 1216155000, 24_000, 20_000, 100, 200, -300, 0),
        mavlink.MAVLink_local_position_ned_message(2600, 1.0, 2.0, -3.0, 0.1, 0.2, -0.3),
        mavlink.MAVLink_attitude_message(2700, 0.01, 0.02, math.pi / 2, 0, 0, 0),
    )
    assert t.position.value.latitude_deg == pytest.approx(31.3622)
    assert t.position.value.altitude_m == pytest.approx(24.0)
    assert t.position.at_s == 5.0
    np.testing.assert_allclose(t.local_position_m.value, [2.0, 1.0, 3.0])
    np.testing.assert_allclose(t.velocity_m_s.value, [0.2, 0.1, 0.3])
    assert t.yaw_rad.value == pytest.approx(0.0), "heading east"
    assert t.vehicle_time_s.value == pytest.approx(2.7)


def test_unknown_is_none_and_never_zero():
    t = decode(
        mavlink.MAVLink_sys_status_message(0, 0, 0, 0, 65535, -1, -1, 0, 0, 0, 0, 0, 0),
        mavlink.MAVLink_battery_status_message(0, 0, 0, 0, [65535] * 10, -1, -1, -1, -1),
        mavlink.MAVLink_global_position_int_message(2500, 0, 0, 0, 0, 0, 0, 0, 0),
        mavlink.MAVLink_home_position_message(0, 0, 0, 0, 0, 0, [1, 0, 0, 0], 0, 0, 0),
        mavlink.MAVLink_gps_raw_int_message(0, 3, 0, 0, 0, 0, 0, 0, 0, 255),
    )
    assert (t.battery, t.position, t.home, t.satellites, t.ready_to_arm) == (None,) * 5
    assert t.gps_fix.value == 3


def test_impossible_numbers_are_dropped():
    nan = math.nan
    t = decode(
        mavlink.MAVLink_local_position_ned_message(1, nan, 0, 0, 0, 0, 0),
        mavlink.MAVLink_attitude_message(1, 0, 0, nan, 0, 0, 0),
        mavlink.MAVLink_global_position_int_message(1, 2_000_000_000, 0, 0, 0, 0, 0, 0, 0),
        mavlink.MAVLink_gimbal_device_attitude_status_message(0, 0, 1, 0, [nan] * 4, 0, 0, 0, 0),
        mavlink.MAVLink_mount_orientation_message(1, 0, nan, 0),
        mavlink.MAVLink_mount_status_message(0, 0, 2_000_000, 0, 0),
    )
    assert (t.local_position_m, t.yaw_rad, t.position, t.gimbal_pitch_rad) == (None,) * 4


def test_numbers_outside_their_enumerations_are_unknown():
    t = decode(
        mavlink.MAVLink_extended_sys_state_message(0, 99),
        mavlink.MAVLink_mission_current_message(3, 65535, 77),
    )
    assert t.landed.value is LandedState.UNKNOWN
    assert t.mission.value.state is MissionState.UNKNOWN
    assert t.mission.value.total is None


def test_battery_and_readiness():
    prearm = mavlink.MAV_SYS_STATUS_PREARM_CHECK
    t = decode(mavlink.MAVLink_sys_status_message(prearm, prearm, prearm, 0, 15_200, 1_250, 83, 0, 0, 0, 0, 0, 0))
    assert t.battery.value.voltage_v == pytest.approx(15.2)
    assert t.battery.value.current_a == pytest.approx(12.5)
    assert t.battery.value.remaining == pytest.approx(0.83)
    assert t.ready_to_arm.value is True


@pytest.mark.parametrize("pitch", [-1.5, -0.6, 0.0, 0.4])
def test_the_gimbals_pitch_is_above_the_horizon_in_all_three_messages(pitch):
    q = [math.cos(pitch / 2), 0.0, math.sin(pitch / 2), 0.0]
    for message in (
        mavlink.MAVLink_gimbal_device_attitude_status_message(0, 0, 1, 0, q, 0, 0, 0, 0),
        mavlink.MAVLink_mount_orientation_message(1, 0, math.degrees(pitch), 0),
        mavlink.MAVLink_mount_status_message(0, 0, round(math.degrees(pitch) * 100), 0, 0),
    ):
        t = decode(message, from_autopilot=False)
        assert t.gimbal_pitch_rad.value == pytest.approx(pitch, abs=1e-4)


def test_other_components_do_not_speak_for_the_autopilot():
    heartbeat = mavlink.MAVLink_heartbeat_message(30, 8, 128, 0, 4, 3)
    assert decode(heartbeat, from_autopilot=False) == Telemetry()


def recorded(name, *, heartbeats_only=False):
    path = RECORDS / name
    if not path.exists():
        pytest.skip("the recorded logs are not here")
    raw = path.read_bytes()
    parser, messages, at = FrameParser(), [], 0
    while at + 8 + 12 <= len(raw):
        assert raw[at + 8] in (0xFD, 0xFE)
        length = raw[at + 9] + (8 if raw[at + 8] == 0xFE else 12)
        seconds = int.from_bytes(raw[at : at + 8], "big") * 1e-6
        number = raw[at + 13] if raw[at + 8] == 0xFE else int.from_bytes(raw[at + 15 : at + 18], "little")
        if number == 0 or not heartbeats_only:
            messages += [(seconds, m) for m in parser.feed(raw[at + 8 : at + 8 + length])]
        at += 8 + length
    assert parser.bad_bytes == 0
    return messages


def follow(name, stack, **part):
    """Telemetry after each message, and the distinct values of mode and mission along the way."""
    decoder, telemetry, modes, missions = TelemetryDecoder(stack), Telemetry(), [], []
    for seconds, message in recorded(name, **part):
        if (message.get_srcSystem(), message.get_srcComponent()) != (1, 1):
            continue
        telemetry = decoder.apply(telemetry, message, seconds)
        if telemetry.mode and modes[-1:] != [(telemetry.mode.value, telemetry.armed.value)]:
            modes.append((telemetry.mode.value, telemetry.armed.value))
        if telemetry.mission and missions[-1:] != [telemetry.mission.value]:
            missions.append(telemetry.mission.value)
    return telemetry, modes, missions


def test_a_recorded_px4_mission():
    t, modes, missions = follow("px4/auto_mission.tlog", Px4())
    assert modes == [
        (FlightMode.HOLD, False),
        (FlightMode.MISSION, True),
        (FlightMode.MISSION, False),
    ]
    assert missions[0].state is MissionState.NO_MISSION
    assert missions[0].total is None
    assert [m.state for m in missions if m.current == 0][1:] == [MissionState.NOT_STARTED, MissionState.ACTIVE]
    assert missions[-1].state is MissionState.COMPLETE
    assert missions[-1].total == 14
    assert Px4().at_last_item(missions[-1])
    assert not Px4().at_last_item(missions[3])
    assert t.origin.value.latitude_deg == pytest.approx(31.3622025)
    assert t.origin.value.altitude_m == pytest.approx(3.656)
    assert t.home.value.longitude_deg == pytest.approx(121.61550, abs=1e-4)
    assert t.landed.value is LandedState.ON_GROUND
    assert t.position.value.altitude_m == pytest.approx(4.0, abs=5.0)


def test_a_recorded_ardupilot_mission():
    t, modes, missions = follow("ardupilot/auto_mission_camera.tlog", ArduPilot())
    assert modes[0] == (FlightMode.MANUAL, False)
    assert modes[-2:] == [(FlightMode.MISSION, True), (FlightMode.MISSION, False)]
    assert (FlightMode.OFFBOARD, False) in modes, "GUIDED, in which it waited for its position"
    assert {m.total for m in missions} == {18}, "19 items, home not counted"
    assert MissionState.PAUSED in {m.state for m in missions}
    assert missions[-1].state is MissionState.COMPLETE
    assert t.home.value.altitude_m == pytest.approx(4.07)
    assert t.origin.value.altitude_m == pytest.approx(4.09)


def test_recorded_offboard_circles_show_that_px4_leaves_and_enters_by_itself():
    _, modes, _ = follow("px4/offboard_circles_gaps.tlog", Px4(), heartbeats_only=True)
    names = [mode for mode, _ in modes]
    assert names.count(FlightMode.OFFBOARD) > 3
    assert FlightMode.MANUAL in names, "position mode, when the stream had a gap"


def test_ardupilot_mode_names_agree_with_another_ground_station():
    gone = {"POSITION", "OF_LOITER"}
    names = {number: name for number, name in mavutil.mode_mapping_acm.items() if name not in gone}
    assert {number: ArduPilot().flight_mode(number)[1] for number in names} == names
