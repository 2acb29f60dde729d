"""Replanning reports: encoded here a second time from their description, so that both readings of it are compared."""

from __future__ import annotations

import math
import random
import struct
import zlib

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.core.errors import OperationCancelled
from gcs.core.vehicle import ReplanReport
from gcs.mavlink.replan_tunnel import (
    MalformedReport,
    PlanAnnouncement,
    ReportAssembler,
    ReportStatus,
    decode_report,
    report_ack,
    split_payload,
)

TYPE = 0x8247


def body(points=5, reason="crane moved", item=4, left=12.5, back=20.25, crc=None, place=(313622000, 1216155000, 12.0)):
    out = bytes(range(32)) + struct.pack("<hdd", item, left, back)
    text = reason if isinstance(reason, bytes) else reason.encode()
    out += bytes([len(text)]) + text + struct.pack("<H", points)
    out += b"".join(struct.pack("<iif", place[0] + n, place[1], place[2]) for n in range(points))
    return out + struct.pack("<I", zlib.crc32(out) if crc is None else crc)


def fragments(raw, boot=77, number=1, size=116):
    pieces = [raw[k : k + size] for k in range(0, len(raw), size)]
    return [
        tunnel(struct.pack("<2sBBIHBB", b"GR", 1, 1, boot, number, k, len(pieces)) + p) for k, p in enumerate(pieces)
    ]


def tunnel(raw, payload_type=TYPE, length=None):
    return mavlink.MAVLink_tunnel_message(
        255, 190, payload_type, len(raw) if length is None else length, list(raw.ljust(128, b"\0"))
    )


def take_all(assembler, messages):
    return [r for m in messages if (r := assembler.take(m)) is not None]


@pytest.mark.parametrize("points", [2, 5, 60, 400])
def test_report_in_fragments_of_any_order(points):
    messages = fragments(body(points))
    random.Random(points).shuffle(messages)
    (report,) = take_all(ReportAssembler(), messages)
    assert report == ReplanReport(
        boot_id=77,
        number=1,
        plan_hash=bytes(range(32)).hex(),
        reason="crane moved",
        mission_item=4,
        left_at_s=12.5,
        rejoined_at_s=20.25,
        path=report.path,
    )
    assert len(report.path) == points
    assert report.path[1].latitude_deg == pytest.approx(31.3622001)
    assert report.path[1].altitude_m == 12.0


def test_lost_and_doubled_fragments_are_made_up_by_the_next_sending():
    rng = random.Random(1)
    assembler, messages, got = ReportAssembler(), fragments(body(100)), []
    for _ in range(20):
        sending = [m for m in messages * 2 if rng.random() < 0.5]
        rng.shuffle(sending)
        got += take_all(assembler, sending)
    assert got
    assert all(r == got[0] for r in got)


def test_a_report_that_comes_again_is_given_out_again_to_be_acknowledged():
    assembler = ReportAssembler()
    assert len(take_all(assembler, fragments(body()) * 3)) == 3


def test_reports_and_boots_are_kept_apart():
    assembler = ReportAssembler()
    a, b = fragments(body(60, "one"), 1, 1), fragments(body(60, "two"), 2, 1)
    mixed = [m for pair in zip(a, b, strict=True) for m in pair]
    assert [(r.boot_id, r.reason) for r in take_all(assembler, mixed)] == [(1, "one"), (2, "two")]


@pytest.mark.parametrize(
    "raw",
    [
        body(crc=1),
        body(points=1),
        body(reason="x" * 201),
        body(reason=b"\xff\xfe"),
        body(left=math.nan),
        body(left=30.0),
        body(left=-1.0),
        body(place=(900_000_001, 0, 1.0)),
        body(place=(0, -1_800_000_001, 1.0)),
        body(place=(0, 0, math.inf)),
        b"short",
        body()[:-8] + struct.pack("<I", zlib.crc32(body()[:-8])),
    ],
)
def test_malformed_bodies_are_refused_not_believed(raw):
    report = decode_report(7, 3, raw)
    assert isinstance(report, MalformedReport)
    assert (report.boot_id, report.number) == (7, 3)
    assert report.problem


@pytest.mark.parametrize(
    "raw",
    [
        b"",
        b"GR",
        struct.pack("<2sBBIHBB", b"XX", 1, 1, 1, 1, 0, 1) + b"a",
        struct.pack("<2sBBIHBB", b"GR", 2, 1, 1, 1, 0, 1) + b"a",
        struct.pack("<2sBBIHBB", b"GR", 1, 9, 1, 1, 0, 1) + b"a",
        struct.pack("<2sBBIHBB", b"GR", 1, 1, 1, 0, 0, 1) + b"a",
        struct.pack("<2sBBIHBB", b"GR", 1, 1, 1, 1, 3, 2) + b"a",
        struct.pack("<2sBBIHBB", b"GR", 1, 1, 1, 1, 0, 65) + b"a",
        struct.pack("<2sBBIHBB", b"GR", 1, 1, 1, 1, 0, 0) + b"a",
        struct.pack("<2sBBIHBB", b"GR", 1, 1, 1, 1, 0, 1),
    ],
)
def test_malformed_fragments_are_ignored(raw):
    assert ReportAssembler().take(tunnel(raw)) is None


def test_other_tunnels_and_lying_lengths_are_ignored():
    good = fragments(body(2))[0]
    assert ReportAssembler().take(tunnel(bytes(good.payload), payload_type=5)) is None
    assert ReportAssembler().take(tunnel(bytes(good.payload), length=255)) is None
    assert ReportAssembler().take(mavlink.MAVLink_heartbeat_message(2, 12, 0, 0, 0, 3)) is None


def test_memory_is_bounded():
    assembler = ReportAssembler()
    for number in range(1, 5000):
        assembler.take(fragments(body(60), number, 1)[0])
    assert len(assembler._open) <= 16
    assert len(take_all(assembler, fragments(body(60), 9, 9))) == 1


@given(st.binary(max_size=128), st.integers(0, 255))
def test_any_tunnel_is_survived(raw, length):
    assembler = ReportAssembler()
    for head in (b"", struct.pack("<2sBBIHBB", b"GR", 1, 1, 1, 1, 0, 1)):
        assembler.take(tunnel((head + raw)[:128], length=length))


@given(st.binary(max_size=600))
def test_any_body_is_survived(raw):
    decode_report(1, 1, raw + struct.pack("<I", zlib.crc32(raw)))


def test_reason_is_for_a_screen():
    assert decode_report(1, 1, body(reason="a\n\x1b[2Jb")).reason == "a  [2Jb"


@pytest.mark.parametrize("status", list(ReportStatus))
def test_acknowledgement_on_the_wire(status):
    message = report_ack(77, 3, status, 1, 1)
    assert (message.target_system, message.payload_type, message.payload_length) == (1, TYPE, 13)
    assert bytes(message.payload)[:13] == struct.pack("<2sBBIHBB", b"GR", 1, 2, 77, 3, 0, 1) + bytes([status])


class Knower:
    """A vehicle that knows replanning."""

    deadline = math.inf

    def __init__(self, clock) -> None:
        self.put = lambda message: None
        self.heard = []
        self.answer = True

    def hear(self, message) -> None:
        raw = bytes(message.payload)[: message.payload_length]
        assert raw[:12] == struct.pack("<2sBBIHBB", b"GR", 1, 3, 0, 0, 0, 1)
        self.heard.append(raw[12:])
        if self.answer:
            self.put(tunnel(struct.pack("<2sBBIHBB", b"GR", 1, 4, 0, 0, 0, 1) + raw[12:]))


HASH = "ab" * 32


def test_announcement_is_acknowledged(make_rig):
    rig = make_rig(Knower)
    announcement = PlanAnnouncement(HASH, 1, 1, rig.send, rig.clock)
    rig.drive(announcement)
    assert announcement.result() is True
    assert rig.vehicle.heard == [bytes.fromhex(HASH)]


def test_announcement_is_repeated_on_a_bad_link(make_rig):
    rig = make_rig(Knower)
    rig.up.faults.drop = lambda m: rig.up.sent < 4
    announcement = PlanAnnouncement(HASH, 1, 1, rig.send, rig.clock)
    rig.drive(announcement)
    assert announcement.result() is True
    assert rig.clock.now >= 103


def test_announcement_goes_on_without_after_five_times(make_rig):
    rig = make_rig(Knower)
    rig.vehicle.answer = False
    announcement = PlanAnnouncement(HASH, 1, 1, rig.send, rig.clock)
    rig.drive(announcement)
    assert announcement.result() is False
    assert len(rig.vehicle.heard) == 5
    assert rig.clock.now - 100 == pytest.approx(5.0, abs=0.1)


def test_acknowledgement_of_another_plan_does_not_count(make_rig):
    rig = make_rig(Knower)
    rig.vehicle.answer = False
    rig.at.append((100.5, lambda: rig.down.put(tunnel(struct.pack("<2sBBIHBB", b"GR", 1, 4, 0, 0, 0, 1) + bytes(32)))))
    announcement = PlanAnnouncement(HASH, 1, 1, rig.send, rig.clock)
    rig.drive(announcement)
    assert announcement.result() is False


def test_announcement_can_be_cancelled(make_rig):
    rig = make_rig(Knower)
    announcement = PlanAnnouncement(HASH, 1, 1, rig.send, rig.clock)
    announcement.start()
    announcement.cancel()
    with pytest.raises(OperationCancelled):
        announcement.result()


@pytest.mark.parametrize("bad", ["", "abc", "ab" * 31, "zz" * 32])
def test_a_hash_that_is_none(make_rig, bad):
    rig = make_rig(Knower)
    with pytest.raises(ValueError, match=r"64 hex digits|hexadecimal"):
        PlanAnnouncement(bad, 1, 1, rig.send, rig.clock)


def test_header_of_a_split_payload():
    header, part = split_payload(fragments(body(60))[1])
    assert (header.boot_id, header.number, header.fragment, header.fragments) == (77, 1, 1, 7)
    assert len(part) == 116
