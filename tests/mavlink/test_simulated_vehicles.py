"""The whole `Vehicle` against both kinds of simulated vehicle, which share no protocol code with it."""

import asyncio
import contextlib
import json
import math
import socket
import sys
import zlib

import numpy as np
import pytest

from gcs.core.errors import RefusedError
from gcs.core.mission import Mission, MissionItem
from gcs.core.vehicle import FlightMode, MissionState
from gcs.mavlink.events import ImageEvent, OffboardEnd, PilotTookOverEvent
from gcs.mavlink.offboard import Setpoint
from gcs.mavlink.station import MavlinkStation

pytestmark = pytest.mark.system

LATITUDE, LONGITUDE, ALTITUDE = 313622000, 1216155000, 4.0
SPEEDUP = 4


def free_port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind(("127.0.0.1", 0))
        return sock.getsockname()[1]


class Door:
    """The simulator's door for tests: a pilot's switch and the truth."""

    def __init__(self, port):
        self.address = ("127.0.0.1", port)

    def __call__(self, line):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
            sock.settimeout(60.0)
            sock.sendto(line.encode(), self.address)
            answer = json.loads(sock.recv(65536))
        assert answer["ok"], answer
        return answer


async def no_setpoints(door, quiet_s=0.5, tries=20):
    """The stream has ended: what was under way arrives, and after that nothing for long enough."""
    heard = []
    for _ in range(tries):
        heard.append(door("state")["setpoints"])
        if heard[-2:-1] == heard[-1:]:
            return
        await asyncio.sleep(quiet_s)
    pytest.fail(f"setpoints go on: {heard}")


@contextlib.asynccontextmanager
async def simulated(kind, *options):
    station = MavlinkStation()
    url = await station.open("udpin:127.0.0.1:0")
    door = free_port()
    arguments = ["--autopilot", kind, "--speedup", str(SPEEDUP), "--port", url.rsplit(":", 1)[1]]
    arguments += ["--tcp-base", "none", "--control-port", str(door), "--exit-with-parent", *options]
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-m", "sitl_mocks", *arguments, stdout=asyncio.subprocess.DEVNULL
    )
    try:
        vehicle = await station.wait_for_vehicle(60.0)
        await vehicle.until(lambda: vehicle.clock.known and vehicle.telemetry.home is not None, 60.0, "its state")
        await vehicle.wait_ready_to_arm(60.0)
        yield vehicle, Door(door)
    finally:
        await station.close_all()
        process.terminate()
        await asyncio.wait_for(process.wait(), 60.0)


def small_mission(kind):
    yaw = math.nan if kind == "px4" else 0.0
    rows = [(16, 0, 0, 0.0)] if kind == "ardupilot" else []
    rows += [(22, 0, 0, 20.0), (16, 1500, 0, 20.0), (16, 1500, 1500, 24.0), (16, 0, 0, 20.0), (21, 0, 0, 0.0)]
    return Mission(
        tuple(
            MissionItem(
                i, 5, command, (0.0, 0.0, 0.0, yaw), LATITUDE + north, LONGITUDE + east, ALTITUDE + up, int(i == 0)
            )
            for i, (command, north, east, up) in enumerate(rows)
        )
    )


async def hover(vehicle, **options):
    home = vehicle.telemetry.home.value
    return await vehicle.offboard("test", take_off_altitude_amsl_m=home.altitude_m + 8.0, deadman_s=20.0, **options)


@pytest.mark.parametrize("kind", ["px4", "ardupilot"])
async def test_a_mission_is_proved_flown_paused_and_resumed_at_a_tenth_of_loss(kind):
    async with simulated(kind, "--loss", "0.1") as (vehicle, _):
        limits, failsafes = await vehicle.read_limits(), await vehicle.read_failsafes()
        assert None not in (limits.max_speed_m_s, limits.max_acceleration_m_s2, limits.offboard_timeout_s)
        assert all(failsafe.active for failsafe in failsafes)
        mission = small_mission(kind)
        proof = await vehicle.upload_mission(mission)
        assert proof.items_read == len(mission.items)
        assert (await vehicle.compare_with_vehicle(mission)).equal
        await vehicle.request_position_references()
        async with vehicle.events() as events:
            await vehicle.start_mission()
            await vehicle.until(lambda: vehicle.in_air and vehicle.telemetry.mission.value.current >= 2, 60.0, "flight")
            await vehicle.pause()
            await vehicle.until(lambda: np.linalg.norm(vehicle.telemetry.velocity_m_s.value) < 0.5, 30.0, "standing")
            await vehicle.point_gimbal(-0.5)
            await vehicle.until(lambda: abs(vehicle.telemetry.gimbal_pitch_rad.value + 0.5) < 0.03, 30.0, "the gimbal")
            await vehicle.take_picture()
            assert vehicle.telemetry.armed.value
            await vehicle.resume_mission()
            assert vehicle.telemetry.mode.value is FlightMode.MISSION
            await vehicle.until(lambda: not vehicle.telemetry.armed.value, 120.0, "the landing")
            await vehicle.until(
                lambda: vehicle.telemetry.mission.value.state is MissionState.COMPLETE, 10.0, "the mission's end"
            )
            assert not vehicle.pilot_in_control
            if kind == "px4":  # announced again when the message was lost; CAMERA_FEEDBACK cannot be asked for
                async with asyncio.timeout(60.0):
                    while not isinstance(await anext(events), ImageEvent):
                        pass
        listing = await vehicle.list_files("/DCIM")
        picture = listing.entries[0]
        fetched = await vehicle.fetch_file(f"mftp:/DCIM/{picture.name}")
        assert len(fetched.data) == picture.size
        assert zlib.crc32(fetched.data) == fetched.crc32
        assert fetched.confirmed


@pytest.mark.parametrize("kind", ["px4", "ardupilot"])
async def test_setpoints_are_followed_on_the_vehicles_clock_and_hold_in_the_end(kind):
    async with simulated(kind) as (vehicle, _):
        session = await hover(vehicle)
        centre = vehicle.telemetry.local_position_m.value
        start = session.vehicle_now()

        def source(vehicle_s):
            # 6 m to the east and back as a smooth step in 30 s
            s = min((vehicle_s - start) / 30.0, 1.0)
            if s == 1.0:
                return None
            x, v, a = 3 * (1 - math.cos(2 * math.pi * s)), math.sin(2 * math.pi * s), math.cos(2 * math.pi * s)
            w = 2 * math.pi / 30.0
            east = np.array([1.0, 0.0, 0.0])
            return Setpoint(centre + x * east, 3 * w * v * east, 3 * w * w * a * east, 0.0)

        farthest = 0.0
        session.fly(source)
        while session.active:
            farthest = max(farthest, vehicle.telemetry.local_position_m.value[0] - centre[0])
            await asyncio.sleep(0.02)
        assert session.end[0] is OffboardEnd.FINISHED, session.end
        assert farthest == pytest.approx(6.0, abs=0.4)
        await vehicle.until(lambda: vehicle.telemetry.mode.value is FlightMode.HOLD, 20.0, "hold")
        await vehicle.return_home()
        await vehicle.land()
        await vehicle.until(lambda: not vehicle.telemetry.armed.value, 60.0, "the landing")
        assert not vehicle.pilot_in_control


@pytest.mark.parametrize("kind", ["px4", "ardupilot"])
async def test_a_stream_that_is_handed_over_to_the_mission_sends_no_further_setpoint(kind):
    async with simulated(kind) as (vehicle, door):
        await vehicle.upload_mission(small_mission(kind))
        session = await hover(vehicle)
        await vehicle.resume_mission()
        assert session.end[0] is OffboardEnd.COMMANDED
        await no_setpoints(door)
        assert vehicle.telemetry.mode.value is FlightMode.MISSION
        assert not vehicle.pilot_in_control
        await vehicle.land()


@pytest.mark.parametrize(("kind", "switch"), [("px4", "POSCTL"), ("px4", "AUTO.LOITER"), ("ardupilot", "LOITER")])
async def test_after_the_pilots_switch_the_vehicle_gets_no_further_setpoint(kind, switch):
    async with simulated(kind) as (vehicle, door):
        session = await hover(vehicle)
        async with vehicle.events() as events:
            door(f"mode {switch}")
            async with asyncio.timeout(60.0):
                while not isinstance(await anext(events), PilotTookOverEvent):
                    pass
        await no_setpoints(door)
        assert session.end[0] is OffboardEnd.MODE_CHANGED
        for command in (vehicle.pause, vehicle.return_home, lambda: hover(vehicle)):
            with pytest.raises(RefusedError, match="take the vehicle back"):
                await command()
        vehicle.take_back(vehicle.identity.name)
        await vehicle.land()
