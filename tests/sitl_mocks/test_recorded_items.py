"""What becomes of mission items on the simulated vehicles, against every upload and read-back that was recorded."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path

import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from sitl_mocks.ardupilot_items import ardupilot_item
from sitl_mocks.mission_items import ItemRefused, StoredItem, item_of_message, px4_item

RECORDS = Path(__file__).resolve().parents[2] / "../shared/records"
ARDUPILOT_ANSWERS = RECORDS / "ardupilot/mission_protocol.json"
PX4_LOG = RECORDS / "px4/mission_items.tlog"
GIVEN = StoredItem(6, 16, (1.0, 1.0, 1.0, 1.0), 313_622_898, 1_216_155_526, 10.0)
"""What ArduPilot was given of each command."""


def kept(keep, item):
    """(MAV_MISSION_RESULT, what is kept)."""
    try:
        return 0, keep(item)
    except ItemRefused as refusal:
        return refusal.result, None


def ardupilot_answers():
    if not ARDUPILOT_ANSWERS.is_file():
        return []
    commands = json.loads(ARDUPILOT_ANSWERS.read_text(encoding="utf-8"))["commands"]
    return [
        pytest.param(number, answer, id=name.removeprefix("MAV_CMD_")) for name, (number, answer) in commands.items()
    ]


@pytest.mark.parametrize(("command", "answer"), ardupilot_answers())
def test_ardupilot_answers_every_command_as_recorded(command, answer):
    result, item = kept(ardupilot_item, replace(GIVEN, command=command))
    assert result == getattr(mavlink, f"MAV_MISSION_{answer['r']}")
    if item is not None:
        assert item == recorded_item(answer["back"])


def recorded_item(back):
    params = tuple(back[f"p{k}"] for k in range(1, 5))
    return StoredItem(back["frame"], back["cmd"], params, back["x"], back["y"], back["z"], back["cur"], back["auto"])


@pytest.mark.skipif(not PX4_LOG.is_file(), reason="needs the recorded traffic")
def test_px4_answers_and_keeps_every_upload_as_recorded():
    uploads = list(recorded_uploads(PX4_LOG))
    assert len(uploads) > 90
    for sent, result, back in uploads:
        answers = [kept(px4_item, item) for item in sent]
        assert next((r for r, _ in answers if r), 0) == result, sent
        for (_, mine), theirs in zip(answers, back, strict=False):
            same(mine, theirs)


def same(mine, theirs):
    assert (mine.frame, mine.command, mine.autocontinue) == (theirs.frame, theirs.command, theirs.autocontinue)
    assert (mine.x, mine.y) == pytest.approx((theirs.x, theirs.y), abs=1)
    for a, b in zip((*mine.params, mine.z), (*theirs.params, theirs.z), strict=True):
        assert a == pytest.approx(b, abs=1e-3, nan_ok=True) or math.isclose(a % 360.0, b % 360.0, abs_tol=1e-3)


def recorded_uploads(path):
    """(items that were sent, MAV_MISSION_RESULT, items that were read back) of each upload in a log of both sides."""
    log = mavutil.mavlink_connection(str(path))
    sent, result, back = {}, None, {}
    while (message := log.recv_match()) is not None:
        kind, vehicle = message.get_type(), message.get_srcSystem() == 1
        if kind == "MISSION_COUNT" and not vehicle:
            if result is not None:
                yield list(sent.values()), result, list(back.values())
            sent, result, back = {}, None, {}
        elif kind == "MISSION_ITEM_INT":
            (back if vehicle else sent)[message.seq] = item_of_message(message)
        elif kind == "MISSION_ACK" and vehicle and result is None:
            result = message.type
    log.close()
    if result is not None:
        yield list(sent.values()), result, list(back.values())
