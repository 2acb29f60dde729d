"""Telemetry logs: what other tools read back, and what a killed process, a full and a slow disk leave."""

from __future__ import annotations

import errno
import os
import struct
import threading

import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.core.errors import NotFoundError
from gcs.storage import telemetry_log
from gcs.storage.telemetry_log import LogTotals, TelemetryLog, TelemetryLogStore, whole_length

EPOCH_S = 1_795_000_000.25


class Clock:
    def __init__(self):
        self.now = 100.0

    def __call__(self):
        return self.now


class Wire:
    """Packets of a vehicle and of a station, each with its own numbers."""

    def __init__(self, force_mavlink1=False):
        self.vehicle = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
        self.station = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
        self.v1 = force_mavlink1

    def packet(self, codec, message):
        packet = message.pack(codec, force_mavlink1=self.v1)
        codec.seq = (codec.seq + 1) % 256
        return bytes(packet)

    def attitude(self, boot_ms):
        return self.packet(self.vehicle, mavlink.MAVLink_attitude_message(boot_ms, 0.1, 0.2, 0.3, 0, 0, 0))

    def beat(self):
        return self.packet(self.station, mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))


@pytest.fixture
def said():
    return []


@pytest.fixture
def start(tmp_path, said):
    opened = []

    def make(clock=None, **options):
        clock = clock or Clock()
        file = TelemetryLog(
            tmp_path / "flights" / "f.tlog",
            said.append,
            wall=lambda: EPOCH_S + clock.now - 100.0,
            clock=clock,
            **options,
        )
        opened.append(file)
        return file

    yield make
    for file in opened:
        file.close()


def read_back(path):
    reader = mavutil.mavlogfile(str(path))
    messages = []
    while (message := reader.recv_match()) is not None:
        messages.append(message)
    reader.f.close()
    return messages, reader


def wait_until(holds):
    for _ in range(2000):
        if holds():
            return
        threading.Event().wait(0.005)
    raise AssertionError("waited in vain")


def wait_for_size(path, size):
    wait_until(lambda: path.is_file() and path.stat().st_size >= size)


def test_pymavlinks_reader_gets_every_packet_of_both_directions_at_its_time(start):
    clock, wire = Clock(), Wire()
    file = start(clock)
    packets = []
    for i in range(1000):
        clock.now = 100.0 + 0.01 * i
        packets.append(wire.beat() if i % 100 == 0 else wire.attitude(10 * i))
        file.record(packets[-1])
    assert file.close() == LogTotals(1000, 0)
    messages, reader = read_back(file.path)
    assert [bytes(m.get_msgbuf()) for m in messages] == packets
    assert {m.get_srcSystem() for m in messages} == {1, 255}
    assert [m._timestamp for m in messages] == pytest.approx([EPOCH_S + 0.01 * i for i in range(1000)], abs=1e-5)
    assert reader.packet_loss() == 0


def test_mavlink_1_and_signed_packets_are_logged_as_they_are(start):
    wire, signed = Wire(force_mavlink1=True), mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    signed.signing.secret_key, signed.signing.sign_outgoing = bytes(range(32)), True
    message = mavlink.MAVLink_heartbeat_message(2, 12, 0, 0, 4, 3)
    packets = [wire.beat(), wire.attitude(1), bytes(message.pack(signed)), wire.attitude(2)]
    file = start()
    for packet in packets:
        file.record(packet)
    file.close()
    records = file.path.read_bytes()
    for packet in packets:
        assert records[8 : 8 + len(packet)] == packet
        records = records[8 + len(packet) :]
    assert records == b""
    assert whole_length(file.path) == file.path.stat().st_size


def test_times_do_not_go_back_when_the_computers_clock_is_set(tmp_path, said):
    clock, wall = Clock(), [EPOCH_S]
    file = TelemetryLog(tmp_path / "f.tlog", said.append, wall=lambda: wall[0], clock=clock)
    wire = Wire()
    file.record(wire.attitude(1))
    wall[0] -= 3600.0
    clock.now += 1.0
    file.record(wire.attitude(2))
    file.close()
    first, second = read_back(file.path)[0]
    assert second._timestamp - first._timestamp == pytest.approx(1.0, abs=1e-5)


def test_it_is_on_the_disk_before_it_is_closed(start):
    file = start(write_every_s=0.01)
    packet = Wire().attitude(1)
    file.record(packet)
    wait_for_size(file.path, 8 + len(packet))
    assert len(read_back(file.path)[0]) == 1


@pytest.mark.parametrize("left", [3, 8, 10, 20])
def test_a_log_goes_on_behind_the_last_whole_packet_of_a_killed_process(start, left):
    wire = Wire()
    first = start()
    for i in range(5):
        first.record(wire.attitude(i))
    first.close()
    whole = first.path.read_bytes()
    first.path.write_bytes(whole + whole[:left])
    second = start()
    second.record(wire.attitude(5))
    assert second.close() == LogTotals(1, 0)
    messages, _ = read_back(first.path)
    assert [m.time_boot_ms for m in messages] == [0, 1, 2, 3, 4, 5]


def test_a_full_disk_is_said_once_and_what_fits_later_is_whole(start, said, monkeypatch):
    """The disk takes half a packet and is full; later there is room again."""
    clock, wire, full = Clock(), Wire(), [True]
    monkeypatch.setattr(telemetry_log.os, "write", _full_after(20, full, os.write))
    file = start(clock, write_every_s=0.01, max_waiting=500)
    for i in range(3):
        file.record(wire.attitude(i))
    wait_until(lambda: said)
    for i in range(3, 100):
        file.record(wire.attitude(i))
    full[0] = False
    clock.now += telemetry_log.TRY_AGAIN_S
    wait_for_size(file.path, 3 * 40)
    totals = file.close()
    assert totals.packets + totals.lost == 100
    assert totals.lost > 80
    messages, _ = read_back(file.path)
    assert [m.time_boot_ms for m in messages] == list(range(totals.packets))
    assert ["disk is full" in text for text in said] == [True, False]
    assert "written again" in said[1]


def _full_after(room, full, write):
    """`os.write` of a disk that takes `room` more bytes and no more while `full` holds."""
    taken = [0]

    def limited(descriptor, data):
        if not full[0]:
            return write(descriptor, data)
        if taken[0] >= room:
            taken[0] = 0
            raise OSError(errno.ENOSPC, "No space left on device")
        taken[0] += len(data[:room])
        return write(descriptor, data[:room])

    return limited


def test_a_disk_that_never_takes_anything_is_survived(tmp_path, said):
    (tmp_path / "flights").write_text("a file where the folder should be")
    file = TelemetryLog(tmp_path / "flights" / "f.tlog", said.append, write_every_s=0.01, max_waiting=1000)
    wire = Wire()
    for i in range(100):
        file.record(wire.attitude(i))
    assert file.close() == LogTotals(0, 100)
    assert len(said) == 1
    assert "cannot be written" in said[0]


def test_recording_does_not_wait_for_a_disk_that_hangs(start, monkeypatch):
    """While a write hangs, packets are taken until the memory set aside is full, and counted from then on."""
    writing, go_on, write = threading.Event(), threading.Event(), os.write

    def hang(descriptor, data):
        writing.set()
        assert go_on.wait(30.0)
        return write(descriptor, data)

    monkeypatch.setattr(telemetry_log.os, "write", hang)
    wire = Wire()
    size = 8 + len(wire.attitude(1))
    file = start(write_every_s=0.01, max_waiting=10 * size)
    file.record(wire.attitude(1))
    assert writing.wait(10.0)
    for _ in range(15):
        file.record(wire.attitude(1))
    go_on.set()
    assert file.close() == LogTotals(11, 5)


def test_nothing_is_taken_after_the_end(start):
    file = start()
    assert file.close() == LogTotals(0, 0)
    file.record(Wire().beat())
    assert file.close() == LogTotals(0, 0)


@pytest.mark.parametrize("name", ["../f", "a/b", "", "..", "f\0", ".hidden"])
def test_names_that_lead_elsewhere_are_not_found(tmp_path, name):
    store = TelemetryLogStore(tmp_path)
    for ask in (store.size_bytes, store.read, store.file_name):
        with pytest.raises(NotFoundError):
            ask(name)


def test_what_is_read_of_a_growing_log_is_what_was_said_of_its_size(tmp_path, said):
    store = TelemetryLogStore(tmp_path)
    assert store.size_bytes("flight-1") is None
    with pytest.raises(NotFoundError, match="no telemetry log"):
        store.read("flight-1")
    file = store.open("flight-1", said.append)
    file.record(Wire().attitude(1))
    file.close()
    size, pieces = store.read("flight-1")
    with file.path.open("ab") as more:
        more.write(struct.pack(">Q", 0))
    assert len(b"".join(pieces)) == size
    assert (store.size_bytes("flight-1"), said) == (size + 8, [])
