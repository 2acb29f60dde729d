"""The station is killed and started again: what it then says is true, and nothing is lost (safety rules 2, 6 and 9)."""

import asyncio
import signal

import pytest

pytestmark = pytest.mark.system


async def uploaded(station, vehicle):
    flight = await station.prepared(vehicle, "mission")
    await station.post(f"/flights/{flight}/upload", expect=202)
    await station.until(flight, lambda f: f["state"] == "uploaded")
    return flight


async def restarted(station, vehicle):
    station.signal(signal.SIGKILL)
    await asyncio.sleep(0.5)
    station.start()
    await station.vehicle_heard(vehicle.name)


def records_of(station, flight):
    """Everything that only ever grows."""
    return {
        "events": [e["id"] for e in station.get(f"/flights/{flight}/events")],
        "visits": [v["viewpoint_id"] for v in station.flight(flight)["visits"]],
        "images": [i["id"] for i in station.get(f"/flights/{flight}/images")],
        "track": [p["at_s"] for p in station.get(f"/flights/{flight}/track")["points"]],
    }


def nothing_lost(before, after):
    return all(set(before[kind]) <= set(after[kind]) for kind in before)


@pytest.mark.parametrize("kind", ["px4", "ardupilot"])
async def test_killed_in_mid_upload(kind, station, vehicle, small_plan):
    flown = vehicle(kind, "--delay", "0.1", plan=small_plan, speedup=1)
    base = await station(small_plan)
    flight = await base.prepared(flown, "mission")
    await base.post(f"/flights/{flight}/upload", expect=202)
    assert base.flight(flight)["state"] == "uploading"
    await restarted(base, flown)
    said = await base.until(flight, lambda f: f["state"] in {"uploaded", "upload_failed"})
    held = flown.truth["mission_items"]
    assert (said["state"] == "uploaded") == said["proved"]
    if said["state"] == "upload_failed":
        on_vehicle = base.get(f"/flights/{flight}/on-vehicle")
        assert on_vehicle["equal"] is not True
        assert "upload" in said["actions"], "it can be tried again"
        await base.post(f"/flights/{flight}/upload", expect=202)
        said = await base.until(flight, lambda f: f["state"] == "uploaded")
        assert flown.truth["mission_items"] > held
    assert said["proved"]
    assert not flown.truth["armed"]


@pytest.mark.parametrize("kind", ["px4", "ardupilot"])
async def test_killed_in_a_mission_flight(kind, station, vehicle, small_plan, tmp_path, is_whole):
    flown = vehicle(kind, plan=small_plan, speedup=5, card=tmp_path / "card")
    base = await station(small_plan)
    flight = await uploaded(base, flown)
    await base.post(f"/flights/{flight}/start", confirm=flown.name)
    await base.until(flight, lambda f: f["viewpoints_reached"] >= 1)
    before = records_of(base, flight)
    commands = flown.truth["commands"]
    await restarted(base, flown)
    await base.until(flight, lambda f: f["state"] == "flying")
    assert nothing_lost(before, records_of(base, flight))
    read = await base.post(f"/flights/{flight}/read-back")
    assert read["equal"] is True
    done = await base.until(flight, lambda f: f["state"] in {"completed", "incomplete", "aborted"}, 120)
    assert done["state"] == "completed", (done["problems"], base.get(f"/flights/{flight}/events")[-30:])
    assert done["problems"] == []
    assert nothing_lost(before, records_of(base, flight))
    flying = {"400", "176", "22", "300"}  # arm, mode, take-off, mission start
    after = flown.truth["commands"]
    assert {c: after.get(c) for c in flying} == {c: commands.get(c) for c in flying}, "the station only watched"
    is_whole(flown, small_plan, base.data)


async def test_killed_in_an_offboard_flight(station, vehicle, small_plan, tmp_path, is_whole):
    flown = vehicle("px4", "--param", "COM_OF_LOSS_T=3", plan=small_plan, speedup=6, card=tmp_path / "card")
    base = await station(small_plan)
    flight = await base.prepared(flown, "offboard")
    await base.post(f"/flights/{flight}/start", confirm=flown.name)
    await base.until(flight, lambda f: f["viewpoints_reached"] >= 1)
    before = records_of(base, flight)
    await restarted(base, flown)
    held = await base.until(flight, lambda f: f["state"] == "held")
    assert "resume" in held["actions"]
    setpoints = flown.truth["setpoints"]
    place = flown.truth["position_m"]
    await asyncio.sleep(2.0)
    truth = flown.truth
    assert truth["setpoints"] == setpoints, "it asks first"
    assert max(abs(a - b) for a, b in zip(truth["position_m"], place, strict=True)) < 1.0
    assert nothing_lost(before, records_of(base, flight))
    await base.post(f"/flights/{flight}/resume", expect=403, confirm="px4-2")
    await base.post(f"/flights/{flight}/resume", confirm=flown.name)
    done = await base.until(flight, lambda f: f["state"] in {"completed", "incomplete", "aborted"}, 120)
    assert done["state"] == "completed", (done["problems"], base.get(f"/flights/{flight}/events")[-30:])
    assert nothing_lost(before, records_of(base, flight))
    is_whole(flown, small_plan, base.data)
