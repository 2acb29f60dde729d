"""The detour and its report, decoded here from docs/replan_report.md."""

import math
import struct
import zlib

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

NAN = math.nan
PLAN_HASH = bytes(range(32))


def tunnels(messages, kind):
    payloads = [bytes(m.payload)[: m.payload_length] for m in messages if m.get_type() == "TUNNEL"]
    return [p for p in payloads if p[:3] == b"GR\x01" and p[3] == kind]


def tunnel(kind, boot_id, number, body):
    payload = struct.pack("<2sBBIHBB", b"GR", 1, kind, boot_id, number, 0, 1) + body
    return mavlink.MAVLink_tunnel_message(1, 1, 0x8247, len(payload), list(payload.ljust(128, b"\0")))


def decode(fragments):
    """(boot id, number, hash, item, left, joined, reason, points) of a report's fragments."""
    boot_id, number = struct.unpack_from("<IH", fragments[0], 4)
    assert all(len(f) <= 128 for f in fragments)
    assert [f[10] for f in fragments] == list(range(fragments[0][11]))
    body = b"".join(f[12:] for f in fragments)
    assert struct.unpack("<I", body[-4:])[0] == zlib.crc32(body[:-4])
    plan_hash, item, left, joined, length = struct.unpack_from("<32shddB", body)
    at = 32 + 2 + 16 + 1
    reason = body[at : at + length].decode()
    at += length
    (count,) = struct.unpack_from("<H", body, at)
    points = [struct.unpack_from("<iif", body, at + 2 + 12 * i) for i in range(count)]
    assert at + 2 + 12 * count + 4 == len(body)
    return boot_id, number, plan_hash, item, left, joined, reason, points


def announce(g):
    (answer,) = tunnels(g.send(tunnel(3, 0, 0, PLAN_HASH)), 4)
    assert answer[12:] == PLAN_HASH


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
    heard = g.run_until(lambda: heights.append(g.vehicle.airframe.height_m) or tunnels(g.heard, 1))
    assert max(heights) == pytest.approx(10.0, abs=0.2)
    g.run(0.1)
    fragments = tunnels(g.heard, 1)
    boot_id, number, plan_hash, item, left, joined, reason, points = decode(fragments[: fragments[0][11]])
    assert (number, plan_hash) == (1, PLAN_HASH)
    assert item == (1 if kind == "px4" else 2)
    assert 3.0 < joined - left < 8.0
    assert reason
    assert 10 <= len(points) <= 60
    altitude = [p[2] for p in points]
    assert altitude[0] == pytest.approx(12.0, abs=0.3)
    assert max(altitude) == pytest.approx(14.0, abs=0.2)
    assert altitude[-1] == pytest.approx(12.0, abs=0.3)
    assert heard is not None
    # Sent again each second until it is acknowledged; an acknowledgement of another boot does not count.
    g.send(tunnel(2, boot_id ^ 1, 1, b"\0"))
    before = len(g.heard)
    g.run(2.5)
    assert len(tunnels(g.heard[before:], 1)) in {2 * len(fragments), 3 * len(fragments)}
    g.send(tunnel(2, boot_id, 1, b"\0"))
    before = len(g.heard)
    g.run_until(lambda: not g.vehicle.armed)
    assert tunnels(g.heard[before:], 1) == []  # and no second detour in this flight
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
    fragments = tunnels(g.heard, 1)
    report = decode(fragments[: fragments[0][11]])
    assert report[2] == bytes(32)  # no plan was announced
    assert report[3] == -1


def test_there_is_no_detour_unless_asked_for(make_ground):
    g = make_ground("px4")
    start_mission(g)
    g.run_until(lambda: not g.vehicle.armed)
    assert tunnels(g.heard, 1) == []


def test_a_pilot_ends_the_detour_and_it_is_reported_all_the_same(make_ground):
    g = make_ground("px4", replan=True)
    start_mission(g)
    g.run_until(lambda: g.vehicle.replanner.on_detour)
    g.run(0.6)
    g.vehicle.set_mode_by_name("POSCTL")
    g.run(1.5)
    assert not g.vehicle.replanner.on_detour
    fragments = tunnels(g.heard, 1)
    assert len(decode(fragments[: fragments[0][11]])[7]) >= 2


def test_malformed_tunnels_are_ignored(make_ground):
    g = make_ground("px4", replan=True)
    for payload in (b"", b"GR", b"XX" + bytes(20), b"GR\x02\x03" + bytes(40), b"GR\x01\x03" + bytes(8) + bytes(31)):
        g.send(mavlink.MAVLink_tunnel_message(1, 1, 0x8247, len(payload), list(payload.ljust(128, b"\0"))))
    assert g.vehicle.replanner.plan_hash == bytes(32)
