"""The telemetry log of a flight: from before it is armed until it is down, and told in its record."""

from __future__ import annotations

import asyncio
from types import SimpleNamespace

import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.core.errors import StorageError
from gcs.services import flight_log
from gcs.services.flight_log import FlightLogs
from gcs.storage.telemetry_log import TelemetryLogStore


class Recorder:
    def __init__(self, flight_id):
        self.flight_id = flight_id
        self.lines = []
        self.error = None

    def log(self, kind, text, *, severity):
        if self.error is not None:
            raise self.error
        assert kind == "log"
        self.lines.append((severity, text))


@pytest.fixture
def codec():
    return mavlink.MAVLink(None, srcSystem=1, srcComponent=1)


@pytest.fixture
def packet(codec):
    def make(boot_ms):
        data = bytes(mavlink.MAVLink_attitude_message(boot_ms, 0, 0, 0, 0, 0, 0).pack(codec))
        codec.seq = (codec.seq + 1) % 256
        return data

    return make


@pytest.fixture
def vehicle():
    return SimpleNamespace(on_packet=None)


@pytest.fixture
def make_run(vehicle):
    def make(flight_id="flight-1"):
        return SimpleNamespace(vehicle=vehicle, recorder=Recorder(flight_id), down=asyncio.Event())

    return make


def boot_times(path):
    reader = mavutil.mavlogfile(str(path))
    times = []
    while (message := reader.recv_match()) is not None:
        times.append(message.time_boot_ms)
    reader.f.close()
    return times


async def ended(run, vehicle):
    async with asyncio.timeout(60.0):
        while vehicle.on_packet is not None or len(run.recorder.lines) < 2:  # noqa: ASYNC110 - the log has no events
            await asyncio.sleep(0.01)


async def test_it_ends_by_itself_some_time_after_the_vehicle_is_down(tmp_path, vehicle, make_run, packet, monkeypatch):
    monkeypatch.setattr(flight_log, "AFTER_DISARM_S", 0.05)
    logs, run = FlightLogs(TelemetryLogStore(tmp_path)), make_run()
    logs.begin(run)
    vehicle.on_packet(packet(0))
    run.down.set()
    await asyncio.sleep(0)
    vehicle.on_packet(packet(1))
    await ended(run, vehicle)
    assert boot_times(tmp_path / "flights" / "flight-1.tlog") == [0, 1]
    (_, began), (severity, over) = run.recorder.lines
    assert "flights/flight-1.tlog" in began
    assert "2 packets" in over
    assert "missing" not in over
    assert severity == flight_log.NOTICE


async def test_a_flight_that_did_not_start_and_starts_again_has_one_log(tmp_path, vehicle, make_run, packet):
    logs = FlightLogs(TelemetryLogStore(tmp_path))
    for boot_ms in (0, 1):
        run = make_run()
        logs.begin(run)
        vehicle.on_packet(packet(boot_ms))
        await logs.end("flight-1")
        assert vehicle.on_packet is None
    await logs.end("flight-1")
    assert boot_times(tmp_path / "flights" / "flight-1.tlog") == [0, 1]


async def test_the_next_flight_of_the_vehicle_is_not_cut_off_by_the_end_of_the_last(
    tmp_path, vehicle, make_run, packet
):
    logs = FlightLogs(TelemetryLogStore(tmp_path))
    logs.begin(make_run("flight-1"))
    logs.begin(make_run("flight-2"))
    await logs.end("flight-1")
    vehicle.on_packet(packet(7))
    await logs.close()
    assert vehicle.on_packet is None
    assert boot_times(tmp_path / "flights" / "flight-2.tlog") == [7]


async def test_a_disk_that_does_not_take_it_is_told_in_the_record(tmp_path, vehicle, make_run, packet):
    (tmp_path / "flights").write_text("in the way")
    logs, run = FlightLogs(TelemetryLogStore(tmp_path)), make_run()
    logs.begin(run)
    vehicle.on_packet(packet(0))
    await logs.close()
    await asyncio.sleep(0)
    texts = [text for severity, text in run.recorder.lines if severity == flight_log.ERROR]
    assert len(texts) == 2
    assert any("cannot be written" in text for text in texts)
    assert any("1 packets are missing" in text for text in texts)


async def test_a_record_on_the_same_full_disk_does_not_stop_the_flight(tmp_path, vehicle, make_run, packet):
    logs, run = FlightLogs(TelemetryLogStore(tmp_path)), make_run()
    run.recorder.error = StorageError("the disk is full")
    logs.begin(run)
    vehicle.on_packet(packet(3))
    await logs.close()
    assert boot_times(tmp_path / "flights" / "flight-1.tlog") == [3]
