import asyncio
import time

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.core.errors import ConflictError, LinkError, RefusedError
from gcs.core.vehicle import FlightMode
from gcs.mavlink.events import CommandProgressEvent, ModeEvent, OffboardEnd, OffboardEndedEvent, PilotTookOverEvent
from gcs.mavlink.offboard import COMPONENT, Setpoint

ARDUPILOT = mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA
SETPOINT = "SET_POSITION_TARGET_LOCAL_NED"


async def next_event(events, kind):
    async with asyncio.timeout(60.0):
        while True:
            event = await anext(events)
            if isinstance(event, kind):
                return event


async def test_arming_and_disarming_are_never_forced(connected):
    scripted, vehicle = await connected()
    await vehicle.arm()
    assert vehicle.telemetry.armed.value is True
    await vehicle.disarm()
    assert vehicle.telemetry.armed.value is False
    sent = [m for m in scripted.of("COMMAND_LONG") if m.command == 400]
    assert [(m.param1, m.param2) for m in sent] == [(1.0, 0.0), (0.0, 0.0)]


async def test_a_refusal_carries_the_vehicles_own_words(connected):
    scripted, vehicle = await connected()
    scripted.pre_arm = "PreArm: Need Position Estimate"
    with pytest.raises(RefusedError, match="Need Position Estimate") as caught:
        await vehicle.arm()
    assert caught.value.field == "px4-1"


async def test_readiness_is_waited_for_in_the_mode_to_arm_in(connected):
    scripted, vehicle = await connected(autopilot=ARDUPILOT)
    scripted.ready = False
    scripted.send(mavlink.MAVLink_statustext_message(2, b"PreArm: Need Position Estimate", 0, 0))
    with pytest.raises(RefusedError, match="Need Position"):
        await vehicle.wait_ready_to_arm(0.3)
    assert scripted.mode == 4
    scripted.ready = True
    await vehicle.wait_ready_to_arm(5.0)


async def test_a_start_that_fails_after_arming_disarms_again(connected, modes):
    scripted, vehicle = await connected()
    scripted.mode_results[modes["mission"]] = 1
    with pytest.raises(RefusedError, match=r"AUTO\.MISSION"):
        await vehicle.start_mission()
    assert scripted.armed is False


@pytest.mark.parametrize("options", [{}, {"autopilot": ARDUPILOT}], ids=["px4", "ardupilot"])
async def test_start_pause_resume_return_land(connected, options):
    scripted, vehicle = await connected(**options)
    await vehicle.start_mission()
    assert scripted.armed
    assert vehicle.telemetry.mode.value is FlightMode.MISSION
    scripted.landed = 2
    await vehicle.until(lambda: vehicle.in_air, 60.0, "the take-off")
    with pytest.raises(RefusedError, match="in the air"):
        await vehicle.start_mission()
    await vehicle.pause()
    await vehicle.resume_mission()
    assert vehicle.telemetry.mode.value is FlightMode.MISSION
    await vehicle.return_home()
    assert vehicle.telemetry.mode.value is FlightMode.RETURN
    await vehicle.land()
    assert vehicle.telemetry.mode.value is FlightMode.LAND
    assert not vehicle.pilot_in_control


async def test_the_pilot_stops_all_commands_until_taken_back_by_name(connected, modes):
    scripted, vehicle = await connected()
    await vehicle.start_mission()
    async with vehicle.events() as events:
        scripted.set_mode(modes["posctl"])
        told = await next_event(events, PilotTookOverEvent)
    assert "POSCTL" in told.reason
    assert vehicle.pilot_in_control
    before = len(scripted.of("COMMAND_LONG"))
    for command in (vehicle.pause, vehicle.return_home, vehicle.land, vehicle.arm, vehicle.resume_mission):
        with pytest.raises(RefusedError, match="take the vehicle back"):
            await command()
    with pytest.raises(RefusedError):
        await vehicle.offboard("test", take_off_altitude_amsl_m=10.0)
    flight = {400, 176, 22, 300, 193}
    assert not [m for m in scripted.of("COMMAND_LONG")[before:] if m.command in flight]
    with pytest.raises(RefusedError):
        vehicle.take_back("px4-2")
    assert vehicle.pilot_in_control
    vehicle.take_back("px4-1")
    await vehicle.pause()


async def test_a_pilot_who_takes_over_in_the_midst_of_a_start_ends_it(connected, modes):
    scripted, vehicle = await connected()
    scripted.results[400] = 5
    starting = asyncio.ensure_future(vehicle.start_mission())
    await vehicle.until(lambda: bool([m for m in scripted.of("COMMAND_LONG") if m.command == 400]), 60.0, "arming")
    scripted.set_mode(modes["posctl"])
    await vehicle.until(lambda: vehicle.pilot_in_control, 60.0, "the pilot")
    scripted.ack(400, 0)
    scripted.armed = True
    with pytest.raises(RefusedError):
        await starting
    asked = [int(m.param3) for m in scripted.of("COMMAND_LONG") if m.command == 176]
    assert 4 not in asked, "mission mode was never asked for"


async def test_what_a_long_command_is_at_is_told_at_every_tenth(connected):
    scripted, vehicle = await connected()
    scripted.results[400] = 5
    told = []
    vehicle.on_event = told.append
    arming = asyncio.ensure_future(vehicle.arm())

    def shares():
        return [event.share for event in told if isinstance(event, CommandProgressEvent)]

    await vehicle.until(lambda: shares() == [None], 60.0, "it to begin")
    for percent in (20, 21, 22, 80):
        scripted.send(mavlink.MAVLink_command_ack_message(400, 5, percent, 0, 255, 190))
    await vehicle.until(lambda: shares() == [None, 0.2, 0.8], 60.0, "its progress")
    assert {e.command for e in told if isinstance(e, CommandProgressEvent)} == {"COMPONENT_ARM_DISARM"}
    arming.cancel()


async def test_a_newer_command_ends_an_older_sequence(connected, modes):
    scripted, vehicle = await connected()
    scripted.results[400] = 5
    starting = asyncio.ensure_future(vehicle.start_mission())
    await vehicle.until(lambda: bool([m for m in scripted.of("COMMAND_LONG") if m.command == 400]), 60.0, "arming")
    scripted.results.clear()
    await vehicle.return_home()
    scripted.ack(400, 0)
    with pytest.raises(ConflictError, match="newer command"):
        await starting
    assert scripted.mode == modes["return"]


async def test_other_commands_are_commanded_events_and_own_changes_are_told(connected, modes):
    scripted, vehicle = await connected()
    async with vehicle.events() as events:
        await vehicle.set_mode(FlightMode.RETURN)
        assert (await next_event(events, ModeEvent)).commanded is True
        scripted.set_mode(modes["hold"])
        assert (await next_event(events, ModeEvent)).commanded is False


async def test_home_and_origin_are_asked_anew(connected):
    scripted, vehicle = await connected()
    home, origin = await vehicle.request_position_references()
    assert (home.altitude_m, origin.altitude_m) == (4.0, 4.09)
    scripted.results[512] = 3
    with pytest.raises(LinkError, match="home and origin"):
        await vehicle.request_position_references(timeout_s=0.3)


async def test_a_camera_command_needs_a_camera(connected):
    _, vehicle = await connected()
    with pytest.raises(RefusedError, match="camera"):
        await vehicle.take_picture()


async def test_gimbal_and_picture_of_ardupilot(connected):
    scripted, vehicle = await connected(autopilot=ARDUPILOT)
    await vehicle.point_gimbal(-0.5)
    await vehicle.take_picture()
    commands = [m.command for m in scripted.of("COMMAND_LONG")]
    assert 205 in commands
    assert 203 in commands


# ---- offboard ----


@pytest.fixture
def in_offboard(connected, monkeypatch):
    async def enter(*, deadman_s=5.0, lead_in_s=0.1, **options):
        if lead_in_s is not None:
            monkeypatch.setattr("gcs.mavlink.vehicle.OFFBOARD_LEAD_IN_S", lead_in_s)
        scripted, vehicle = await connected(**options)
        session = await vehicle.offboard("test", take_off_altitude_amsl_m=14.0, deadman_s=deadman_s)
        return scripted, vehicle, session

    return enter


async def test_px4_hears_a_second_of_setpoints_before_it_is_asked_into_offboard(in_offboard, modes):
    scripted, vehicle, session = await in_offboard(lead_in_s=None)
    first = next(at for at, m in scripted.heard if m.get_type() == SETPOINT)
    asked = next(
        at for at, m in scripted.heard if m.get_type() == "COMMAND_LONG" and m.command == 176 and m.param2 == 6
    )
    assert asked - first >= 1.0
    assert vehicle.telemetry.mode.value is FlightMode.OFFBOARD
    assert scripted.mode == modes["offboard"]
    hover = scripted.of(SETPOINT)[-1]
    assert (hover.x, hover.y, hover.vx) == (0.0, 0.0, 0.0)
    assert hover.z == pytest.approx(-10.0)
    with pytest.raises(ConflictError, match="leased to test"):
        await vehicle.offboard("other")
    await session.stop()
    assert scripted.mode == modes["hold"]
    assert session.end[0] is OffboardEnd.STOPPED
    assert not vehicle.pilot_in_control


async def test_ardupilot_takes_off_in_guided_first_and_brakes_in_the_end(in_offboard):
    scripted, _, session = await in_offboard(autopilot=ARDUPILOT)
    order = [m.command for m in scripted.of("COMMAND_LONG") if m.command in (176, 400, 22)]
    assert order[:3] == [176, 400, 22]
    take_off_at = next(at for at, m in scripted.heard if m.get_type() == "COMMAND_LONG" and m.command == 22)
    assert min(at for at, m in scripted.heard if m.get_type() == SETPOINT) > take_off_at
    await session.stop()
    assert scripted.mode == 17


@pytest.mark.parametrize(("autopilot", "asked"), [(mavlink.MAV_AUTOPILOT_PX4, True), (ARDUPILOT, False)])
async def test_a_vehicle_that_takes_accelerations_is_asked_for_the_attitude_it_wants(in_offboard, autopilot, asked):
    scripted, vehicle, session = await in_offboard(autopilot=autopilot)
    sample = asyncio.get_running_loop().create_future()
    vehicle.on_motion = lambda heard: sample.done() or sample.set_result(heard)
    assert np.linalg.norm((await asyncio.wait_for(sample, 10.0)).thrust_axis) == pytest.approx(1.0)
    wanted = [m.param1 for m in scripted.of("COMMAND_LONG") if m.command == 511]
    assert (83.0 in wanted) is asked
    await session.stop()


async def test_the_source_is_flown_on_the_vehicles_clock(in_offboard):
    scripted, _, session = await in_offboard(speed=5.0)
    start = session.vehicle_now()

    def source(vehicle_s):
        return Setpoint.hover(np.array([vehicle_s - start, 0.0, 10.0]), 0.0)

    before = len(scripted.heard)
    session.fly(source)
    flown = []
    while len(flown) <= 100:
        await asyncio.sleep(0.1)
        flown = [(at, m) for at, m in scripted.heard[before:] if m.get_type() == SETPOINT and m.y > 0.0]
    assert flown[-1][1].y > 1.0
    for _, setpoint in flown:
        assert setpoint.y == pytest.approx(setpoint.time_boot_ms / 1000 - start, abs=0.1)
    late_ms = [(at - scripted.born) * scripted.speed * 1000 - m.time_boot_ms for at, m in flown]
    assert min(map(abs, late_ms)) < 100, "the machine may keep some of them back, not all"
    await session.stop()


async def test_what_is_recorded_of_the_stream_is_what_the_vehicle_heard_from_a_component_of_its_own(in_offboard):
    scripted, vehicle, session = await in_offboard()
    recorded = []
    vehicle.on_packet = lambda packet: recorded.append(bytes(packet))
    await vehicle.until(lambda: sum(packet[6] == COMPONENT for packet in recorded) >= 3, 60.0, "some setpoints")
    await session.stop()
    heard = [bytes(m.get_msgbuf()) for m in scripted.of(SETPOINT)]
    setpoints = [packet for packet in recorded if packet[5:7] == bytes([255, COMPONENT])]
    first = heard.index(setpoints[0])
    assert heard[first : first + len(setpoints)] == setpoints


@pytest.mark.parametrize("new", ["posctl", "return", "hold"])
async def test_no_setpoint_follows_a_mode_change_by_the_pilot(in_offboard, modes, new):
    scripted, vehicle, session = await in_offboard()
    async with vehicle.events() as events:
        scripted.set_mode(modes[new])
        await next_event(events, PilotTookOverEvent)
    heard_at = time.monotonic()
    sent = session.setpoints_sent
    assert session.end[0] is OffboardEnd.MODE_CHANGED
    scripted.set_mode(modes["offboard"])
    await asyncio.sleep(0.4)
    assert session.setpoints_sent == sent
    late = [at for at, m in scripted.heard if m.get_type() == SETPOINT and at > heard_at + 0.1]
    assert late == []
    with pytest.raises(RefusedError):
        await vehicle.offboard("again")


async def test_an_owner_that_hangs_ends_the_stream_and_the_vehicle_is_told_to_hold(in_offboard, modes):
    scripted, vehicle, session = await in_offboard(deadman_s=0.2)
    async with vehicle.events() as events:
        ended = await next_event(events, OffboardEndedEvent)
    assert ended.end is OffboardEnd.DEADMAN
    assert vehicle.offboard_session is None
    await vehicle.until(lambda: vehicle.telemetry.mode.value is FlightMode.HOLD, 60.0, "hold")
    assert scripted.mode == modes["hold"]
    assert not vehicle.pilot_in_control
    assert not session.active


async def test_a_commanded_mode_ends_the_stream_when_the_vehicle_shows_it(in_offboard, modes):
    scripted, vehicle, session = await in_offboard()
    await vehicle.return_home()
    assert session.end[0] is OffboardEnd.COMMANDED
    assert scripted.mode == modes["return"]
    assert not vehicle.pilot_in_control


async def test_a_lost_link_ends_the_stream_for_good(in_offboard):
    scripted, vehicle, session = await in_offboard()
    scripted.silent = True
    await vehicle.until(lambda: not session.active, 60.0, "the end")
    assert session.end[0] is OffboardEnd.LINK_LOST
    sent = session.setpoints_sent
    scripted.silent = False
    await vehicle.until(lambda: vehicle.connected, 60.0, "the link")
    await asyncio.sleep(0.2)
    assert session.setpoints_sent == sent


async def test_closing_the_station_ends_the_stream(station, in_offboard):
    _, _, session = await in_offboard()
    await station.close_all()
    assert not session.active


async def test_a_vehicle_that_does_not_enter_leaves_no_lease_and_no_stream(connected, modes):
    scripted, vehicle = await connected()
    scripted.mode_results[modes["offboard"]] = 4
    with pytest.raises(RefusedError, match="OFFBOARD"):
        await vehicle.offboard("test", take_off_altitude_amsl_m=14.0)
    await vehicle.until(lambda: vehicle.offboard_session is None, 60.0, "the end")
    count = len(scripted.of(SETPOINT))
    await asyncio.sleep(0.2)
    assert len(scripted.of(SETPOINT)) == count
    scripted.mode_results.clear()
    session = await vehicle.offboard("test")
    await session.stop()


async def test_on_the_ground_it_needs_an_altitude(connected):
    _, vehicle = await connected()
    with pytest.raises(RefusedError, match="altitude"):
        await vehicle.offboard("test")
