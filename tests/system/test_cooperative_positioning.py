"""`gcs fly --observer`: a plan where no satellites are received, flown by what another vehicle sees of the first."""

import asyncio
import signal

import pytest

pytestmark = pytest.mark.system

OVER = {"completed", "incomplete", "aborted"}
TOP = "-12,-12,26,12,12,50"
READY = {
    "px4": ("--param", "EKF2_EV_CTRL=3", "--param", "EKF2_NOAID_TOUT=90000000"),
    "ardupilot": ("--param", "GPS2_TYPE=14", "--param", "FS_EKF_ACTION=0"),
}
"""They use positions, and patiently: a busy machine may keep the station from telling one for some seconds."""


async def test_the_plan_is_flown_by_sightings(gcs, vehicle, small_plan, tmp_path, records, is_whole):
    async with asyncio.TaskGroup() as group:
        for kind in READY:
            group.create_task(_flown(kind, gcs, vehicle, small_plan, tmp_path, records, is_whole))


async def _flown(kind, gcs, vehicle, plan, tmp_path, records, is_whole):
    data = tmp_path / f"data-{kind}"
    options = ("--count", "2", "--sights", "2,1", f"--hidden={TOP}", *READY[kind])
    pair = vehicle(kind, *options, plan=plan, speedup=2, card=tmp_path / f"card-{kind}")
    flags = ("--connect", pair.url, "--mode", "mission", "--observer", f"{kind}-2", "--yes", pair.name)
    told = await gcs("fly", plan, *flags, "--json", "--data", data)
    assert told.status == 0, told.text
    is_whole(pair, plan, data)
    assert pair.truth["positions_taken"] > 20
    said = "\n".join(records(data).texts("command"))
    assert f"{kind}-1 has lost its own position fix" in said
    assert f"{kind}-1 has its own position fix again" in said


async def test_a_station_that_is_killed_meanwhile_tells_positions_again(station, vehicle, small_plan, tmp_path):
    kind = "px4"
    options = ("--count", "2", "--sights", "2,1", f"--hidden={TOP}", *READY[kind])
    pair = vehicle(kind, *options, plan=small_plan, speedup=1, card=tmp_path / "card")
    base = await station(small_plan)
    flight = await base.prepared(pair, "mission")
    await base.vehicle_heard("px4-2")
    await base.post(f"/flights/{flight}/upload", expect=202)
    await base.until(flight, lambda f: f["state"] == "uploaded")
    await base.post(f"/flights/{flight}/start", confirm=pair.name, observer="px4-2")
    await pair.until(lambda truth: truth["positions_taken"] > 5)
    base.signal(signal.SIGKILL)
    taken = pair.truth["positions_taken"]
    base.start()
    await pair.until(lambda truth: truth["positions_taken"] > taken + 10, what="positions after the restart")
    assert base.flight(flight)["observer"] == "px4-2"
    done = await base.until(flight, lambda f: f["state"] in OVER)
    texts = [e["text"] for e in base.get(f"/flights/{flight}/events")]
    assert done["state"] == "completed", (done["problems"], texts[-30:])
    assert texts.count("px4-1 is told no position until px4-2 is heard again") == 1
    assert texts.count("positions are told again since px4-2 is heard") == 1
