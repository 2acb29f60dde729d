"""The telemetry log of a flight whose station was killed on the way, as another tool reads it."""

import asyncio
import itertools
import signal
import urllib.request

import pytest
from pymavlink import mavutil

pytestmark = pytest.mark.system


async def test_both_halves_of_a_flight_are_in_one_log(station, vehicle, small_plan, tmp_path):
    flown = vehicle("px4", plan=small_plan, speedup=3, card=tmp_path / "card")
    base = await station(small_plan)
    flight = await base.prepared(flown, "mission")
    await base.post(f"/flights/{flight}/upload", expect=202)
    await base.until(flight, lambda f: f["state"] == "uploaded")
    assert base.flight(flight)["telemetry_log"] is None
    await base.post(f"/flights/{flight}/start", confirm=flown.name)
    await base.until(flight, lambda f: f["viewpoints_reached"] >= 1)
    before = base.flight(flight)["telemetry_log"]["size_bytes"]
    base.signal(signal.SIGKILL)
    await asyncio.sleep(0.5)
    base.start()
    await base.vehicle_heard(flown.name)
    await base.until(flight, lambda f: f["state"] == "completed")

    end = await closed(base, flight)
    assert "missing" not in end
    path = tmp_path / "read.tlog"
    path.write_bytes(await asyncio.to_thread(downloaded, base, flight))
    assert path.stat().st_size == base.flight(flight)["telemetry_log"]["size_bytes"] > before > 0

    reader = mavutil.mavlogfile(str(path))
    kinds, armed, times, longest_gap_s = set(), [], [], 0.0
    while (message := reader.recv_match()) is not None:
        sender, kind = message.get_srcSystem(), message.get_type()
        if times:
            longest_gap_s = max(longest_gap_s, message._timestamp - times[-1])
        times.append(message._timestamp)
        kinds.add((sender, kind))
        if (sender, message.get_srcComponent(), kind) == (1, 1, "HEARTBEAT"):
            armed.append(bool(message.base_mode & mavutil.mavlink.MAV_MODE_FLAG_SAFETY_ARMED))
    reader.f.close()
    assert "BAD_DATA" not in {kind for _, kind in kinds}
    assert {sender for sender, _ in kinds} == {1, 255}
    assert {(1, "LOCAL_POSITION_NED"), (255, "HEARTBEAT"), (255, "COMMAND_LONG"), (1, "COMMAND_ACK")} <= kinds
    assert times == sorted(times)
    assert longest_gap_s > 0.4, "the station was away"
    assert armed[0] is False
    assert armed[-1] is False
    assert sum(a != b for a, b in itertools.pairwise(armed)) == 2, "armed once, disarmed once"


async def closed(station, flight):
    """What the record says of the log's end."""
    for _ in range(300):
        for event in await asyncio.to_thread(station.get, f"/flights/{flight}/events"):
            if "is closed" in event["text"]:
                return event["text"]
        await asyncio.sleep(0.2)
    pytest.fail("the log was not closed")


def downloaded(station, flight):
    request = urllib.request.Request(
        f"http://127.0.0.1:{station.port}/api/flights/{flight}/telemetry-log",
        headers={"Authorization": f"Bearer {(station.data / 'token').read_text().strip()}"},
    )
    with urllib.request.urlopen(request, timeout=30) as answer:
        assert answer.headers["Content-Disposition"] == f'attachment; filename="{flight}.tlog"'
        return answer.read()
