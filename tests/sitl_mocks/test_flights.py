"""Whole flights in-process: missions, offboard, pilots, failsafes."""

import math

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

M = mavlink
NAN = math.nan
OFFBOARD, POSCTL, AUTO = 6, 3, 4


def reached(messages):
    told = [m.seq for m in messages if m.get_type() == "MISSION_ITEM_REACHED"]
    return [s for i, s in enumerate(told) if i == 0 or told[i - 1] != s]


def px4_mission(g):
    return [
        g.item(0, 6, 22, z=8.0, north=-20.0, east=-20.0, current=1),
        g.item(1, 6, 16, (0.0, 0.3, 0.0, 90.0), north=0.0, east=-10.0, z=12.0),
        g.item(2, 2, 1000, (-40.0, 0.0, NAN, NAN), x=0, y=0, z=0.0),
        g.item(3, 2, 93, (2.0, 0.0, 0.0, 0.0), x=0, y=0, z=0.0),
        g.item(4, 2, 2000, (0.0, 0.0, 1.0, 1.0), x=0, y=0, z=0.0),
        g.item(5, 2, 93, (1.0, 0.0, 0.0, 0.0), x=0, y=0, z=0.0),
        g.item(6, 6, 16, (0.0, 0.3, 0.0, NAN), north=-20.0, east=-20.0, z=12.0),
        g.item(7, 6, 21, north=-20.0, east=-20.0, z=0.0),
    ]


def ardupilot_mission(g):
    zero = (0.0, 0.0, 0.0, 0.0)
    return [
        g.item(0, 0, 16),
        g.item(1, 3, 22, zero, z=8.0),
        g.item(2, 3, 16, zero, north=0.0, east=-10.0, z=12.0),
        g.item(3, 2, 115, (90.0, 0.0, 0.0, 0.0)),
        g.item(4, 2, 205, (-40.0, 0.0, 0.0, 0.0), x=0, y=0, z=2.0),
        g.item(5, 2, 93, (4.0, 0.0, 0.0, 0.0)),
        g.item(6, 2, 203, zero, x=1, y=0, z=0.0),
        g.item(7, 2, 93, (1.0, 0.0, 0.0, 0.0)),
        g.item(8, 3, 16, zero, north=-20.0, east=-20.0, z=12.0),
        g.item(9, 3, 21, zero, north=-20.0, east=-20.0, z=0.0),
    ]


def start(g):
    """Upload, arm and start the kind's mission."""
    if g.vehicle.kind == "px4":
        assert g.upload(px4_mission(g))[0] == 0
        g.run(2.0)
        assert g.arm() == [0]
        assert g.set_mode(AUTO, 4) == [0, 0]
    else:
        assert g.upload(ardupilot_mission(g))[0] == 0
        g.set_mode(4)
        assert g.arm() == [0]
        assert g.set_mode(3) == [0]
        assert g.command(M.MAV_CMD_MISSION_START) == [0]
        for message_id in (M.MAVLINK_MSG_ID_MISSION_CURRENT, M.MAVLINK_MSG_ID_EXTENDED_SYS_STATE):
            g.command(M.MAV_CMD_SET_MESSAGE_INTERVAL, message_id, 500_000)


def test_a_mission_is_flown_to_its_end(either):
    start(either)
    heard = either.run_until(lambda: not either.vehicle.armed)
    (shot,) = either.vehicle.camera.shots
    at = shot.exposure
    assert at.position_m == pytest.approx([-10.0, 0.0, 12.0], abs=0.3)
    assert at.yaw_rad == pytest.approx(0.0, abs=0.05)  # heading 90 is east
    assert at.pitch_rad == pytest.approx(math.radians(-40.0), abs=1e-3)
    assert np.linalg.norm(either.vehicle.airframe.position_m - either.vehicle.home_m) < 0.3
    states = [m.mission_state for m in either.of("MISSION_CURRENT", heard)]
    assert 3 in states
    either.run(2.0)
    assert either.of("MISSION_CURRENT")[-1].mission_state == 5
    landed = [m.landed_state for m in either.of("EXTENDED_SYS_STATE", heard)]
    order = [s for i, s in enumerate(landed) if i == 0 or landed[i - 1] != s]
    assert order[-3:] == [3, 2, 4] or order[-4:] == [3, 2, 4, 1]


def test_px4_tells_only_the_last_of_a_run_of_instant_items_and_repeats_it(px4):
    start(px4)
    heard = px4.run_until(lambda: not px4.vehicle.armed)
    assert reached(heard) == [0, 2, 4, 5, 6, 7]  # neither waypoint 1 nor delay 3: an instant item stands behind each
    assert len([m for m in px4.of("MISSION_ITEM_REACHED", heard) if m.seq == 0]) > 1
    told = [m.seq for m in px4.of("MISSION_ITEM_REACHED", px4.run(5.0))]
    assert set(told) == {7}  # each second, and ten times in all, on the ground too
    assert 4 <= len(told) <= 6
    assert 4 <= len(px4.of("MISSION_ITEM_REACHED", px4.run(20.0))) <= 6
    forwarded = [(m.command, m.target_component) for m in px4.of("COMMAND_LONG", heard)]
    assert forwarded == [(1000, 0), (2000, 100)]


def test_px4_forwards_a_change_of_speed_and_a_trigger_distance_to_everybody(px4):
    mission = px4_mission(px4)[:2]
    mission += [px4.item(2, 2, 178, (1.0, 3.0, -1.0, 0.0), x=0, y=0, z=0.0), px4.item(3, 2, 206, (5.0, 0.0, 1.0, 0.0))]
    mission.append(px4.item(4, 6, 16, north=-20.0, east=-20.0, z=12.0))
    assert px4.upload(mission)[0] == 0
    px4.run(2.0)
    px4.arm()
    px4.set_mode(AUTO, 4)
    heard = px4.run_until(lambda: px4.vehicle.run.current == 4)
    forwarded = [(m.command, m.target_component, m.param1) for m in px4.of("COMMAND_LONG", heard)]
    assert forwarded == [(178, 0, 1.0), (206, 0, 5.0)]


def test_ardupilot_misses_a_waypoint_with_a_do_item_right_behind_it(ardupilot):
    start(ardupilot)
    heard = ardupilot.run_until(lambda: not ardupilot.vehicle.armed)
    assert reached(heard) == [1, 3, 5, 7, 8, 9]
    (feedback,) = ardupilot.of("CAMERA_FEEDBACK", heard)
    assert feedback.img_idx == 1
    assert ardupilot.of("CAMERA_IMAGE_CAPTURED") == []
    texts = ardupilot.texts()
    assert texts.index("Mission: 5 Delay") < texts.index("Mission: 4 MountControl")  # do items run beside it


def test_ardupilot_a_condition_holds_up_do_items_but_not_the_flight(ardupilot):
    zero = (0.0, 0.0, 0.0, 0.0)
    mission = [
        ardupilot.item(0, 0, 16),
        ardupilot.item(1, 3, 22, zero, z=8.0),
        ardupilot.item(2, 3, 16, zero, north=0.0, east=-20.0, z=8.0),
        ardupilot.item(3, 2, 115, (180.0, 0.0, 0.0, 0.0)),
        ardupilot.item(4, 2, 203, zero, x=1, y=0, z=0.0),
        ardupilot.item(5, 3, 16, zero, north=60.0, east=-20.0, z=8.0),
    ]
    ardupilot.upload(mission)
    ardupilot.set_mode(4)
    ardupilot.arm()
    ardupilot.set_mode(3)
    ardupilot.command(M.MAV_CMD_MISSION_START)
    ardupilot.run_until(lambda: ardupilot.vehicle.camera.shots)
    assert ardupilot.vehicle.camera.shots[0].exposure.position_m[1] > 4.0  # far past waypoint 2 by then


def test_pause_and_go_on(either):
    start(either)
    vehicle = either.vehicle
    either.run_until(lambda: vehicle.airframe.height_m > 9.0)
    either.run(2.0)
    if vehicle.kind == "px4":
        either.set_mode(AUTO, 3)
    else:
        assert either.command(M.MAV_CMD_DO_PAUSE_CONTINUE, 0) == [0]
    either.run(5.0)
    place = vehicle.airframe.position_m
    assert vehicle.mission_current()[2] == 4
    either.run(3.0)
    assert np.linalg.norm(vehicle.airframe.position_m - place) < 0.1
    if vehicle.kind == "px4":
        either.set_mode(AUTO, 4)
    else:
        assert either.command(M.MAV_CMD_DO_PAUSE_CONTINUE, 1) == [0]
    either.run_until(lambda: not vehicle.armed)
    assert len(vehicle.camera.shots) == 1


def test_an_upload_into_a_flying_mission(either):
    start(either)
    vehicle = either.vehicle
    either.run_until(lambda: vehicle.airframe.height_m > 9.0)
    result, _ = either.upload(px4_mission(either) if vehicle.kind == "px4" else ardupilot_mission(either))
    assert result == 0
    if vehicle.kind == "ardupilot":
        assert "Auto mission changed, restarted command" in either.texts()
    either.run(1.0)
    assert vehicle.mission_current()[2] == 3


def test_speed_items_change_the_speed(px4):
    mission = px4_mission(px4)
    mission.insert(1, px4.item(1, 2, 178, (1.0, 1.5, -1.0, 0.0), x=0, y=0, z=0.0))
    for seq, item in enumerate(mission):
        item.seq = seq
    px4.upload(mission)
    px4.run(2.0)
    px4.arm()
    px4.set_mode(AUTO, 4)
    speeds = []
    px4.run_until(lambda: speeds.append(np.hypot(*px4.vehicle.airframe.velocity_m_s[:2])) or px4.vehicle.camera.shots)
    assert max(speeds) == pytest.approx(1.5, abs=0.15)


def test_ardupilot_forgets_where_it_was_when_disarmed(ardupilot):
    start(ardupilot)
    ardupilot.run_until(lambda: not ardupilot.vehicle.armed)
    ardupilot.run(1.0)
    assert ardupilot.of("MISSION_CURRENT")[-1].seq == 0


# Offboard ------------------------------------------------------------------------------------------------------------


def local(g):
    """Where it is now, north, east, down about the origin."""
    return g.vehicle.frame.local_ned(g.vehicle.airframe.position_m)


def enter_offboard(g):
    g.in_air()
    here = local(g)
    g.setpoint(here, yaw=0.0)
    assert g.set_mode(OFFBOARD) == [0, 0] if g.vehicle.kind == "px4" else g.set_mode(4) == [0]
    return here


def stream(g, here, seconds, speed=2.0, rate=25.0):
    """Fly north; returns where the last setpoint was."""
    position = np.array(here)
    for _ in range(round(seconds * rate)):
        position = position + np.array([speed / rate, 0.0, 0.0])
        g.setpoint(position, (speed, 0, 0), yaw=0.0)
        g.run(1.0 / rate)
    return position


def test_offboard_follows_position_velocity_and_acceleration(either):
    here = enter_offboard(either)
    last = stream(either, here, 10.0)
    assert local(either) == pytest.approx(tuple(last), abs=0.25)
    assert either.vehicle.counters.setpoints_in_offboard >= 200
    assert either.vehicle.airframe.yaw_rad == pytest.approx(math.pi / 2, abs=0.05)


def test_global_setpoints_are_the_same_place(ardupilot):
    enter_offboard(ardupilot)
    x, y = round((31.3622) * 1e7), round(121.6155 * 1e7)
    for _ in range(200):
        ardupilot.send(M.MAVLink_set_position_target_global_int_message(
            0, 1, 1, 5, 0x800, x, y, 20.0, 0, 0, 0, 0, 0, 0, 0.0, 0.0))  # fmt: skip
        ardupilot.run(0.1)
    assert ardupilot.vehicle.airframe.position_m == pytest.approx([0.0, 0.0, 16.0], abs=0.1)


def test_px4_gap_below_the_timeout_does_nothing(px4):
    here = enter_offboard(px4)
    stream(px4, here, 3.0)
    px4.run(0.9)
    assert px4.vehicle.mode_name() == "OFFBOARD"


def test_px4_holds_after_a_gap_and_goes_on_by_itself_when_the_stream_returns(px4):
    here = enter_offboard(px4)
    last = stream(px4, here, 3.0)
    px4.run(1.2)
    assert px4.vehicle.mode_name() == "AUTO.LOITER"
    assert "Failsafe activated" in px4.texts()
    heartbeat = [m for m in px4.of("HEARTBEAT", px4.run(1.0)) if m.get_srcComponent() == 1][-1]
    assert heartbeat.system_status == 5
    px4.run(4.0)
    stopped = local(px4)
    px4.run(3.0)
    assert local(px4) == pytest.approx(stopped, abs=0.1)
    stream(px4, last, 1.0)
    assert px4.vehicle.mode_name() == "OFFBOARD"


@pytest.mark.parametrize(("choice", "mode"), [(3, "AUTO.RTL"), (4, "AUTO.LAND"), (5, "AUTO.LOITER")])
def test_px4_does_what_it_is_set_to_when_the_stream_is_lost(make_ground, choice, mode):
    g = make_ground("px4", parameters=(("COM_OBL_RC_ACT", choice),))
    here = enter_offboard(g)
    stream(g, here, 1.0)
    g.run(1.2)
    assert g.vehicle.mode_name() == mode


def test_px4_position_mode_sinks_and_disarms_when_the_stream_never_returns(make_ground):
    g = make_ground("px4", parameters=(("COM_OBL_RC_ACT", 0.0),))
    here = enter_offboard(g)
    stream(g, here, 1.0)
    g.run(3.0)
    assert g.vehicle.mode_name() == "POSCTL"
    heartbeat = [m for m in g.of("HEARTBEAT") if m.get_srcComponent() == 1][-1]
    assert (heartbeat.base_mode, heartbeat.custom_mode, heartbeat.system_status) == (209, 196608, 5)
    g.run(2.0)
    assert g.vehicle.airframe.velocity_m_s[2] == pytest.approx(-0.7, abs=0.1)
    g.run_until(lambda: not g.vehicle.armed)
    assert "Disarmed by landing" in g.texts()


def test_ardupilot_flies_on_for_three_seconds_then_brakes(ardupilot):
    here = enter_offboard(ardupilot)
    last = stream(ardupilot, here, 4.0, speed=3.0)
    ardupilot.run(2.8)
    assert ardupilot.vehicle.airframe.velocity_m_s[1] == pytest.approx(3.0, abs=0.2)
    ardupilot.run(4.0)
    assert np.linalg.norm(ardupilot.vehicle.airframe.velocity_m_s) < 0.1
    flown_on = local(ardupilot)[0] - last[0]
    assert 9.0 < flown_on < 9.0 + 3.0**2 / 2 + 1.5
    assert ardupilot.vehicle.mode_name() == "GUIDED"


def test_offboard_timers_run_on_the_vehicles_clock(make_ground):
    g = make_ground("px4")
    here = enter_offboard(g)
    stream(g, here, 1.0)
    g.run(0.9, speedup=20.0)
    assert g.vehicle.mode_name() == "OFFBOARD"
    g.run(0.3, speedup=20.0)
    assert g.vehicle.mode_name() == "AUTO.LOITER"


@pytest.mark.parametrize("frame", [7, 9, 12, 20])
def test_setpoints_in_other_frames_or_with_nothing_in_them_are_refused_with_a_text(px4, frame):
    for kwargs in ({"frame": frame}, {"mask": 0xFFF}, {"mask": 0x200}):
        count = len(px4.texts())
        px4.setpoint((0, 0, -5), **kwargs)
        assert len(px4.texts()) == count + 1
    assert px4.set_mode(OFFBOARD) == [0, M.MAV_RESULT_TEMPORARILY_REJECTED]


def test_a_landing_by_setpoints_is_noticed(either):
    here = enter_offboard(either)
    position = np.array(here)
    vehicle = either.vehicle
    for _ in range(600):
        position = position + np.array([0.0, 0.0, 0.04 if position[2] < 0.1 else 0.0])
        either.setpoint(position, (0, 0, 1.0 if position[2] < 0.1 else 0.0), yaw=0.0)
        either.run(0.04)
        if not vehicle.armed:
            break
    assert vehicle.airframe.on_ground
    assert vehicle.flight.landed_state == 1
    if vehicle.kind == "px4":
        assert not vehicle.armed
    else:
        assert either.command(M.MAV_CMD_COMPONENT_ARM_DISARM, 0) == [0]


# Pilots and failsafes ------------------------------------------------------------------------------------------------


def test_a_pilots_switch_ends_offboard_and_setpoints_no_longer_count(either):
    here = enter_offboard(either)
    stream(either, here, 1.0)
    vehicle = either.vehicle
    assert vehicle.set_mode_by_name("POSCTL" if vehicle.kind == "px4" else "LOITER")
    counted = vehicle.counters.setpoints_in_offboard
    stream(either, local(either), 2.0, speed=5.0)
    assert vehicle.counters.setpoints_in_offboard == counted
    assert vehicle.mode_name() in {"POSCTL", "LOITER"}
    assert np.linalg.norm(vehicle.airframe.velocity_m_s) < 0.3


def test_px4_returns_when_the_station_is_lost(make_ground):
    g = make_ground("px4", parameters=(("COM_DL_LOSS_T", 10.0),))
    g.in_air()
    g.run(9.0, heartbeats=False)
    assert g.vehicle.mode_name() == "AUTO.LOITER"
    assert not g.vehicle.station_lost
    g.run(2.0, heartbeats=False)
    heartbeat = [m for m in g.of("HEARTBEAT") if m.get_srcComponent() == 1][-1]
    assert heartbeat.system_status == 5  # held for COM_FAIL_ACT_T
    g.run(5.0, heartbeats=False)
    assert g.vehicle.mode_name() == "AUTO.RTL"


def test_only_stations_count(make_ground):
    g = make_ground("px4", parameters=(("COM_DL_LOSS_T", 5.0),))
    g.in_air()
    for _ in range(7):
        g.heartbeat(kind=M.MAV_TYPE_ONBOARD_CONTROLLER)
        g.run(1.0, heartbeats=False)
    assert g.vehicle.station_lost


def test_link_timers_run_on_wall_time(make_ground):
    g = make_ground("px4")
    start(g)
    g.run(60.0, speedup=10.0, heartbeats=False)  # 6 s on the wall
    assert not g.vehicle.station_lost


def test_a_restarted_station_finds_its_mission_flying(either):
    start(either)
    either.run(25.0, heartbeats=False)
    assert either.vehicle.mode_name() in {"AUTO.MISSION", "AUTO"}
    assert not either.vehicle.station_lost


def test_ardupilot_goes_on_with_a_mission_without_a_station_but_returns_from_guided(make_ground):
    g = make_ground("ardupilot", parameters=(("FS_GCS_TIMEOUT", 5.0),))
    start(g)
    g.run(8.0, heartbeats=False)
    assert g.vehicle.station_lost
    assert g.vehicle.mode_name() == "AUTO"
    g = make_ground("ardupilot", parameters=(("FS_GCS_TIMEOUT", 5.0),)).in_air()
    g.run(6.0, heartbeats=False)
    assert g.vehicle.mode_name() == "RTL"


def test_a_low_battery_brings_it_home(either):
    either.in_air()
    left = 0.06 if either.vehicle.kind == "px4" else 0.12
    either.vehicle.airframe.battery.used_wh = (1.0 - left) * either.vehicle.airframe.battery.capacity_wh
    either.run(1.0)
    assert either.vehicle.mode_name() in {"AUTO.RTL", "RTL"}
    status = either.vehicle.telemetry.build(M.MAVLINK_MSG_ID_SYS_STATUS)
    assert status.battery_remaining == pytest.approx(100 * left, abs=1.1)


def test_the_fence_turns_it_back(make_ground):
    for kind, name in (("px4", "GF_MAX_VER_DIST"), ("ardupilot", "FENCE_ALT_MAX")):
        g = make_ground(kind, parameters=((name, 8.0),))
        if kind == "px4":
            g.arm()
            g.command(M.MAV_CMD_NAV_TAKEOFF, NAN, 0, 0, NAN, NAN, NAN, 14.0)
        else:
            g.set_mode(4)
            g.arm()
            g.command(M.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 10.0)
        g.run_until(lambda v=g.vehicle: v.mode_name() in {"AUTO.RTL", "RTL"}, 20.0)


def highest_on_the_way_home(ground):
    ground.in_air(5.0)
    ground.command(M.MAV_CMD_NAV_RETURN_TO_LAUNCH)
    heights = []
    ground.run_until(lambda: heights.append(ground.vehicle.airframe.height_m) or not ground.vehicle.armed, 300.0)
    return max(heights)


@pytest.mark.parametrize(
    ("kind", "cone", "own"), [("px4", "RTL_CONE_ANG", 30.0), ("ardupilot", "RTL_CONE_SLOPE", 15.0)]
)
def test_return_uses_the_vehicles_own_height(make_ground, kind, cone, own):
    assert highest_on_the_way_home(make_ground(kind, parameters=((cone, 0.0),))) == pytest.approx(own, abs=0.5)


@pytest.mark.parametrize(("kind", "height"), [("px4", 5.0), ("ardupilot", 7.5)])
def test_over_home_a_cone_keeps_the_return_low(make_ground, kind, height):
    assert highest_on_the_way_home(make_ground(kind)) == pytest.approx(height, abs=0.5)


def around_a_wall(ground):
    """Up, east, north and down behind where a straight way home would be; returns the flown path."""
    ground.in_air(10.0)
    for east, north, up in ((30.0, 0.0, 10.0), (30.0, 30.0, 10.0), (30.0, 30.0, 6.0)):
        target = (north, east, -up)
        for _ in range(400):
            ground.setpoint(target, mask=0b110111111000)
            ground.run(0.1)
            off = ground.vehicle.airframe.position_m - ground.vehicle.home_m - np.array([east, north, up])
            if np.linalg.norm(off) < 0.3:
                break
        else:
            raise AssertionError(f"not at {target}: {off}")


@pytest.mark.parametrize("choice", [3, 4])
def test_ardupilot_flies_back_the_way_it_came_when_the_station_is_lost(make_ground, choice):
    g = make_ground(
        "ardupilot", parameters=(("FS_GCS_ENABLE", choice), ("FS_GCS_TIMEOUT", 2.0), ("SRTL_ACCURACY", 1.0))
    )
    around_a_wall(g)
    track = []
    g.run(3.0, heartbeats=False)
    assert g.vehicle.mode_name() == "SMART_RTL"

    def down():
        track.append(g.vehicle.airframe.position_m - g.vehicle.home_m)
        return not g.vehicle.armed

    g.run_until(down, 300.0, heartbeats=False)
    track = np.array(track)
    flown = np.array([[0, 0, 0], [0, 0, 10], [30, 0, 10], [30, 30, 10], [30, 30, 6]], float)
    a, along = flown[:-1], np.diff(flown, axis=0)
    share = np.clip(((track[:, None] - a) * along).sum(-1) / (along**2).sum(-1), 0, 1)
    off = np.linalg.norm(track[:, None] - a - share[..., None] * along, axis=-1).min(axis=1)
    assert off.max() < 1.5
    assert np.linalg.norm(track[-1]) < 0.5
    # the straight way would have led through the middle
    assert np.linalg.norm(track[:, :2] - [15.0, 15.0], axis=1).min() > 12.0


@pytest.mark.parametrize(("choice", "mode"), [(3, "RTL"), (4, "LAND")])
def test_ardupilot_does_the_other_thing_when_it_forgot_the_way(make_ground, choice, mode):
    few = (("FS_GCS_ENABLE", choice), ("FS_GCS_TIMEOUT", 2.0), ("SRTL_POINTS", 3))
    g = make_ground("ardupilot", parameters=few)
    around_a_wall(g)
    assert "SmartRTL deactivated: buffer full" in g.texts()
    assert g.set_mode(21) == [4]
    g.run(3.0, heartbeats=False)
    assert g.vehicle.mode_name() == mode


def test_px4_goes_on_with_its_mission_when_the_loss_of_the_station_is_excepted(make_ground):
    g = make_ground("px4", parameters=(("COM_DL_LOSS_T", 1), ("COM_FAIL_ACT_T", 0.5), ("COM_DLL_EXCEPT", 3)))
    start(g)
    g.run_until(lambda: g.vehicle.airframe.height_m > 9.0)
    modes = set()
    g.run_until(lambda: modes.add(g.vehicle.mode_name()) or not g.vehicle.armed, heartbeats=False)
    assert g.vehicle.station_lost
    assert "AUTO.RTL" not in modes
    assert len(g.vehicle.camera.shots) == 1


@pytest.mark.parametrize(
    ("choice", "mode"), [(0, "AUTO.MISSION"), (1, "AUTO.LOITER"), (2, "AUTO.RTL"), (3, "AUTO.LAND")]
)
def test_px4_does_what_it_is_set_to_when_the_station_is_lost(make_ground, choice, mode):
    g = make_ground("px4", parameters=(("COM_DL_LOSS_T", 1), ("COM_FAIL_ACT_T", 0.5), ("NAV_DLL_ACT", choice)))
    start(g)
    g.run_until(lambda: g.vehicle.airframe.height_m > 9.0)
    g.run(4.0, heartbeats=False)
    assert g.vehicle.mode_name() == mode
