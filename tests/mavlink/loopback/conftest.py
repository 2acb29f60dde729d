"""A scripted vehicle on loopback sockets, for tests of links, station and vehicle with real packets."""

from __future__ import annotations

import asyncio
import time

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.mavlink.station import MavlinkStation

PX4_HOLD, PX4_OFFBOARD, PX4_POSCTL = 4 << 16 | 3 << 24, 6 << 16, 3 << 16
PX4_TAKEOFF, PX4_MISSION, PX4_RETURN = 4 << 16 | 2 << 24, 4 << 16 | 4 << 24, 4 << 16 | 5 << 24
TICK_S = 0.02


class ScriptedVehicle(asyncio.DatagramProtocol):
    """Sends telemetry ten to fifty times a second, does what it is told at once, and writes everything down."""

    def __init__(self, autopilot=mavlink.MAV_AUTOPILOT_PX4, system_id=1, speed=1.0):
        self.autopilot, self.system_id, self.speed = autopilot, system_id, speed
        self.px4 = autopilot == mavlink.MAV_AUTOPILOT_PX4
        self.codec = mavlink.MAVLink(None, srcSystem=system_id, srcComponent=1)
        self.parser = mavlink.MAVLink(None)
        self.parser.robust_parsing = True
        self.mode = PX4_HOLD if self.px4 else 0
        self.armed = False
        self.status = 3
        self.height = 0.0
        self.landed = 1
        self.mission = (0, 3, 2)
        self.results = {}
        self.mode_results = {}
        self.pre_arm = ""
        self.ready = None
        self.silent = False
        self.born = time.monotonic()
        self.heard = []
        self.transport = None
        self.remote = None
        self.task = None

    async def start(self, port, host="127.0.0.1"):
        loop = asyncio.get_running_loop()
        self.remote = (host, port)
        await loop.create_datagram_endpoint(lambda: self, local_addr=("127.0.0.1", 0))
        self.task = asyncio.ensure_future(self.live())
        return self

    async def stop(self):
        if self.task:
            self.task.cancel()
            await asyncio.gather(self.task, return_exceptions=True)
        if self.transport:
            self.transport.close()

    def connection_made(self, transport):
        self.transport = transport

    def datagram_received(self, data, address):
        for message in self.parser.parse_buffer(data) or []:
            self.heard.append((time.monotonic(), message))
            self.take(message)

    def of(self, kind):
        return [message for _, message in self.heard if message.get_type() == kind]

    def send(self, message):
        raw = message.pack(self.codec)
        self.codec.seq = (self.codec.seq + 1) % 256
        self.put(raw)

    def put(self, raw):
        if not self.silent:
            self.transport.sendto(raw, self.remote)

    @property
    def now_ms(self):
        return int((time.monotonic() - self.born) * self.speed * 1000)

    def heartbeat(self):
        base = 29 | (128 if self.armed else 0)
        self.send(mavlink.MAVLink_heartbeat_message(2, self.autopilot, base, self.mode, self.status, 3))

    def set_mode(self, mode):
        self.mode = mode
        self.heartbeat()

    async def live(self):
        count = 0
        while True:
            if count % 5 == 0:
                self.heartbeat()
                if self.ready is not None:
                    bit = mavlink.MAV_SYS_STATUS_PREARM_CHECK
                    health = bit if self.ready else 0
                    self.send(mavlink.MAVLink_sys_status_message(bit, bit, health, 0, 0, 0, 80, 0, 0, 0, 0, 0, 0))
                self.send(mavlink.MAVLink_extended_sys_state_message(0, self.landed))
                self.send(mavlink.MAVLink_mission_current_message(*self.mission))
                self.send(
                    mavlink.MAVLink_home_position_message(313622000, 1216155000, 4000, 0, 0, 0, [1, 0, 0, 0], 0, 0, 0)
                )
            self.send(mavlink.MAVLink_attitude_message(self.now_ms, 0, 0, 0, 0, 0, 0))
            self.send(mavlink.MAVLink_local_position_ned_message(self.now_ms, 0, 0, -self.height, 0, 0, 0))
            altitude = int(4000 + self.height * 1000)
            self.send(
                mavlink.MAVLink_global_position_int_message(self.now_ms, 313622000, 1216155000, altitude, 0, 0, 0, 0, 0)
            )
            count += 1
            await asyncio.sleep(TICK_S)

    def ack(self, command, result):
        self.send(mavlink.MAVLink_command_ack_message(command, result, 0, 0, 255, 190))

    def take(self, m):
        kind = m.get_type()
        if kind == "COMMAND_LONG" and m.target_system == self.system_id:
            self.command(m)
        elif kind == "MISSION_SET_CURRENT":
            self.mission = (m.seq, self.mission[1], 2)
        elif kind == "TIMESYNC" and m.tc1 == 0:
            self.send(mavlink.MAVLink_timesync_message(self.now_ms * 1_000_000, m.ts1))

    def command(self, m):
        result = self.results.get(m.command, 0)
        if m.command == 176:
            number = int(m.param2) << 16 | int(m.param3) << 24 if self.px4 else int(m.param2)
            result = self.mode_results.get(number, 0)
            if self.px4:
                self.ack(176, 0)
            self.ack(176, result)
            if result == 0:
                if number == PX4_MISSION:
                    self.mission = (self.mission[0], self.mission[1], 3)
                self.set_mode(number)
            return
        if m.command == 400 and self.pre_arm and m.param1:
            self.send(mavlink.MAVLink_statustext_message(2, self.pre_arm.encode(), 0, 0))
            result = 4
        self.ack(m.command, result)
        if result:
            return
        if m.command == 400:
            self.armed = bool(m.param1)
            self.heartbeat()
        elif m.command == 22:
            self.height, self.landed = m.param7 - (4.0 if self.px4 else 0.0), 2
            if self.px4:
                self.set_mode(PX4_TAKEOFF)
                self.set_mode(PX4_HOLD)
        elif m.command in (300, 193):
            state = 4 if m.command == 193 and m.param1 == 0 else 3
            self.mission = (1, self.mission[1], state)
        elif m.command == 512 and m.param1 == 148:
            uid2 = list(range(1, 13)) + [0] * 6
            self.send(
                mavlink.MAVLink_autopilot_version_message(
                    8192 | 16, 0, 0, 0, 0, [0] * 8, [0] * 8, [0] * 8, 0, 0, 77, uid2
                )
            )
        elif m.command == 512 and m.param1 == 49:
            self.send(mavlink.MAVLink_gps_global_origin_message(313622000, 1216155000, 4090, 0))


@pytest.fixture
async def station():
    station = MavlinkStation(lost_after_s=0.6)
    yield station
    await station.close_all()


@pytest.fixture
async def make_vehicle():
    made = []

    async def make(port, **options):
        vehicle = await ScriptedVehicle(**options).start(port)
        made.append(vehicle)
        return vehicle

    yield make
    for vehicle in made:
        await vehicle.stop()


@pytest.fixture
def connected(station, make_vehicle):
    """Opens a port, starts a scripted vehicle on it and waits until its state is known."""

    async def connect(**options):
        url = await station.open("udpin:127.0.0.1:0")
        scripted = await make_vehicle(int(url.rsplit(":", 1)[1]), **options)
        vehicle = await station.wait_for_vehicle(5.0)
        await vehicle.until(
            lambda: (
                vehicle.telemetry.local_position_m is not None
                and vehicle.telemetry.home is not None
                and vehicle.telemetry.mission is not None
                and vehicle.clock.known
            ),
            5.0,
            "its state",
        )
        return scripted, vehicle

    return connect


@pytest.fixture
def modes():
    return {
        "hold": PX4_HOLD,
        "offboard": PX4_OFFBOARD,
        "posctl": PX4_POSCTL,
        "mission": PX4_MISSION,
        "return": PX4_RETURN,
    }
