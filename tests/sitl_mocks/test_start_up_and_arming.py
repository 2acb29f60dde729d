"""Start-up, streams, modes and arming, as measured on the real autopilots."""

import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

M = mavlink
NAN = math.nan
PREARM = M.MAV_SYS_STATUS_PREARM_CHECK


def kinds(messages):
    return {m.get_type() for m in messages if m.get_srcComponent() == 1}


def test_px4_streams_at_once(make_ground):
    g = make_ground("px4", ready=False)
    assert {"HEARTBEAT", "ATTITUDE", "GLOBAL_POSITION_INT", "LOCAL_POSITION_NED", "SYS_STATUS", "MISSION_CURRENT",
            "EXTENDED_SYS_STATE", "BATTERY_STATUS", "HOME_POSITION"} <= kinds(g.run(5.0))  # fmt: skip


def test_ardupilot_streams_only_on_request(make_ground):
    g = make_ground("ardupilot", ready=False)
    heard = kinds(g.run(25.0))
    assert {"HEARTBEAT", "TIMESYNC"} <= heard
    assert heard <= {"HEARTBEAT", "STATUSTEXT", "TIMESYNC", "GPS_GLOBAL_ORIGIN", "HOME_POSITION"}
    assert g.command(M.MAV_CMD_SET_MESSAGE_INTERVAL, M.MAVLINK_MSG_ID_ATTITUDE, 100_000) == [0]
    assert 9 <= len(g.of("ATTITUDE", g.run(1.0))) <= 11
    g.send(M.MAVLink_request_data_stream_message(1, 1, M.MAV_DATA_STREAM_POSITION, 5, 1))
    assert {"GLOBAL_POSITION_INT", "LOCAL_POSITION_NED"} <= kinds(g.run(1.0))
    other = g.second()
    g.run(1.0)
    assert "ATTITUDE" not in kinds(other.heard)  # asked for on the first link only


def test_an_interval_can_be_changed_and_stopped(px4):
    px4.command(M.MAV_CMD_SET_MESSAGE_INTERVAL, M.MAVLINK_MSG_ID_ATTITUDE, 500_000)
    assert 3 <= len(px4.of("ATTITUDE", px4.run(2.0))) <= 5
    px4.command(M.MAV_CMD_SET_MESSAGE_INTERVAL, M.MAVLINK_MSG_ID_ATTITUDE, -1)
    assert px4.of("ATTITUDE", px4.run(2.0)) == []


def test_speeded_up_streams_follow_the_vehicles_clock_within_what_a_link_carries(px4):
    heard = px4.run(10.0, speedup=10.0)
    assert 8 <= len(px4.of("SYS_STATUS", heard)) <= 12  # 1 Hz of the vehicle's clock
    assert len(px4.of("ATTITUDE", heard)) <= 10.0 / 10.0 / 0.012 + 2
    stamps = [m.time_boot_ms for m in px4.of("ATTITUDE", heard)]
    assert stamps[-1] - stamps[0] == pytest.approx(10_000, abs=300)


def test_texts_go_to_stations_only_on_px4(make_ground):
    g = make_ground("px4", ready=False)
    companion = g.second()
    companion.heartbeat(kind=M.MAV_TYPE_ONBOARD_CONTROLLER)
    g.run(3.0)
    g.arm()
    assert any("Armed" in text for text in g.texts())
    assert companion.texts() == []


def test_px4_sends_two_acknowledgements_for_a_mode(px4):
    assert px4.set_mode(4, 3) == [0, 0]
    assert px4.set_mode(6) == [0, M.MAV_RESULT_TEMPORARILY_REJECTED]  # offboard without a stream
    assert px4.set_mode(99) == [0, M.MAV_RESULT_DENIED]


def test_ardupilot_sends_one_acknowledgement_and_tells_its_mode_at_once(ardupilot):
    start = len(ardupilot.heard)
    assert ardupilot.set_mode(4) == [0]
    (heartbeat,) = ardupilot.of("HEARTBEAT", ardupilot.heard[start:])
    assert (heartbeat.custom_mode, heartbeat.base_mode) == (4, 89)


@pytest.mark.parametrize(
    ("main", "sub", "base_mode", "custom_mode"), [(4, 3, 29, 50593792), (3, 0, 81, 196608), (6, 0, 17, 393216)]
)
def test_px4_heartbeats_carry_the_measured_flags(px4, main, sub, base_mode, custom_mode):
    px4.setpoint((0, 0, 0))
    px4.set_mode(main, sub)
    heartbeat = next(m for m in px4.of("HEARTBEAT", px4.run(1.1)) if m.get_srcComponent() == 1)
    assert (heartbeat.base_mode, heartbeat.custom_mode, heartbeat.autopilot) == (base_mode, custom_mode, 12)


@pytest.mark.parametrize(("main", "sub"), [(3, 0), (7, 0), (1, 0), (4, 5), (4, 6)])
def test_px4_does_not_arm_in(px4, main, sub):
    assert px4.set_mode(main, sub) == [0, 0]
    assert px4.arm() == [M.MAV_RESULT_TEMPORARILY_REJECTED]
    assert not px4.vehicle.armed
    status = px4.of("SYS_STATUS", px4.run(1.2))[-1]
    assert not status.onboard_control_sensors_health & PREARM


def test_px4_does_not_arm_in_offboard_after_its_stream_or_in_a_mission_that_is_gone(px4):
    px4.setpoint((0, 0, -5))
    assert px4.set_mode(6) == [0, 0]  # one setpoint was enough
    px4.run(2.0)
    assert px4.arm() == [M.MAV_RESULT_TEMPORARILY_REJECTED]
    assert px4.set_mode(4, 4) == [0, M.MAV_RESULT_TEMPORARILY_REJECTED]  # no mission at all


def test_px4_is_ready_soon_in_hold(make_ground):
    g = make_ground("px4", ready=False)
    g.run(0.5)
    assert g.arm() == [M.MAV_RESULT_TEMPORARILY_REJECTED]
    g.run(2.5)
    assert g.of("SYS_STATUS")[-1].onboard_control_sensors_health & PREARM
    assert g.arm() == [0]


def test_ardupilot_does_not_arm_in_auto(ardupilot):
    ardupilot.upload([ardupilot.item(0, 0, 16), ardupilot.item(1, 3, 22), ardupilot.item(2, 3, 16)])
    ardupilot.set_mode(3)
    assert ardupilot.arm() == [M.MAV_RESULT_FAILED]
    assert "Arm: AUTO mode not armable" in ardupilot.texts()
    ardupilot.set_mode(4)
    assert ardupilot.arm() == [0]


def test_ardupilot_needs_a_position_first(make_ground):
    g = make_ground("ardupilot", ready=False)
    g.run(0.7)
    g.set_mode(4)
    assert g.arm() == [M.MAV_RESULT_FAILED]
    assert "PreArm: Need Position Estimate" in g.texts()


def test_ardupilots_ready_bit_is_right_only_in_a_mode_that_needs_a_position(make_ground):
    """24 s in STABILIZE and 41 s in GUIDED on the real one; the simulated one does the same twenty times faster."""
    g = make_ground("ardupilot", ready=False)
    g.run(1.5)

    def ready():
        g.command(M.MAV_CMD_REQUEST_MESSAGE, M.MAVLINK_MSG_ID_SYS_STATUS)
        return bool(g.of("SYS_STATUS")[-1].onboard_control_sensors_health & PREARM)

    assert ready()
    g.set_mode(4)
    assert not ready()
    assert g.arm() == [M.MAV_RESULT_FAILED]
    g.run(1.0)
    assert ready()
    assert g.arm() == [0]


@pytest.mark.parametrize(
    ("kind", "mode", "soonest_s", "latest_s"),
    [("ardupilot", 0, 23.0, 25.0), ("ardupilot", 4, 40.0, 42.0), ("px4", None, 3.0, 6.0)],
)
def test_when_asked_to_it_starts_as_slowly_as_the_real_one(make_ground, kind, mode, soonest_s, latest_s):
    g = make_ground(kind, ready=False, real_start=True)
    if mode is not None:
        g.set_mode(mode)

    def ready():
        g.command(M.MAV_CMD_REQUEST_MESSAGE, M.MAVLINK_MSG_ID_SYS_STATUS)
        return bool(g.of("SYS_STATUS")[-1].onboard_control_sensors_health & PREARM)

    g.run_until(ready)
    assert soonest_s < g.vehicle.up_s < latest_s
    assert g.arm() == [0]


def test_ardupilots_storage_opens_two_seconds_after_a_real_start(make_ground):
    g = make_ground("ardupilot", ready=False, real_start=True)
    for seconds, result in ((1.8, M.MAV_MISSION_NO_SPACE), (0.4, None)):
        g.run(seconds)
        answers = g.of("MISSION_ACK", g.send(M.MAVLink_mission_count_message(1, 1, 3, 0)))
        assert [m.type for m in answers] == ([] if result is None else [result])


def test_both_are_heard_within_a_second(make_ground):
    for kind in ("px4", "ardupilot"):
        assert "HEARTBEAT" in kinds(make_ground(kind, ready=False).run(1.0))


def test_px4_does_not_arm_in_a_mission_mode_whose_mission_cannot_be_flown(px4):
    flyable = [px4.item(0, 6, 22, current=1), px4.item(1, 6, 16)]
    px4.upload(flyable)
    px4.run(2.0)
    assert px4.set_mode(4, 4) == [0, 0]
    px4.upload([flyable[0], px4.item(1, 6, 16, z=NAN)])
    px4.run(2.0)
    assert px4.vehicle.mode_name() == "AUTO.MISSION"
    assert px4.arm() == [M.MAV_RESULT_TEMPORARILY_REJECTED]


def test_ardupilot_starts_a_mission_only_when_told_to(ardupilot):
    ardupilot.upload([ardupilot.item(0, 0, 16), ardupilot.item(1, 3, 22), ardupilot.item(2, 3, 16)])
    assert ardupilot.command(M.MAV_CMD_MISSION_START) == [M.MAV_RESULT_DENIED]  # STABILIZE
    ardupilot.set_mode(4)
    ardupilot.arm()
    ardupilot.set_mode(3)
    ardupilot.run(3.0)
    assert ardupilot.vehicle.airframe.on_ground
    assert ardupilot.command(M.MAV_CMD_MISSION_START) == [0]
    ardupilot.run(4.0)
    assert ardupilot.vehicle.airframe.height_m > 2.0


def test_forced_arming_works_and_is_counted(px4):
    px4.set_mode(3)
    assert px4.command(M.MAV_CMD_COMPONENT_ARM_DISARM, 1, 21196) == [0]
    assert px4.vehicle.counters.forced_arms == 1


def test_disarming_in_the_air_is_refused(either):
    either.in_air()
    assert either.command(M.MAV_CMD_COMPONENT_ARM_DISARM, 0) != [0]
    assert either.vehicle.armed


def test_px4_tells_what_it_can_do(px4):
    assert px4.command(M.MAV_CMD_REQUEST_MESSAGE, M.MAVLINK_MSG_ID_AUTOPILOT_VERSION) == [0]
    assert px4.of("AUTOPILOT_VERSION")[0].capabilities == 0xE8FF


def test_version_and_references(make_ground):
    g = make_ground("ardupilot", uid=bytes.fromhex("00112233445566778899"))
    assert g.command(M.MAV_CMD_REQUEST_MESSAGE, M.MAVLINK_MSG_ID_AUTOPILOT_VERSION) == [0]
    version = g.of("AUTOPILOT_VERSION")[0]
    assert version.capabilities == 0xFBEF
    assert bytes(version.uid2)[:10] == bytes.fromhex("00112233445566778899")
    assert g.command(M.MAV_CMD_REQUEST_MESSAGE, M.MAVLINK_MSG_ID_HOME_POSITION) == [0]
    home = g.of("HOME_POSITION")[-1]
    assert (home.latitude, home.longitude, home.altitude) == (313620196, 1216152898, 4000)
    assert g.command(M.MAV_CMD_REQUEST_MESSAGE, M.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN) == [0]


def test_ardupilots_home_and_origin_differ_a_little_in_height(ardupilot):
    ardupilot.set_mode(4)
    ardupilot.arm()
    home = ardupilot.of("HOME_POSITION")[-1]
    origin = ardupilot.of("GPS_GLOBAL_ORIGIN")[-1]
    assert origin.altitude - home.altitude == pytest.approx(20, abs=1)


def test_timesync_answers_with_the_vehicles_clock(either):
    (answer,) = either.of("TIMESYNC", either.send(M.MAVLink_timesync_message(0, 123456)))
    assert answer.ts1 == 123456
    assert answer.tc1 == pytest.approx(either.vehicle.time_s * 1e9)


def test_messages_for_another_vehicle_are_not_for_this_one(px4):
    assert px4.send(M.MAVLink_command_long_message(2, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0)) == []
    assert not px4.vehicle.armed


def test_unknown_commands_are_unsupported(either):
    assert either.command(31010) == [M.MAV_RESULT_UNSUPPORTED]
    if either.vehicle.kind == "px4":
        assert either.command(M.MAV_CMD_DO_PAUSE_CONTINUE, 0) == [M.MAV_RESULT_UNSUPPORTED]
