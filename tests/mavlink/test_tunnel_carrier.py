"""The dialect's definition, and its messages in TUNNEL: packed here a second time from docs/replan_report.md."""

from __future__ import annotations

import io
import math
import random
import struct
from contextlib import redirect_stdout
from pathlib import Path

import pymavlink
import pytest
from hypothesis import given
from hypothesis import strategies as st
from lxml import etree
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from pymavlink.generator import mavgen

import gcs.mavlink
from gcs.mavlink.framing import FramePacker, FrameParser
from gcs.mavlink.tunnel_carrier import PAYLOAD_TYPE, carried, replanning, tunnelled

XML = Path(gcs.mavlink.__file__).with_name("replanning.xml")
HASH = bytes(range(32))
KINDS = list(replanning.mavlink_map.values())


def tunnel(raw, length=None, payload_type=PAYLOAD_TYPE):
    return mavlink.MAVLink_tunnel_message(
        0, 0, payload_type, len(raw) if length is None else length, list(raw.ljust(128, b"\0"))
    )


def test_the_definition_keeps_to_mavlinks_schema():
    schema = etree.XMLSchema(etree.parse(Path(pymavlink.__file__).parent / "generator" / "mavschema.xsd"))
    schema.assertValid(etree.parse(XML))


def test_the_module_is_what_the_definition_says(tmp_path):
    made = tmp_path / "replanning_dialect.py"
    with redirect_stdout(io.StringIO()):
        assert mavgen.mavgen(mavgen.Opts(str(made), "2.0", "Python3", validate=False), [str(XML)])
    assert Path(replanning.__file__).read_text() == made.read_text()


def test_every_message_fits_into_a_tunnel_and_has_a_number_of_its_own():
    assert all(kind.unpacker.size <= 125 for kind in KINDS)
    assert not set(replanning.mavlink_map) & set(mavlink.mavlink_map)


def test_numbers_checksums_and_layouts_are_those_of_the_description():
    text = (XML.parents[2] / "docs" / "replan_report.md").read_text()
    for kind in KINDS:
        assert f"| {kind.id} | {kind.msgname} | {kind.crc_extra} |" in text


def test_bytes_of_a_report_on_the_wire():
    head = replanning.MAVLink_replan_report_message(
        7, 3, list(HASH), list(HASH[::-1]), 2, -1, 12500, 20250, 5, 1, 313622000, 1216155000, 12.5, 0.75, -1.5, 0.25
    )
    body = struct.pack("<III", 7, 12500, 20250) + struct.pack("<ii", 313622000, 1216155000)
    body += struct.pack("<ffff", 12.5, 0.75, -1.5, 0.25) + struct.pack("<HhHH", 3, -1, 5, 1) + HASH + HASH[::-1] + b"\2"
    message = tunnelled(head, 255, 190)
    assert (message.target_system, message.target_component) == (255, 190)
    assert bytes(message.payload)[: message.payload_length] == struct.pack("<HB", 62470, 153) + body


def test_trailing_zeros_are_not_sent():
    message = tunnelled(replanning.MAVLink_replan_ack_message(7, 3, 0), 1, 0)
    assert bytes(message.payload)[: message.payload_length] == struct.pack("<HBIB", 62473, 228, 7, 3)


def test_a_message_comes_out_with_its_sender():
    state = replanning.MAVLink_lease_state_message(9, 2, 0, list(HASH), 1.5, 77, 2, math.nan, -1, b"leads")
    packet = FramePacker(3, 191).pack(tunnelled(state, 0, 0))
    (received,) = FrameParser().feed(packet)
    message = carried(received)
    assert (message.get_srcSystem(), message.get_srcComponent()) == (3, 191)
    assert (message.get_type(), message.lease, message.plan_time, message.text) == ("LEASE_STATE", 9, 1.5, "leads")
    assert bytes(message.plan_hash) == HASH
    assert math.isnan(message.lidar_age)
    assert message.odometry_quality == -1


@pytest.mark.parametrize(
    "message",
    [
        tunnel(b""),
        tunnel(struct.pack("<HB", 62473, 228)),
        tunnel(struct.pack("<HBI", 62473, 227, 7)),
        tunnel(struct.pack("<HBI", 62499, 228, 7)),
        tunnel(struct.pack("<HBI", 0, 50, 7)),
        tunnel(struct.pack("<HBI", 62473, 228, 7), length=200),
        tunnel(struct.pack("<HBI", 62473, 228, 7), payload_type=5),
        mavlink.MAVLink_heartbeat_message(2, 12, 0, 0, 0, 3),
    ],
)
def test_what_is_malformed_or_of_somebody_else_is_not_taken(message):
    assert carried(message) is None


def test_a_later_definition_may_have_more_fields_behind():
    longer = struct.pack("<HB", 62473, 228) + struct.pack("<IHB", 7, 3, 1) + b"more"
    message = carried(tunnel(longer))
    assert (message.boot_id, message.number, message.status) == (7, 3, 1)


@given(st.binary(max_size=128), st.integers(0, 255))
def test_any_payload_is_survived(raw, length):
    carried(tunnel(raw, length))


def test_any_body_of_a_known_message_is_survived():
    rng = random.Random(1)
    for _ in range(3000):
        kind = rng.choice(KINDS)
        raw = struct.pack("<HB", kind.id, kind.crc_extra) + rng.randbytes(rng.randrange(1, 126))
        assert carried(tunnel(raw)).get_type() == kind.msgname
