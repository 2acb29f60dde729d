"""PLAN_ANNOUNCE: asked for on a bad link, and gone on without; by a companion that is to fly, it has to be answered."""

from __future__ import annotations

import math
import struct

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.core.errors import LinkError, OperationCancelled, RefusedError
from gcs.mavlink.companion_lease import COMPANION, LeaseStatus, lease_status_message
from gcs.mavlink.framing import FramePacker, FrameParser
from gcs.mavlink.plan_announcement import (
    CompanionAnnouncement,
    PlanAnnouncement,
    announced_plan,
    plan_not_ready_message,
    plan_ready_message,
)

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


def heard(message, sender=(1, COMPANION)):
    """A message as it comes out of a link."""
    (received,) = FrameParser().feed(FramePacker(*sender).pack(message))
    return received


class Exchange:
    """A station that announces a plan to a companion, on fake time."""

    def __init__(self):
        self.now, self.sent, self.said = 0.0, [], []
        self.announcement = CompanionAnnouncement(HASH, 1, self.sent.append, lambda: self.now, self.said.append)
        self.announcement.start()

    @property
    def finished(self):
        return self.announcement.finished

    def pass_time(self, seconds):
        end = self.now + seconds
        while not self.finished and self.announcement.deadline <= end:
            self.now = self.announcement.deadline
            self.announcement.on_time()
        self.now = end

    def tell(self, message, sender=(1, COMPANION)):
        self.announcement.handle(heard(message, sender))

    def failure(self, kind):
        with pytest.raises(kind) as error:
            self.announcement.result()
        return error.value.message


def test_a_companion_is_asked_until_it_holds_the_plan():
    exchange = Exchange()
    for _ in range(60):
        exchange.pass_time(1.0)
        exchange.tell(plan_not_ready_message(HASH, "makes it ready", refused=False))
    assert not exchange.finished
    assert exchange.said == ["companion: makes it ready"]
    assert len(exchange.sent) == 61
    assert {(m.target_system, m.target_component) for m in exchange.sent} == {(1, COMPANION)}
    assert {announced_plan(heard(m, (255, 190))) for m in exchange.sent} == {HASH}
    exchange.tell(plan_ready_message(HASH))
    assert exchange.announcement.result() is None


def test_only_the_companions_word_on_this_very_plan_counts():
    exchange = Exchange()
    exchange.tell(plan_ready_message(HASH), sender=(1, 1))  # the autopilot, which knows of plans too
    exchange.tell(plan_ready_message(HASH), sender=(2, COMPANION))
    exchange.tell(plan_ready_message("ac" + HASH[2:]))
    exchange.tell(plan_not_ready_message("ac" + HASH[2:], "no such plan", refused=True))
    exchange.tell(lease_status_message(LeaseStatus(plan_hash=HASH)))
    assert not exchange.finished
    exchange.pass_time(30.0)
    assert "restart" in exchange.failure(LinkError)


def test_a_companion_that_cannot_fly_the_plan_is_quoted():
    exchange = Exchange()
    text = "http://10.0.0.9:8080: the station does not answer: timed out"
    exchange.tell(plan_not_ready_message(HASH, text, refused=True))
    assert text in exchange.failure(RefusedError)


def test_without_a_companion_it_is_said_what_to_do():
    exchange = Exchange()
    exchange.pass_time(30.0)
    assert "start `gcs companion`" in exchange.failure(LinkError)


def test_preparing_for_ever_comes_to_an_end_with_its_last_words():
    exchange = Exchange()
    for _ in range(200):
        exchange.pass_time(1.0)
        if not exchange.finished:
            exchange.tell(plan_not_ready_message(HASH, "gets the plan", refused=False))
    assert "gets the plan" in exchange.failure(LinkError)
    assert len(exchange.sent) < 200
