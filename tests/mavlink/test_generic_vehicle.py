"""A vehicle that is neither autopilot: missions go up and come down, all else is refused with one clear error."""

from __future__ import annotations

import asyncio
import contextlib
import time

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.core.errors import RefusedError
from gcs.core.mission import Mission, MissionItem
from gcs.core.vehicle import Autopilot, FlightMode, VehicleIdentity
from gcs.mavlink.framing import FrameParser
from gcs.mavlink.heartbeats import autopilot_of
from gcs.mavlink.vehicle import Vehicle
from gcs.mavlink.vehicle_channel import VehicleChannel

ITEMS = tuple(
    MissionItem(k, 3, 16, (0.0, 0.0, 0.0, 0.0), 313622000 + 100 * k, 1216155000, 10.0 + k, int(k == 0))
    for k in range(30)
)


class Responder:
    """Takes missions as the protocol's own description has it, and answers nothing else."""

    def __init__(self):
        self.store, self.arriving, self.commands = [], None, []
        self.vehicle = Vehicle(
            VehicleIdentity(7, 1, Autopilot.GENERIC, 2),
            VehicleChannel((7, 1), (255, 190), self.hear, time.monotonic),
            lost_after_s=1e9,
        )
        self._packer = mavlink.MAVLink(None, srcSystem=7, srcComponent=1)
        self._parser = FrameParser()

    def say(self, message):
        for heard in self._parser.feed(message.pack(self._packer)):
            asyncio.get_running_loop().call_soon(self.vehicle.handle, heard, time.monotonic())

    def hear(self, message):
        kind, m = message.get_type(), mavlink
        if kind == "MISSION_COUNT":
            self.arriving = [None] * message.count
            self.say(m.MAVLink_mission_request_int_message(255, 190, 0, 0))
        elif kind == "MISSION_ITEM_INT" and self.arriving is not None:
            self.arriving[message.seq] = message
            if message.seq + 1 < len(self.arriving):
                self.say(m.MAVLink_mission_request_int_message(255, 190, message.seq + 1, 0))
            else:
                self.store, self.arriving = self.arriving, None
                self.say(m.MAVLink_mission_ack_message(255, 190, 0, 0))
        elif kind == "MISSION_REQUEST_LIST":
            self.say(m.MAVLink_mission_count_message(255, 190, len(self.store), 0))
        elif kind == "MISSION_REQUEST_INT":
            i = self.store[message.seq]
            place = (i.param1, i.param2, i.param3, i.param4, i.x, i.y, i.z, 0)
            self.say(m.MAVLink_mission_item_int_message(255, 190, i.seq, i.frame, i.command, 0, 1, *place))
        elif not kind.startswith("MISSION_"):
            self.commands.append(kind)


async def test_missions_go_up_and_come_down():
    responder = Responder()
    proof = await responder.vehicle.upload_mission(Mission(ITEMS))
    assert proof.items_read == 30
    assert [i.x for i in await responder.vehicle.download_mission()] == [i.x for i in ITEMS]
    assert responder.commands == []


@pytest.mark.parametrize(
    "command",
    [
        lambda v: v.start_mission(),
        lambda v: v.pause(),
        lambda v: v.resume_mission(),
        lambda v: v.return_home(),
        lambda v: v.retrace(),
        lambda v: v.land(),
        lambda v: v.take_off(20.0),
        lambda v: v.set_mode(FlightMode.HOLD),
        lambda v: v.wait_ready_to_arm(1.0),
        lambda v: v.disarm(),
        lambda v: v.set_current(1),
        lambda v: v.point_gimbal(0.0),
        lambda v: v.take_picture(),
        lambda v: v.offboard("test", take_off_altitude_amsl_m=20.0),
        lambda v: v.set_parameter("ANY", 1.0),
        lambda v: v.set_return_altitude(30.0),
    ],
)
async def test_everything_else_is_refused_with_one_error_and_nothing_is_sent(command):
    responder = Responder()
    with pytest.raises(RefusedError, match="neither PX4 nor ArduPilot") as caught:
        await command(responder.vehicle)
    assert caught.value.field == "generic-7"
    assert responder.commands == []


async def test_its_failsafes_are_none_that_are_known():
    responder = Responder()
    assert await responder.vehicle.read_failsafes() == ()
    limits = await responder.vehicle.read_limits()
    assert limits.max_speed_m_s is None


@pytest.mark.parametrize(("number", "autopilot"), [(12, "px4"), (3, "ardupilot"), (0, "generic"), (1, "generic")])
def test_autopilots_are_told_apart_by_their_heartbeat(number, autopilot):
    assert autopilot_of(mavlink.MAVLink_heartbeat_message(2, number, 0, 0, 3, 3)).value == autopilot


async def test_a_flight_cannot_be_streamed_and_its_lease_stays_free():
    responder = Responder()
    for _ in range(2):
        with contextlib.suppress(RefusedError):
            await responder.vehicle.offboard("test", take_off_altitude_amsl_m=20.0)
    assert responder.vehicle.offboard_session is None
