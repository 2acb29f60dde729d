"""Recorded telemetry sent to a station as if live."""

from __future__ import annotations

import asyncio
import struct
import subprocess
import sys
from collections import Counter
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.core.errors import InputError
from gcs.mavlink.events import ImageEvent, VehicleFoundEvent
from gcs.mavlink.station import MavlinkStation
from sitl_mocks.replay import read_log, replay

RECORDS = Path(__file__).resolve().parents[2] / "../shared/records"
LOGS = sorted(RECORDS.glob("*/*.tlog")) + sorted(RECORDS.glob("*/dense/*.tlog"))
needs_records = pytest.mark.skipif(not LOGS, reason="no records here")


def log(packets):
    return b"".join(struct.pack(">Q", round(at * 1e6)) + packet for at, packet in packets)


def packets(**kwargs):
    packer = mavlink.MAVLink(None, srcSystem=7, srcComponent=1)
    beat = mavlink.MAVLink_heartbeat_message(2, 3, 0, 0, 3, 3)
    two = bytes(beat.pack(packer))
    one = bytes(beat.pack(packer, force_mavlink1=True))
    packer.signing.secret_key, packer.signing.sign_outgoing = b"k" * 32, True
    return [(1e9, two), (1e9 + 0.5, one), (1e9 + 1.0, bytes(beat.pack(packer))), (1e9 + 100.0, two)]


def test_entries_of_all_three_kinds_of_packets():
    rows = packets()
    assert [p for _, p in read_log(log(rows))] == [p for _, p in rows]
    assert [at for at, _ in read_log(log(rows))] == pytest.approx([at for at, _ in rows])


@pytest.mark.parametrize("cut", range(1, 25))
def test_a_log_that_was_cut_off_ends_with_its_last_whole_entry(cut):
    rows = packets()
    assert [p for _, p in read_log(log(rows)[:-cut])] == [p for _, p in rows[:-1]]


def test_what_is_no_log():
    with pytest.raises(InputError, match="no packet begins"):
        list(read_log(b"a text file and not a telemetry log"))


def test_times_are_those_of_the_log_and_long_gaps_are_cut():
    now, sent = [50.0], []
    count = replay(
        iter(packets()),
        lambda packet: sent.append(now[0]),
        2.0,
        clock=lambda: now[0],
        sleep=lambda s: now.__setitem__(0, now[0] + s),
    )
    assert count == 4
    assert sent == pytest.approx([50.0, 50.25, 50.5, 53.0])


@needs_records
@pytest.mark.parametrize("file", LOGS, ids=lambda f: f.name)
def test_every_record_is_read_to_its_end(file):
    data = file.read_bytes()
    ours = sum(1 for _ in read_log(data))
    assert sum(8 + len(p) for _, p in read_log(data)) == len(data)
    assert ours > 100


@needs_records
@pytest.mark.parametrize("file", LOGS, ids=lambda f: f.name)
def test_every_record_is_replayed_packet_by_packet_at_its_times(file):
    """On a clock that only the replay moves; heard by pymavlink's parser, which knows nothing of logs."""
    now, parser, heard, late_s = [0.0], mavlink.MAVLink(None), Counter(), []
    parser.robust_parsing = True
    entries = list(read_log(file.read_bytes()))
    gaps = [min(b - a, 5.0) for (a, _), (b, _) in pairwise(entries)]
    due = iter(np.concatenate([[0.0], np.cumsum(gaps)]))

    def send(packet):
        late_s.append(abs(now[0] - next(due)))
        for m in parser.parse_buffer(packet) or []:
            heard[m.get_type() == "BAD_DATA"] += 1
            if m.get_type() == "HEARTBEAT" and m.autopilot != mavlink.MAV_AUTOPILOT_INVALID:
                heard[m.autopilot] += 1

    count = replay(iter(entries), send, 1.0, clock=lambda: now[0], sleep=lambda s: now.__setitem__(0, now[0] + s))
    assert count == len(entries)
    assert (heard[False], heard[True]) == (count, 0)
    kind = mavlink.MAV_AUTOPILOT_PX4 if "px4" in file.parts else mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA
    assert heard[kind] > 0
    assert max(late_s) < 1e-3


async def station_sees(file, speedup, seconds):
    """What a station makes of a record that is replayed to it."""
    station = MavlinkStation()
    url = await station.open("udpin:127.0.0.1:0")
    command = [sys.executable, "-m", "sitl_mocks", "replay", str(file), "--port", url.rsplit(":", 1)[1]]
    process = await asyncio.create_subprocess_exec(
        *command, "--speedup", str(speedup), stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    seen, pictures = Counter(), []
    try:
        async with station.events() as events:
            async with asyncio.timeout(seconds):
                ended = asyncio.ensure_future(process.wait())
                while not ended.done():
                    waiting = asyncio.ensure_future(anext(events))
                    await asyncio.wait({waiting, ended}, return_when=asyncio.FIRST_COMPLETED)
                    if not waiting.done():
                        waiting.cancel()
                        break
                    event = waiting.result().event
                    seen[type(event)] += 1
                    if isinstance(event, ImageEvent):
                        pictures.append(event.image)
        vehicle = next(iter(station.vehicles.values()))
        return vehicle, seen, pictures, (await process.stdout.read()).decode()
    finally:
        if process.returncode is None:
            process.kill()
        await station.close_all()


@needs_records
@pytest.mark.system
@pytest.mark.parametrize(
    ("name", "autopilot"),
    [("ardupilot/auto_mission_camera.tlog", "ardupilot"), ("px4/auto_mission_camera.tlog", "px4")],
)
async def test_a_station_sees_a_recorded_flight_as_a_live_one(name, autopilot):
    log_file = RECORDS / name
    vehicle, seen, pictures, said = await station_sees(log_file, 100.0, 60.0)
    assert seen[VehicleFoundEvent] == 1
    assert vehicle.identity.autopilot.value == autopilot
    assert vehicle.telemetry.position is not None
    assert vehicle.telemetry.mode is not None
    assert "packets were sent" in said
    told = mavutil.mavlink_connection(str(log_file))
    numbers = set()
    while (m := told.recv_match(type=["CAMERA_FEEDBACK", "CAMERA_IMAGE_CAPTURED"])) is not None:
        numbers.add(m.img_idx if m.get_type() == "CAMERA_FEEDBACK" else m.image_index)
    told.close()
    assert {p.index for p in pictures} == numbers
    assert numbers


@pytest.mark.system
def test_errors_name_the_file():
    command = [sys.executable, "-m", "sitl_mocks", "replay", "nowhere.tlog"]
    done = subprocess.run(command, check=False, capture_output=True, text=True, timeout=60)
    assert done.returncode == 2
    assert "nowhere.tlog" in done.stderr
