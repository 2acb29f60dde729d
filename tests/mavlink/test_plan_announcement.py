"""PLAN_ANNOUNCE: asked for on a bad link, and gone on without."""

from __future__ import annotations

import math
import struct

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.core.errors import OperationCancelled
from gcs.mavlink.plan_announcement import PlanAnnouncement

HASH = "ab" * 32


def acknowledgement(plan_hash):
    raw = struct.pack("<HB", 62475, 242) + plan_hash
    return mavlink.MAVLink_tunnel_message(255, 190, 0x8247, len(raw), list(raw.ljust(128, b"\0")))


class Knower:
    """A vehicle that knows replanning."""

    deadline = math.inf

    def __init__(self, clock) -> None:
        self.put = lambda message: None
        self.heard = []
        self.answer = True

    def hear(self, message) -> None:
        raw = bytes(message.payload)[: message.payload_length]
        assert raw[:3] == struct.pack("<HB", 62474, 63)
        assert (message.target_system, message.target_component) == (1, 0)
        self.heard.append(raw[3:])
        if self.answer:
            self.put(acknowledgement(raw[3:]))


def test_announcement_is_acknowledged(make_rig):
    rig = make_rig(Knower)
    announcement = PlanAnnouncement(HASH, 1, rig.send, rig.clock)
    rig.drive(announcement)
    assert announcement.result() is True
    assert rig.vehicle.heard == [bytes.fromhex(HASH)]


def test_announcement_is_repeated_on_a_bad_link(make_rig):
    rig = make_rig(Knower)
    rig.up.faults.drop = lambda m: rig.up.sent < 4
    announcement = PlanAnnouncement(HASH, 1, rig.send, rig.clock)
    rig.drive(announcement)
    assert announcement.result() is True
    assert rig.clock.now >= 103


def test_announcement_goes_on_without_after_five_times(make_rig):
    rig = make_rig(Knower)
    rig.vehicle.answer = False
    announcement = PlanAnnouncement(HASH, 1, rig.send, rig.clock)
    rig.drive(announcement)
    assert announcement.result() is False
    assert len(rig.vehicle.heard) == 5
    assert rig.clock.now - 100 == pytest.approx(5.0, abs=0.1)


def test_acknowledgement_of_another_plan_does_not_count(make_rig):
    rig = make_rig(Knower)
    rig.vehicle.answer = False
    rig.at.append((100.5, lambda: rig.down.put(acknowledgement(bytes(31) + b"\1"))))
    announcement = PlanAnnouncement(HASH, 1, rig.send, rig.clock)
    rig.drive(announcement)
    assert announcement.result() is False


def test_announcement_can_be_cancelled(make_rig):
    rig = make_rig(Knower)
    announcement = PlanAnnouncement(HASH, 1, rig.send, rig.clock)
    announcement.start()
    announcement.cancel()
    with pytest.raises(OperationCancelled):
        announcement.result()


@pytest.mark.parametrize("bad", ["", "abc", "ab" * 31, "zz" * 32])
def test_a_hash_that_is_none(make_rig, bad):
    rig = make_rig(Knower)
    with pytest.raises(ValueError, match=r"64 hex digits|hexadecimal"):
        PlanAnnouncement(bad, 1, rig.send, rig.clock)
