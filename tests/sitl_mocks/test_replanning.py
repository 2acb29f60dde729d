"""The detour and its report, decoded here from docs/replan_report.md."""

import hashlib
import math
import struct

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.mavlink.report_assembler import ReportAssembler, ReportStatus, report_ack
from gcs.mavlink.tunnel_carrier import carried, replanning, tunnelled

NAN = math.nan
PLAN_HASH = bytes(range(32))
REPORT, PIECE, ACK = (62470, 153), (62471, 128), (62473, 228)
ANNOUNCE, ANNOUNCE_ACK = (62474, 63), (62475, 242)


def tunnels(messages, kind):
    """What the messages of a kind carry."""
    payloads = [bytes(m.payload)[: m.payload_length] for m in messages if m.get_type() == "TUNNEL"]
    return [p[3:] for p in payloads if struct.unpack_from("<HB", p) == kind]


def tunnel(kind, body):
    payload = struct.pack("<HB", *kind) + body
    return mavlink.MAVLink_tunnel_message(1, 1, 0x8247, len(payload), list(payload.ljust(128, b"\0")))


def acknowledgement(boot_id, number):
    return tunnel(ACK, struct.pack("<IHB", boot_id, number, 0).rstrip(b"\0"))


def decode(messages):
    """(boot id, number, hash, item, left, joined, reason, points) of the first report in what was heard."""
    head = tunnels(messages, REPORT)[0].ljust(109, b"\0")
    boot_id, left_ms, joined_ms = struct.unpack_from("<III", head)
    assert math.isnan(struct.unpack_from("<f", head, 24)[0])
    number, item, count, viewpoints = struct.unpack_from("<HhHH", head, 36)
    before, after, reason = head[44:76], head[76:108], head[108]
    assert viewpoints == 0
    points = {}
    for piece in tunnels(messages, PIECE):
        values = struct.unpack("<I9i9i9fHHB", piece.ljust(117, b"\0"))
        assert (values[0], values[28]) == (boot_id, number)
        for k in range(values[30]):
            points[values[29] + k] = (values[1 + k], values[10 + k], values[19 + k])
    rows = [points[k] for k in range(count)]
    geometry = struct.pack("<HH", count, 0) + b"".join(struct.pack("<iif", *row) for row in rows)
    assert after == hashlib.sha256(before + geometry).digest()
    return boot_id, number, before, item, left_ms / 1e3, joined_ms / 1e3, reason, rows


def announce(g):
    assert tunnels(g.send(tunnel(ANNOUNCE, PLAN_HASH)), ANNOUNCE_ACK) == [PLAN_HASH]


def start_mission(g):
    zero = (0.0, 0.0, 0.0, 0.0)
    places = [(-20.0, 30.0), (20.0, 30.0), (20.0, -20.0)]
    if g.vehicle.kind == "px4":
        items = [g.item(0, 6, 22, north=-20, east=-20, z=8.0, current=1)]
    else:
        items = [g.item(0, 0, 16), g.item(1, 3, 22, zero, z=8.0)]
    for north, east in places:
        items.append(g.item(len(items), 3, 16, (1.0, 0.3, 0.0, 0.0), north=north, east=east, z=8.0))
    items.append(g.item(len(items), 3, 21, zero, z=0.0))
    assert g.upload(items)[0] == 0
    g.run(2.0)
    if g.vehicle.kind == "px4":
        g.arm()
        g.set_mode(4, 4)
    else:
        g.set_mode(4)
        g.arm()
        g.set_mode(3)
        g.command(mavlink.MAV_CMD_MISSION_START)


@pytest.mark.parametrize("kind", ["px4", "ardupilot"])
def test_a_mission_leaves_its_path_once_upward_and_reports_it(make_ground, kind):
    g = make_ground(kind, replan=True)
    announce(g)
    start_mission(g)
    heights = []
    heard = g.run_until(lambda: heights.append(g.vehicle.airframe.height_m) or tunnels(g.heard, REPORT))
    assert max(heights) == pytest.approx(10.0, abs=0.2)
    g.run(0.1)
    boot_id, number, plan_hash, item, left, joined, reason, points = decode(g.heard)
    assert (number, plan_hash) == (1, PLAN_HASH)
    assert item == (1 if kind == "px4" else 2)
    assert 3.0 < joined - left < 8.0
    assert reason == 1
    assert 10 <= len(points) <= 60
    altitude = [p[2] for p in points]
    assert altitude[0] == pytest.approx(12.0, abs=0.3)
    assert max(altitude) == pytest.approx(14.0, abs=0.2)
    assert altitude[-1] == pytest.approx(12.0, abs=0.3)
    assert heard is not None
    # Sent again each second until it is acknowledged; an acknowledgement of another boot does not count.
    g.send(acknowledgement(boot_id ^ 1, 1))
    before = len(g.heard)
    g.run(2.5)
    assert len(tunnels(g.heard[before:], REPORT)) in {2, 3}
    g.send(acknowledgement(boot_id, 1))
    before = len(g.heard)
    g.run_until(lambda: not g.vehicle.armed)
    assert tunnels(g.heard[before:], REPORT) == []  # and no second detour in this flight
    assert g.vehicle.replanner.acknowledged == [1]


def test_the_station_reads_what_the_vehicle_says_and_the_vehicle_what_the_station_says(make_ground):
    g = make_ground("px4", replan=True)
    g.send(tunnelled(replanning.MAVLink_plan_announce_message(list(PLAN_HASH)), 1, 0))
    start_mission(g)
    g.run_until(lambda: tunnels(g.heard, REPORT))
    g.run(0.1)
    assembler = ReportAssembler()
    inner = [message for m in g.heard if (message := carried(m)) is not None]
    assert inner[0].get_type() == "PLAN_ANNOUNCE_ACK"
    (report,) = [report for message in inner if (report := assembler.take(message)) is not None]
    *_, points = decode(g.heard)
    assert report.plan_hash == PLAN_HASH.hex()
    assert [p.altitude_m for p in report.path] == [altitude for _, _, altitude in points]
    g.send(report_ack(report.boot_id, report.number, ReportStatus.STORED, 1))
    assert g.vehicle.replanner.acknowledged == [1]


def test_an_offboard_flight_does_the_same_and_is_back_before_the_leg_ends(make_ground):
    g = make_ground("px4", replan=True).in_air(8.0)
    here = np.array(g.vehicle.frame.local_ned(g.vehicle.airframe.position_m))
    length, duration = 24.0, 9.0
    g.setpoint(here, yaw=0.0)
    g.set_mode(6)
    heights = []
    for k in range(round((duration + 2.0) / 0.04)):
        u = min(k * 0.04 / duration, 1.0)
        s = u**4 * (35 - 84 * u + 70 * u**2 - 20 * u**3)
        v = 140 * u**3 * (1 - u) ** 3 / duration
        g.setpoint(here + np.array([length * s, 0, 0]), (length * v, 0, 0), yaw=0.0)
        g.run(0.04)
        heights.append(g.vehicle.airframe.height_m)
    assert max(heights) == pytest.approx(10.0, abs=0.3)
    assert heights[-1] == pytest.approx(8.0, abs=0.1)
    report = decode(g.heard)
    assert report[2] == bytes(32)  # no plan was announced
    assert report[3] == -1


def test_there_is_no_detour_unless_asked_for(make_ground):
    g = make_ground("px4")
    start_mission(g)
    g.run_until(lambda: not g.vehicle.armed)
    assert tunnels(g.heard, REPORT) == []


def test_a_pilot_ends_the_detour_and_it_is_reported_all_the_same(make_ground):
    g = make_ground("px4", replan=True)
    start_mission(g)
    g.run_until(lambda: g.vehicle.replanner.on_detour)
    g.run(0.6)
    g.vehicle.set_mode_by_name("POSCTL")
    g.run(1.5)
    assert not g.vehicle.replanner.on_detour
    assert len(decode(g.heard)[7]) >= 2


def test_malformed_tunnels_are_ignored(make_ground):
    g = make_ground("px4", replan=True)
    announce_of_another_form = struct.pack("<HB", 62474, 64) + PLAN_HASH
    for payload in (b"", b"GR", struct.pack("<HB", *ANNOUNCE), announce_of_another_form, bytes(128)):
        g.send(mavlink.MAVLink_tunnel_message(1, 1, 0x8247, len(payload), list(payload.ljust(128, b"\0"))))
    assert g.vehicle.replanner.plan_hash == bytes(32)
