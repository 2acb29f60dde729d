"""Replanning reports on a signed link of a whole station: doubled, out of order, forged, and of plans nobody knows."""

from __future__ import annotations

import asyncio
import random
import socket
import struct
import time
from dataclasses import replace

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.core.frames import GeoPoint
from gcs.core.replanning import ReplanReason, ReplanReport
from gcs.mavlink.replan_messages import hash_after, report_messages
from gcs.mavlink.signing import EPOCH_S, TICKS_PER_S, Verdict, new_key
from gcs.mavlink.tunnel_carrier import tunnelled
from gcs.services.replan_difference import Chain
from gcs.services.station import StationServices
from gcs.storage.plan_files import plan_hash
from gcs.storage.signing_keys import SigningKeyStore, StoredKey

FLIGHT = "flight-1"
PATH = tuple(GeoPoint(31.3622 + 1e-5 * k, 121.6155, 14.0) for k in range(12))
ACK = struct.pack("<HB", 62473, 228)


class SigningVehicle:
    """A companion and its autopilot, on a socket of their own, with a key."""

    def __init__(self, port, key):
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.connect(("127.0.0.1", port))
        self._socket.setblocking(False)
        self._packers = {
            component: mavlink.MAVLink(None, srcSystem=1, srcComponent=component) for component in (1, 191)
        }
        for component, packer in self._packers.items():
            packer.signing.secret_key, packer.signing.sign_outgoing = key, True
            packer.signing.link_id = component
            packer.signing.timestamp = int((time.time() - EPOCH_S) * TICKS_PER_S)
        self._parser = mavlink.MAVLink(None)
        self._parser.robust_parsing = True
        self.acknowledged = []

    def close(self):
        self._socket.close()

    def beat(self):
        heartbeat = mavlink.MAVLink_heartbeat_message(2, mavlink.MAV_AUTOPILOT_PX4, 0, 0, 3, 3)
        self._socket.send(heartbeat.pack(self._packers[1]))

    def send(self, messages, *, signed=True):
        packer = self._packers[191]
        packer.signing.sign_outgoing = signed
        for message in messages:
            self._socket.send(tunnelled(message, 0, 0).pack(packer))
        packer.signing.sign_outgoing = True

    def listen(self):
        """Take in the numbers of the reports that are acknowledged as stored."""
        while True:
            try:
                data = self._socket.recv(4096)
            except (BlockingIOError, ConnectionRefusedError):
                return
            for message in self._parser.parse_buffer(bytearray(data)) or ():
                if message.get_type() == "TUNNEL" and bytes(message.payload[:3]) == ACK:
                    number, status = struct.unpack_from("<HB", bytes(message.payload), 7)
                    self.acknowledged += [number] if status == 0 else []


async def until(vehicle, holds):
    async with asyncio.timeout(60.0):
        while not holds():
            vehicle.beat()
            vehicle.listen()
            await asyncio.sleep(0.05)


@pytest.fixture
async def station(tmp_path, monkeypatch, make_no_flights, flight_on_record):
    """A station with one signed link and a flight on record."""
    monkeypatch.setenv("GCS_KEY", "correct horse")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    url, key = f"udpin:127.0.0.1:{port}", new_key()
    SigningKeyStore(tmp_path, "correct horse").put(url, StoredKey(key, rejects_unsigned=True))
    services = StationServices(tmp_path, links=(url,), make_flights=make_no_flights)
    async with services.running(lambda event: ""):
        flight_on_record(services)
        vehicle = SigningVehicle(port, key)
        await until(vehicle, lambda: 1 in services.vehicles.station.vehicles)
        services.vehicle_on_the_link = vehicle
        yield services
        vehicle.close()


def chain_of_reports(plan, count):
    made = []
    for number in range(1, count + 1):
        before = made[-1].plan_hash_after if made else plan
        path = tuple(replace(p, altitude_m=14.0 + number) for p in PATH)
        made.append(
            ReplanReport(
                boot_id=7,
                number=number,
                plan_hash=before,
                plan_hash_after=hash_after(before, path, ()),
                reason=ReplanReason.STANDING_OBSTACLE,
                mission_item=-1,
                left_at_s=10.0 * number,
                rejoined_at_s=10.0 * number + 5,
                obstacle=None,
                path=path,
                viewpoints=(),
            )
        )
    return made


def lines(station):
    return [e.text for e in station.database.flights.events(FLIGHT) if e.kind == "replan"]


async def test_nothing_is_lost_and_everything_is_said_once(station, box_plan):
    vehicle, rng = station.vehicle_on_the_link, random.Random(5)
    first, second, third = chain_of_reports(plan_hash(box_plan), 3)
    strange = replace(first, number=4, plan_hash="ff" * 32, plan_hash_after=hash_after("ff" * 32, PATH, ()), path=PATH)
    stranger = replace(strange, number=5, plan_hash="ee" * 32, plan_hash_after=hash_after("ee" * 32, PATH, ()))
    for report in (third, second, strange, first, stranger):
        packets = 2 * report_messages(report)
        rng.shuffle(packets)
        vehicle.send(packets)
        await until(vehicle, lambda report=report: report.number in vehicle.acknowledged)
    for report in (second, strange):  # its acknowledgement was lost
        count = vehicle.acknowledged.count(report.number)
        vehicle.send(report_messages(report))
        await until(vehicle, lambda r=report, c=count: vehicle.acknowledged.count(r.number) > c)
    views = station.replans.of_flight(FLIGHT)
    assert [v.record.number for v in views] == [1, 2, 3, 4, 5]
    assert [v.chain for v in views] == [Chain.KNOWN] * 3 + [Chain.UNKNOWN] * 2
    said = lines(station)
    assert sum("left the plan" in line for line in said) == 5
    assert sum("missing" in line for line in said) == 1, "the third came before the second, and that before the first"
    assert sum("does not know" in line for line in said) == 1
    assert len(said) == 7


async def test_a_forged_report_is_not_stored_and_does_not_keep_the_true_one_out(station, box_plan):
    vehicle = station.vehicle_on_the_link
    (true,) = chain_of_reports(plan_hash(box_plan), 1)
    forged = replace(true, reason=ReplanReason.BACKED_OFF)
    vehicle.send(report_messages(forged), signed=False)
    other_key = SigningVehicle(int(station.vehicles.links()[0].link.url.rsplit(":", 1)[1]), new_key())
    other_key.send(report_messages(forged))
    other_key.close()

    def refused():
        (link,) = station.vehicles.links()
        return link.signing.counts

    await until(vehicle, lambda: refused()[Verdict.UNSIGNED] and refused()[Verdict.WRONG_KEY])
    assert vehicle.acknowledged == []
    assert station.replans.of_flight(FLIGHT) == []
    (link,) = station.vehicles.links()
    assert link.signing.problem is not None, "the operator sees it on the link"
    vehicle.send(report_messages(true))
    await until(vehicle, lambda: vehicle.acknowledged)
    (view,) = station.replans.of_flight(FLIGHT)
    assert view.record.reason == ReplanReason.STANDING_OBSTACLE.words
