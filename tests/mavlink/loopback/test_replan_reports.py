"""Reports that come in on a real link, signed and forged."""

from __future__ import annotations

import asyncio
import hashlib
import logging
import socket
import struct
import time

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.mavlink import events
from gcs.mavlink.signing import EPOCH_S, TICKS_PER_S, LinkSigning, new_key

PLAN = bytes(range(32))


def report(number, *, after=None):
    """TUNNEL messages of a report without points, packed by hand."""
    after = hashlib.sha256(PLAN + bytes(4)).digest() if after is None else after
    body = struct.pack("<IIIiiffff", 77, 1000, 2000, 0, 0, 0.0, float("nan"), 0.0, 0.0)
    raw = struct.pack("<HB", 62470, 153) + body + struct.pack("<HhHH", number, -1, 0, 0) + PLAN + after + b"\1"
    return mavlink.MAVLink_tunnel_message(0, 0, 0x8247, len(raw), list(raw.ljust(128, b"\0")))


def acknowledged(vehicle):
    """(number, status) of the acknowledgements that a vehicle heard."""
    payloads = [bytes(m.payload)[: m.payload_length].ljust(10, b"\0") for m in vehicle.of("TUNNEL")]
    return [struct.unpack_from("<HB", p, 7) for p in payloads if struct.unpack_from("<HB", p) == (62473, 228)]


async def until(holds):
    async with asyncio.timeout(60.0):
        while not holds():  # noqa: ASYNC110 - what a scripted vehicle heard has no event to wait for
            await asyncio.sleep(0.02)


async def reported(heard):
    async with asyncio.timeout(60.0):
        async for event in heard:
            if isinstance(event, events.ReplanEvent):
                return event.report
    raise AssertionError("the events ended")


async def test_a_report_is_told_until_it_is_answered_and_a_malformed_one_is_refused(connected, caplog):
    scripted, vehicle = await connected()
    async with vehicle.events() as heard:
        for _ in range(2):
            scripted.send(report(1))
            got = await reported(heard)
            assert (got.number, got.plan_hash) == (1, PLAN.hex())
        assert acknowledged(scripted) == []
        vehicle.acknowledge_replan(got)
        await until(lambda: acknowledged(scripted) == [(1, 0)])
        scripted.send(report(1))
        await until(lambda: acknowledged(scripted) == [(1, 0)] * 2)
        with caplog.at_level(logging.WARNING):
            for _ in range(3):
                scripted.send(report(2, after=bytes(31) + b"\1"))
            await until(lambda: acknowledged(scripted)[2:] == [(2, 1)] * 3)
        assert sum("cannot be read" in line for line in caplog.messages) == 1
        scripted.send(report(3))
        assert (await reported(heard)).number == 3


async def test_where_a_link_is_signed_an_unsigned_report_reaches_nobody(connected, station):
    scripted, vehicle = await connected()
    key = new_key()
    signing = scripted.codec.signing
    signing.secret_key, signing.sign_outgoing = key, True
    signing.timestamp = int((time.time() - EPOCH_S) * TICKS_PER_S)
    (entry,) = station._links.values()
    entry.link.signing = LinkSigning(key)
    forger = mavlink.MAVLink(None, srcSystem=1, srcComponent=191)
    async with vehicle.events() as heard:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
            for number in (1, 2):
                packet = report(number).pack(forger)
                stranger.sendto(packet, scripted.remote)
                scripted.put(packet)
        scripted.send(report(3))
        assert (await reported(heard)).number == 3
    assert "unsigned packets" in station.links[0].signing.problem
    assert acknowledged(scripted) == []
