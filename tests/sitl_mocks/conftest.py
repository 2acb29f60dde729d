"""A ground side for simulated vehicles: real packets both ways, no sockets, time that only the test moves."""

from __future__ import annotations

import math
from concurrent.futures import Future

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.core.frames import GeoPoint
from sitl_mocks.ardupilot import ArduPilotVehicle
from sitl_mocks.channel import Channel
from sitl_mocks.mission_world import MissionWorld, WorldSpec
from sitl_mocks.px4 import Px4Vehicle
from sitl_mocks.vehicle_options import VehicleOptions

ANCHOR = GeoPoint(31.3622, 121.6155, 4.0)
HOME = GeoPoint(31.36201962, 121.61528979, 4.0)
NAN = math.nan


class Ground:
    """A ground station of a few lines, with its own packer and parser."""

    def __init__(self, cls, system=255, component=190, vehicle=None, **options):
        self.pictures = 0
        self.vehicle = vehicle or cls(VehicleOptions(1, ANCHOR, HOME, self._draw, **options))
        self.heard = []
        self._parser = mavlink.MAVLink(None)
        self._parser.robust_parsing = True
        self._packer = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
        self.channel = Channel(self.vehicle.system_id, self._take)
        self.vehicle.add_channel(self.channel)
        self.wall_s = 100.0
        self.listening = True

    def second(self, system=254, component=190):
        """Another station on a link of its own."""
        return Ground(None, system, component, self.vehicle)

    def _draw(self, exposure):
        self.pictures += 1
        done = Future()
        done.set_result(b"picture %d " % exposure.index * 200)
        return done

    def _take(self, packet):
        if self.listening:
            self.heard += self._parser.parse_buffer(packet) or []

    def send(self, message):
        """Send, and return what comes back at once."""
        start = len(self.heard)
        packet = message.pack(self._packer)
        self._packer.seq = (self._packer.seq + 1) % 256
        for m in self.channel.receive(bytes(packet)):
            self.vehicle.handle(m, self.channel)
        return self.heard[start:]

    def run(self, seconds, speedup=1.0, heartbeats=True):
        """Let time pass; returns what was heard meanwhile."""
        start = len(self.heard)
        for i in range(round(seconds / 0.02)):
            if heartbeats and i % 50 == 0:
                self.heartbeat()
            self.wall_s += 0.02 / speedup
            self.vehicle.step(0.02, self.wall_s)
        return self.heard[start:]

    def run_until(self, condition, seconds=120.0, **kwargs):
        """Let time pass until something is so; fails when it never is."""
        start = len(self.heard)
        for _ in range(round(seconds / 0.2)):
            if condition():
                return self.heard[start:]
            self.run(0.2, **kwargs)
        raise AssertionError(f"not within {seconds} s: {condition}")

    def heartbeat(self, kind=mavlink.MAV_TYPE_GCS):
        self.send(mavlink.MAVLink_heartbeat_message(kind, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 0, 3))

    def of(self, kind, messages=None):
        return [m for m in (self.heard if messages is None else messages) if m.get_type() == kind]

    def texts(self):
        return [m.text for m in self.of("STATUSTEXT")]

    def command(self, number, *params, component=1):
        """The results of all COMMAND_ACKs that come at once."""
        full = [*params, *[0.0] * (7 - len(params))]
        answers = self.send(mavlink.MAVLink_command_long_message(1, component, number, 0, *full))
        return [m.result for m in self.of("COMMAND_ACK", answers)]

    def set_mode(self, main, sub=0):
        return self.command(mavlink.MAV_CMD_DO_SET_MODE, 1, main, sub)

    def arm(self):
        return self.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)

    @staticmethod
    def item(seq, frame, command, params=(0.0, 0.0, 0.0, NAN), north=0.0, east=0.0, z=10.0, current=0, **fields):
        """An item at a place in metres about the anchor."""
        x = fields.get("x", round((ANCHOR.latitude_deg + north / 110_863.0) * 1e7))
        y = fields.get("y", round((ANCHOR.longitude_deg + east / 95_135.0) * 1e7))
        return mavlink.MAVLink_mission_item_int_message(1, 1, seq, frame, command, current, 1, *params, x, y, z, 0)

    def upload(self, items, seconds=10.0):
        """Answer the vehicle's requests until it acknowledges; returns the result and the requests."""
        start = len(self.heard)
        requests = []
        self.send(mavlink.MAVLink_mission_count_message(1, 1, len(items), 0))
        for _ in range(round(seconds / 0.02)):
            fresh, start = self.heard[start:], len(self.heard)
            for message in fresh:
                kind = message.get_type()
                if kind in {"MISSION_REQUEST", "MISSION_REQUEST_INT"}:
                    requests.append((kind, message.seq))
                    self.send(items[message.seq])
                elif kind == "MISSION_ACK":
                    return message.type, requests
            if len(self.heard) == start:
                self.run(0.02)
        raise AssertionError("no MISSION_ACK")

    def download(self):
        (count,) = self.of("MISSION_COUNT", self.send(mavlink.MAVLink_mission_request_list_message(1, 1, 0)))
        items = []
        for seq in range(count.count):
            answer = self.send(mavlink.MAVLink_mission_request_int_message(1, 1, seq, 0))
            items += self.of("MISSION_ITEM_INT", answer)
            items[-1].target_system = items[-1].target_component = 1  # so that it can be sent back
        self.send(mavlink.MAVLink_mission_ack_message(1, 1, 0, 0))
        return items

    def parameter(self, name):
        """(value as it travels, type) of a parameter; None when no answer comes."""
        answer = self.of("PARAM_VALUE", self.send(mavlink.MAVLink_param_request_read_message(1, 1, name.encode(), -1)))
        return (answer[0].param_value, answer[0].param_type) if answer else None

    def setpoint(self, position, velocity=(0, 0, 0), acceleration=(0, 0, 0), yaw=0.0, mask=0x800, frame=1):
        """SET_POSITION_TARGET_LOCAL_NED; everything north, east, down."""
        return self.send(
            mavlink.MAVLink_set_position_target_local_ned_message(
                0, 1, 1, frame, mask, *map(float, position), *map(float, velocity), *map(float, acceleration), yaw, 0.0
            )
        )

    def in_air(self, height=10.0):
        """Take off by command; returns when the height is held."""
        vehicle = self.vehicle
        if vehicle.kind == "px4":
            assert self.arm() == [0]
            assert self.command(mavlink.MAV_CMD_NAV_TAKEOFF, NAN, 0, 0, NAN, NAN, NAN, HOME.altitude_m + height) == [0]
        else:
            assert self.set_mode(4) == [0]
            assert self.arm() == [0]
            assert self.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, height) == [0]
        self.run_until(lambda: vehicle.airframe.height_m > height - 0.3)
        self.run(2.0)
        return self


_PLAN = {
    "px4": [(5, 22 if n == 0 else 16, 0.0, 0.5, 0.0, 45.0, 313622000 + n, 1216155000, 20.25, 1) for n in range(5)],
    "ardupilot": [(0, 16, 0.0, 0.0, 0.0, 0.0, 313622000 + n, 1216155000, 20.25, 1) for n in range(5)],
}
_OLD = {
    kind: [(*row[:2], 0.0, 0.0, 0.0, 0.0, 313000000 + n, 1216000000, 90.0, 1) for n, row in enumerate([*rows, *rows])]
    for kind, rows in _PLAN.items()
}


class Naive:
    """A station of a few lines: answers requests, asks once a second for what does not come, believes nothing."""

    PLAN = _PLAN

    def __init__(self, kind, *faults, seed=1, **spec):
        plan, held = tuple(_PLAN[kind]), tuple(_OLD[kind])
        self.world = MissionWorld(WorldSpec(kind, faults, seed, spec.pop("loss", 0.0), plan, held, **spec))
        self.plan = plan
        self.packer = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
        self.parser = mavlink.MAVLink(None)
        self.parser.robust_parsing = True
        self.trace = []

    def exchange(self, message, seconds=1.0):
        """Send, and hear for some time; returns the messages."""
        heard, out, end = [], [bytes(message.pack(self.packer))], self.world.now_s + seconds
        while self.world.now_s < end:
            _, packets = self.world.pass_time(end, out)
            out = []
            for m in (m for p in packets for m in self.parser.parse_buffer(p) or []):
                self.trace.append((round(self.world.now_s, 3), bytes(m.get_msgbuf())))
                heard.append(m)
                if m.get_type().startswith("MISSION_REQUEST") and m.mission_type == 0 and m.seq < len(self.plan):
                    frame, command, *params, x, y, z, auto = self.plan[m.seq]
                    item = mavlink.MAVLink_mission_item_int_message(
                        1, 1, m.seq, frame, command, 0, auto, *params, x, y, z, 0
                    )
                    out.append(bytes(item.pack(self.packer)))
        return heard

    def upload(self):
        self.exchange(mavlink.MAVLink_mission_count_message(1, 1, len(self.plan), 0), 2.0)
        return self

    def download(self):
        self.exchange(mavlink.MAVLink_mission_request_list_message(1, 1, 0))
        for n in range(3):
            self.exchange(mavlink.MAVLink_mission_request_int_message(1, 1, n, 0))
        return self


@pytest.fixture
def naive():
    """The class of a station that reads and writes a mission in a simulated world with faults."""
    return Naive


@pytest.fixture
def make_ground():
    """Makes a ground side with a vehicle that is ready to arm; `kind` is px4 or ardupilot."""

    def make(kind, ready=True, **options):
        ground = Ground({"px4": Px4Vehicle, "ardupilot": ArduPilotVehicle}[kind], **options)
        ground.heartbeat()
        if ready:
            ground.run(3.0)
        return ground

    return make


@pytest.fixture
def px4(make_ground):
    return make_ground("px4")


@pytest.fixture
def ardupilot(make_ground):
    return make_ground("ardupilot")


@pytest.fixture(params=["px4", "ardupilot"])
def either(request, make_ground):
    return make_ground(request.param)
