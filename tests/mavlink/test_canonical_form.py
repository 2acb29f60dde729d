"""Canonical forms against what real autopilots gave back (recorded), and against the measured table."""

from __future__ import annotations

import json
import math
import struct
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.core.mission import MissionItem
from gcs.core.vehicle import Autopilot
from gcs.mavlink.canonical_form import MOST_TOLD, canonical_item, compare
from gcs.mavlink.mission_protocol import item_from_message

RECORDS = Path(__file__).resolve().parents[2] / "../shared/records"
needs_records = pytest.mark.skipif(not RECORDS.is_dir(), reason="the recorded traffic is not here")

PX4, ARDUPILOT, GENERIC = Autopilot.PX4, Autopilot.ARDUPILOT, Autopilot.GENERIC


def item(command=16, frame=5, params=(0.0, 0.0, 0.0, 0.0), x=313622000, y=1216155000, z=12.0, sequence=1, auto=1):
    return MissionItem(sequence, frame, command, params, x, y, z, autocontinue=auto)


def packets(path: Path):
    raw = path.read_bytes()
    parser = mavlink.MAVLink(None)
    parser.robust_parsing = True
    place = 0
    while place + 8 < len(raw):
        place += 8
        size = 12 + raw[place + 1] + (13 if raw[place + 2] & 1 else 0) if raw[place] == 0xFD else 8 + raw[place + 1]
        yield from parser.parse_buffer(raw[place : place + size]) or []
        place += size


@needs_records
def test_every_item_that_px4_gave_back_is_what_it_was_sent():
    """The log has both directions: 47 uploads of different items, each read back."""
    sent, back, pairs = [], [], 0
    for message in packets(RECORDS / "px4/mission_items.tlog"):
        kind, station = message.get_type(), message.get_srcSystem() == 255
        if kind == "MISSION_COUNT":
            sent, back = ([], back) if station else (sent, [])
        elif kind == "MISSION_ITEM_INT":
            (sent if station else back).append(item_from_message(message))
            if not station and len(back) == len(sent):
                comparison = compare(sent, back, PX4)
                assert comparison.equal, comparison.summary
                pairs += 1
    assert pairs >= 40


@needs_records
def test_what_px4_gave_back_of_one_item_is_not_equal_to_another():
    lists, current = [], []
    for message in packets(RECORDS / "px4/mission_items.tlog"):
        if message.get_srcSystem() == 1 and message.get_type() == "MISSION_COUNT":
            current = []
            lists.append(current)
        elif message.get_srcSystem() == 1 and message.get_type() == "MISSION_ITEM_INT":
            current.append(item_from_message(message))
    distinct = {str(x): x for x in lists if len(x) == 4}
    forms = list(distinct.values())
    assert len(forms) > 30
    equal = sum(compare(a, b, PX4).equal for k, a in enumerate(forms) for b in forms[:k])
    assert equal == 0


ARDUPILOT_PARTS = {16, 18, 19, 20, 21, 22, 82, 93, 112, 114, 115, 177, 178, 195, 201, 203, 205, 206, 1000, 2000, 2001}


@needs_records
@pytest.mark.parametrize("command", sorted(ARDUPILOT_PARTS))
def test_ardupilot_commands_as_measured(command):
    """Every command was sent in frame 3 with 1 in param1 to param4, one place, and altitude 10."""
    tried = json.loads((RECORDS / "ardupilot/mission_protocol.json").read_text())["commands"]
    back = next(r["back"] for number, r in tried.values() if number == command)
    z = 2.0 if command == 205 else 10.0
    sent = item(command, 3, (1.0, 1.0, 1.0, 1.0), 313622898, 1216155526, z, sequence=back["seq"])
    got = MissionItem(
        back["seq"],
        back["frame"],
        command,
        (back["p1"], back["p2"], back["p3"], back["p4"]),
        back["x"],
        back["y"],
        back["z"],
        autocontinue=back["auto"],
    )
    home = item(sequence=0)
    comparison = compare([home, sent], [home, got], ARDUPILOT)
    assert comparison.equal, comparison.summary


@needs_records
@pytest.mark.parametrize("name", ["auto_mission.tlog", "auto_mission_camera.tlog"])
def test_forms_of_ardupilots_own_items_are_these_items(name):
    """What comes back is already in canonical form, so a mission that was read can be sent and compared again."""
    items = [item_from_message(m) for m in packets(RECORDS / "ardupilot" / name) if m.get_type() == "MISSION_ITEM_INT"]
    assert items
    for got in items:
        form = canonical_item(got, ARDUPILOT)
        assert (form.frame, form.params, form.x, form.y) == (got.frame, got.params, got.x, got.y)
        assert form.z == pytest.approx(got.z, abs=0.005)


@pytest.mark.parametrize(
    ("autopilot", "sent", "held"),
    [
        (ARDUPILOT, item(frame=6), item(frame=3)),
        (ARDUPILOT, item(frame=5), item(frame=0)),
        (ARDUPILOT, item(frame=11), item(frame=10)),
        (ARDUPILOT, item(93, 2, (1.5, -1, -1, -1), 0, 0, 0), item(93, 0, (1.5, -1, -1, -1), 0, 0, 0)),
        (ARDUPILOT, item(params=(2.9, 3, 4, math.nan)), item(params=(2.0, 0, 0, 0))),
        (ARDUPILOT, item(z=12.344), item(z=12.34)),
        (ARDUPILOT, item(auto=0), item(auto=1)),
        (ARDUPILOT, item(19, params=(3, 0, 0, 0)), item(19, 0, params=(3, 0, 1, 0))),
        (PX4, item(params=(1, 2, 3, 0)), item(params=(1, 2, 0, 0))),
        (PX4, item(params=(0, 0, 0, -90)), item(params=(0, 0, 0, 270))),
        (PX4, item(params=(0, 0, 0, 450)), item(params=(0, 0, 0, 89.9999771118164))),
        (PX4, item(params=(0, 0, 0, math.nan)), item(params=(0, 0, 0, math.nan))),
        (PX4, item(params=(0, 0, 0, 359.9999)), item(params=(0, 0, 0, 0))),
        (PX4, item(frame=0), item(frame=5)),
        (PX4, item(frame=3), item(frame=6)),
        (PX4, item(80, 6, (3, 0, 0, 0)), item(201, 6, (0, 0, 0, 0))),
        (GENERIC, item(frame=5), item(frame=0)),
        (GENERIC, item(), item(x=313621999, y=1216155001, z=12.000001)),
        (GENERIC, item(params=(0.1, 0, 0, 0)), item(params=(struct.unpack("<f", struct.pack("<f", 0.1))[0], 0, 0, 0))),
    ],
)
def test_same_to_the_vehicle(autopilot, sent, held):
    first = item(sequence=0)
    assert compare([first, sent], [first, held], autopilot).equal


@pytest.mark.parametrize("autopilot", [PX4, ARDUPILOT, GENERIC])
@pytest.mark.parametrize(
    "other",
    [
        item(frame=6),
        item(command=21),
        item(x=313622002),
        item(y=1216154998),
        item(z=12.03),
        item(params=(3.0, 0, 0, 0)),
    ],
)
def test_not_the_same(autopilot, other):
    first = item(sequence=0)
    comparison = compare([first, item()], [first, other], autopilot)
    assert not comparison.equal
    assert comparison.differences[0].startswith("item 1: ")


@pytest.mark.parametrize("other", [item(params=(0, 0, 0, 91)), item(params=(0, 0, 0, math.nan)), item(auto=0)])
def test_not_the_same_to_px4(other):
    assert not compare([item(params=(0, 0, 0, 90))], [other], PX4).equal


def test_item_0_of_ardupilot_is_not_compared_but_that_of_others_is():
    a, b = [item(sequence=0), item()], [item(sequence=0, x=1), item()]
    assert compare(a, b, ARDUPILOT).equal
    assert not compare(a, b, PX4).equal


def test_shorter_and_longer_lists_differ():
    a = [item(sequence=n) for n in range(4)]
    for autopilot in Autopilot:
        assert not compare(a, a[:3], autopilot).equal
        assert not compare(a[:3], a, autopilot).equal
        assert not compare(a, [], autopilot).equal


def test_summary_tells_some_and_counts_the_rest():
    a = [item(sequence=n) for n in range(20)]
    b = [item(sequence=n, z=50.0) for n in range(20)]
    assert f"and {20 - MOST_TOLD} more" in compare(a, b, PX4).summary


def test_forms_are_stable():
    for autopilot in Autopilot:
        for sent in (item(frame=6, params=(2.7, 1, 1, -400), z=3.14159), item(93, 2, (1.5, -1, -1, -1), 0, 0, 0.0)):
            once = canonical_item(sent, autopilot)
            assert canonical_item(once, autopilot) == once


def test_fingerprint_is_of_the_form_not_of_the_words():
    assert compare([item(frame=0)], [], PX4).canonical_crc32 == compare([item(frame=5)], [], PX4).canonical_crc32
    assert compare([item(z=1)], [], PX4).canonical_crc32 != compare([item(z=2)], [], PX4).canonical_crc32
