"""The opaque plan id, against what a real PX4 answered and against the simulated one, which computes its own."""

from __future__ import annotations

import struct
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.core.mission import MissionItem
from gcs.core.vehicle import Autopilot
from gcs.mavlink.framing import FrameParser
from gcs.mavlink.mission_download import MissionDownload
from gcs.mavlink.mission_protocol import item_from_message
from gcs.mavlink.plan_id import px4_plan_id, told_plan_id

RECORDS = Path(__file__).resolve().parents[2] / "../shared/records/px4"


def recorded(path):
    """Messages of a telemetry log."""
    parser, data, at = FrameParser(), path.read_bytes(), 8
    while at < len(data):
        size = data[at + 1] + (12 if data[at] == 0xFD else 8) + (13 if data[at] == 0xFD and data[at + 2] & 1 else 0)
        yield from parser.feed(data[at : at + size])
        at += size + 8


@pytest.mark.skipif(not RECORDS.is_dir(), reason="no recorded traffic beside the project")
@pytest.mark.parametrize("log", ["mission_items.tlog", "dense/C_M_4m_r0.5.tlog", "dense/C_M_2m_r0.5.tlog"])
def test_a_real_px4_names_what_was_sent_by_the_same_id(log):
    sent: dict[int, MissionItem] = {}
    count, named = 0, 0
    for message in recorded(RECORDS / log):
        kind = message.get_type()
        if kind == "MISSION_COUNT" and message.get_srcSystem() == 255:
            sent, count = {}, message.count
        elif kind == "MISSION_ITEM_INT" and message.get_srcSystem() == 255:
            sent[message.seq] = item_from_message(message)
        elif kind == "MISSION_ACK" and message.get_srcSystem() != 255 and message.type == 0 and len(sent) == count > 0:
            assert told_plan_id(message) == px4_plan_id([sent[n] for n in range(count)])
            named += 1
    assert named


def ack(payload: bytes, *, version: int = 2):
    """A MISSION_ACK with a payload of any length."""
    crc_extra = mavlink.MAVLink_mission_ack_message.crc_extra
    head = bytes([len(payload), 0, 0, 0, 1, 1, 47, 0, 0]) if version == 2 else bytes([len(payload), 0, 1, 1, 47])
    crc = mavlink.x25crc(head + payload + bytes([crc_extra])).crc
    frame = bytes([0xFD if version == 2 else 0xFE]) + head + payload + struct.pack("<H", crc)
    (message,) = FrameParser().feed(frame)
    return message


def test_the_id_is_read_from_behind_the_fields_that_the_dialect_knows():
    assert told_plan_id(ack(bytes([255, 190, 0, 0]) + struct.pack("<I", 0x89ABD6B5))) == 0x89ABD6B5
    assert told_plan_id(ack(bytes([255, 190, 0, 0]) + b"\x05")) == 5, "zeros at its end are not sent"
    assert told_plan_id(ack(bytes([255, 190, 0, 0, 0, 0, 0, 0]))) is None
    assert told_plan_id(ack(bytes([255, 190]))) is None
    assert told_plan_id(ack(bytes([255, 190, 0]), version=1)) is None


ITEMS = tuple(MissionItem(n, 5, 16, (1.0, 0.5, 0.0, 33.0), 313622000 + n, -n, 10.5) for n in range(4))


@pytest.fixture
def naming(make_rig):
    """A vehicle that names its list, of which it holds the first so many items of ITEMS."""

    class WithId(mavlink.MAVLink_mission_count_message):
        opaque_id = 0

        def pack(self, mav, force_mavlink1=False):
            payload = self.unpacker.pack(self.count, self.target_system, self.target_component, self.mission_type)
            return self._pack(mav, self.crc_extra, payload + struct.pack("<I", self.opaque_id))

    def make(held, plan_id):
        rig = make_rig("px4")

        class Held:
            def __init__(self, item):
                self.__dict__.update(item.__dict__, p=item.params)

        rig.vehicle.store = [Held(item) for item in held]
        rig.ids = [plan_id]

        def named(message):
            if message.get_type() != "MISSION_COUNT":
                return [message]
            answer = WithId(255, 190, message.count, 0)
            answer.opaque_id = rig.ids[0] if len(rig.ids) == 1 else rig.ids.pop(0)
            return [answer]

        rig.vehicle.alter_out = named
        return rig

    return make


def read(rig, known=ITEMS):
    download = MissionDownload(1, 1, rig.send, rig.clock, autopilot=Autopilot.PX4, known=known, own_system=255)
    rig.drive(download)
    return download


def test_a_list_that_the_vehicle_names_is_not_read(naming):
    rig = naming(ITEMS, px4_plan_id(ITEMS))
    download = read(rig)
    assert download.recognised
    assert download.result() == ITEMS
    assert rig.up.sent == 2, "more than the question and the end was sent"
    rig.pass_time(0.1)
    assert rig.vehicle.state == "idle"


@pytest.mark.parametrize("known", [ITEMS[:3], (*ITEMS[:3], MissionItem(3, 5, 16, (1.0,) * 4, 0, 0, 0.0)), None])
def test_another_number_or_another_id_is_read(naming, known):
    rig = naming(ITEMS, px4_plan_id(ITEMS))
    download = read(rig, known)
    assert not download.recognised
    assert [i.x for i in download.result()] == [i.x for i in ITEMS]


def test_an_id_without_its_items_is_no_proof(naming):
    rig = naming(ITEMS[:2], px4_plan_id(ITEMS))
    download = read(rig)
    assert not download.recognised
    assert len(download.result()) == 2


def test_a_list_whose_id_changes_while_it_is_read_is_read_anew(naming):
    rig = naming(ITEMS, 7)
    rig.ids = [7, 8, 8]
    asked = []
    rig.vehicle.before_in = lambda m: asked.append(m.get_type())
    assert len(read(rig).result()) == 4
    assert asked.count("MISSION_REQUEST_LIST") == 4, "asked, changed, asked anew, the same"
