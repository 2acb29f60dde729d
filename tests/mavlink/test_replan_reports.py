"""Replanning reports: packed here a second time from their description, so that both readings of it are compared."""

from __future__ import annotations

import hashlib
import math
import random
import struct

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.core.frames import GeoPoint
from gcs.core.replanning import ReplanReason, ReplanReport, SeenObstacle, ViewpointChange, ViewpointFate
from gcs.mavlink.replan_messages import hash_after, report_messages, thinned
from gcs.mavlink.report_assembler import AnsweredReport, MalformedReport, ReportAssembler, ReportStatus, report_ack
from gcs.mavlink.tunnel_carrier import carried, replanning, tunnelled

PLAN = bytes(range(32))
PLACE = (313622000, 1216155000, 12.0)
NO_OBSTACLE = (0, 0, 0.0, math.nan, 0.0, 0.0)


def message(number, extra, body):
    raw = struct.pack("<HB", number, extra) + body.rstrip(b"\0")
    return carried(mavlink.MAVLink_tunnel_message(0, 0, 0x8247, len(raw), list(raw.ljust(128, b"\0"))))


def packed(
    points=5,
    viewpoints=(),
    boot=77,
    number=1,
    reason=1,
    times=(12500, 20250),
    place=PLACE,
    obstacle=NO_OBSTACLE,
    after=None,
    told=None,
):
    rows = [(place[0] + n, place[1], place[2]) for n in range(points)]
    geometry = struct.pack("<HH", points, len(viewpoints))
    geometry += b"".join(struct.pack("<iif", *row) for row in rows)
    geometry += b"".join(struct.pack("<HBiif", *v) for v in viewpoints)
    after = hashlib.sha256(PLAN + geometry).digest() if after is None else after
    counts = (points, len(viewpoints)) if told is None else told
    head = struct.pack("<IIIiiffff", boot, *times, *obstacle) + struct.pack("<HhHH", number, 4, *counts)
    out = [message(62470, 153, head + PLAN + after + bytes([reason]))]
    for first in range(0, points, 9):
        some = rows[first : first + 9]
        columns = [c for column in zip(*(some + [(0, 0, 0.0)] * (9 - len(some))), strict=True) for c in column]
        out.append(message(62471, 128, struct.pack("<I9i9i9fHHB", boot, *columns, number, first, len(some))))
    for first in range(0, len(viewpoints), 6):
        some = viewpoints[first : first + 6]
        ids, fates, *place3 = zip(*(list(some) + [(0, 0, 0, 0, 0.0)] * (6 - len(some))), strict=True)
        floats = [c for column in place3 for c in column]
        body = struct.pack("<I6i6i6fHH6HB6B", boot, *floats, number, first, *ids, len(some), *fates)
        out.append(message(62472, 128, body))
    return out


def take_all(assembler, messages):
    return [r for m in messages if (r := assembler.take(m)) is not None]


CHANGES = [(4, 1, 0, 0, 0.0), (9, 2, *PLACE)] + [(20 + n, 1, 0, 0, 0.0) for n in range(7)]


@pytest.mark.parametrize("points", [0, 1, 9, 10, 400])
def test_a_report_in_any_order(points):
    seen = (313622100, 1216155100, 3.5, 0.75, -1.5, 0.25)
    messages = packed(points, CHANGES, reason=2, obstacle=seen)
    assert len(messages) == 1 + math.ceil(points / 9) + 2
    random.Random(points).shuffle(messages)
    (report,) = take_all(ReportAssembler(), messages)
    place = GeoPoint(31.3622, 121.6155, 12.0)
    assert (report.boot_id, report.number, report.plan_hash) == (77, 1, PLAN.hex())
    assert (report.reason, report.mission_item) == (ReplanReason.MOVING_OBSTACLE, 4)
    assert (report.left_at_s, report.rejoined_at_s) == (12.5, 20.25)
    assert report.obstacle == SeenObstacle(GeoPoint(31.36221, 121.61551, 3.5), 0.75, (-1.5, 0.25))
    assert report.path == tuple(GeoPoint((313622000 + n) / 1e7, 121.6155, 12.0) for n in range(points))
    assert report.viewpoints[:2] == (
        ViewpointChange(4, ViewpointFate.SKIPPED, None),
        ViewpointChange(9, ViewpointFate.MOVED, place),
    )
    assert len(report.viewpoints) == 9


def test_what_was_not_joined_again_has_no_time_of_it():
    (report,) = take_all(ReportAssembler(), packed(times=(100, 0xFFFFFFFF)))
    assert report.rejoined_at_s is None
    assert report.obstacle is None


def test_our_messages_are_those_of_the_description():
    path = tuple(GeoPoint((313622000 + n) / 1e7, 121.6155, 12.0) for n in range(30))
    moved = ViewpointChange(9, ViewpointFate.MOVED, GeoPoint(31.3622, 121.6155, 12.0))
    changes = (ViewpointChange(4, ViewpointFate.SKIPPED, None), moved)
    after = hash_after(PLAN.hex(), path, changes)
    ours = ReplanReport(77, 1, PLAN.hex(), after, ReplanReason.HELD, 4, 12.5, 20.25, None, path, changes)
    theirs = packed(30, CHANGES[:2], reason=3)
    sent = [carried(tunnelled(m, 0, 0)) for m in report_messages(ours)]
    assert [str(m) for m in sent] == [str(m) for m in theirs]
    assert take_all(ReportAssembler(), report_messages(ours)) == [ours]


def test_lost_and_doubled_messages_are_made_up_by_the_next_sending():
    rng = random.Random(1)
    assembler, messages, got = ReportAssembler(), packed(100, CHANGES), []
    for _ in range(20):
        sending = [m for m in messages * 2 if rng.random() < 0.3]
        rng.shuffle(sending)
        got += take_all(assembler, sending)
    assert got
    assert all(r == got[0] for r in got)


def test_a_report_is_given_out_until_it_is_answered_and_its_answer_is_repeated_after_that():
    assembler, messages = ReportAssembler(), packed(30)
    assert len(take_all(assembler, messages * 2)) == 2
    assembler.answered(77, 1, ReportStatus.STORED)
    assert take_all(assembler, messages * 2) == [AnsweredReport(77, 1, ReportStatus.STORED)] * 2
    assert assembler._open == {}


def test_reports_and_boots_are_kept_apart():
    assembler = ReportAssembler()
    a, b, c = packed(60, boot=1), packed(50, boot=2), packed(60, boot=1, number=2)
    mixed = [m for messages in zip(a[:6], b[:6], c[:6], strict=True) for m in messages] + a[6:] + b[6:] + c[6:]
    assert {(r.boot_id, r.number, len(r.path)) for r in take_all(assembler, mixed)} == {
        (1, 1, 60),
        (2, 1, 50),
        (1, 2, 60),
    }


@pytest.mark.parametrize(
    ("messages", "problem"),
    [
        (packed(after=bytes(32)), "hash"),
        (packed(times=(30, 20)), "ends before"),
        (packed(reason=0), "no reason"),
        (packed(reason=9), "no reason"),
        (packed(place=(900_000_001, 0, 1.0)), "place"),
        (packed(place=(0, -1_800_000_001, 1.0)), "place"),
        (packed(place=(0, 0, math.inf)), "place"),
        (packed(viewpoints=[(1, 3, *PLACE)]), "fate"),
        (packed(viewpoints=[(1, 2, 0, 0, math.nan)]), "place"),
        (packed(obstacle=(0, 0, 0.0, -1.0, 0.0, 0.0)), "obstacle"),
        (packed(obstacle=(0, 0, 0.0, 1.0, math.inf, 0.0)), "obstacle"),
        (packed(obstacle=(0, 0, math.inf, 1.0, 0.0, 0.0)), "place"),
        (packed(told=(401, 0)), "too many"),
        (packed(told=(5, 2001)), "too many"),
    ],
)
def test_malformed_reports_are_refused_not_believed(messages, problem):
    (report,) = take_all(ReportAssembler(), messages)
    assert isinstance(report, MalformedReport)
    assert (report.boot_id, report.number) == (77, 1)
    assert problem in report.problem


def test_what_belongs_to_no_report_is_ignored():
    assembler = ReportAssembler()
    assert take_all(assembler, packed(number=0)) == []
    assert assembler.take(replanning.MAVLink_replan_ack_message(77, 1, 0)) is None
    assert assembler._open == {}


def test_memory_is_bounded():
    assembler = ReportAssembler()
    for boot in range(1, 3000):
        assembler.take(packed(9, boot=boot)[1])
        assembler.answered(boot, 2, ReportStatus.STORED)
    for first in range(0, 65536, 9):
        assembler.take(replanning.MAVLink_replan_piece_message(1, 1, first, 9, [0] * 9, [0] * 9, [0.0] * 9))
    assert len(assembler._open) <= 16
    assert len(assembler._answers) <= 256
    assert max(len(a.points) for a in assembler._open.values()) <= 400
    assert len(take_all(assembler, packed(60, boot=9, number=9))) == 1


def test_any_fields_are_survived():
    rng, assembler = random.Random(2), ReportAssembler()
    for _ in range(4000):
        number, extra, size = rng.choice([(62470, 153, 109), (62471, 128, 117), (62472, 128, 99)])
        body = bytearray(rng.choice([0, 1, 255, rng.randrange(256)]) for _ in range(size))
        body[:4] = bytes([rng.randrange(3), 0, 0, 0])
        assembler.take(message(number, extra, bytes(body)))


def test_a_path_that_is_too_long_is_thinned_and_keeps_its_ends():
    path = tuple(GeoPoint(31.0 + k * 1e-6, 121.0, 5.0) for k in range(1234))
    long = ReplanReport(1, 1, PLAN.hex(), PLAN.hex(), ReplanReason.HELD, -1, 1.0, 2.0, None, path, ())
    short = thinned(long)
    assert len(short.path) == 400
    assert (short.path[0], short.path[-1]) == (path[0], path[-1])
    assert thinned(short) is short


@pytest.mark.parametrize("status", list(ReportStatus))
def test_acknowledgement_goes_to_whichever_component_reported(status):
    ack = report_ack(77, 3, status, 5)
    assert (ack.target_system, ack.target_component) == (5, 0)
    inner = carried(ack)
    assert (inner.get_type(), inner.boot_id, inner.number, inner.status) == ("REPLAN_ACK", 77, 3, status)
