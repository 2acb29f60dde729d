"""The station is killed and started again: what it then says is true, and nothing is lost (safety rules 2, 6 and 9)."""

import asyncio
import signal

import pytest

pytestmark = pytest.mark.system


FLYING = {"400", "176", "22", "300", "193"}
"""Commands: arm, mode, take-off, mission start, pause and continue."""

OVER = {"completed", "incomplete", "aborted"}


async def restarted(station, *vehicles):
    station.signal(signal.SIGKILL)
    await asyncio.sleep(0.5)
    station.start()
    for vehicle in vehicles:
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


async def test_killed_in_mid_upload(station, vehicle, small_plan):
    slow = ("--delay", "0.04")
    flown = [
        vehicle("px4", *slow, plan=small_plan, speedup=1),
        vehicle("ardupilot", *slow, plan=small_plan, speedup=1, system_id=2),
    ]
    base = await station(small_plan)
    flights = [await base.prepared(one, "mission") for one in flown]
    for flight in flights:
        await base.post(f"/flights/{flight}/upload", expect=202)
        assert base.flight(flight)["state"] == "uploading"
    await restarted(base, *flown)
    for one, flight in zip(flown, flights, strict=True):
        said = await base.until(flight, lambda f: f["state"] in {"uploaded", "upload_failed"})
        assert (said["state"] == "uploaded") == said["proved"]
        if said["state"] == "upload_failed":
            assert base.get(f"/flights/{flight}/on-vehicle")["equal"] is not True
            assert "upload" in said["actions"], "it can be tried again"
            await base.post(f"/flights/{flight}/upload", expect=202)
            said = await base.until(flight, lambda f: f["state"] == "uploaded")
        assert said["proved"]
        read = await base.post(f"/flights/{flight}/read-back")
        assert read["equal"] is True
        assert len(read["items"]) == one.truth["mission_items"]
        assert not one.truth["armed"]


async def test_killed_in_mission_flights(station, vehicle, small_plan, tmp_path, is_whole):
    flown = [
        vehicle("px4", plan=small_plan, speedup=3, card=tmp_path / "card"),
        vehicle("ardupilot", plan=small_plan, speedup=3, card=tmp_path / "card", system_id=2),
    ]
    base = await station(small_plan)
    flights = [await base.prepared(one, "mission") for one in flown]
    for flight in flights:
        await base.post(f"/flights/{flight}/upload", expect=202)
    for flight in flights:
        await base.until(flight, lambda f: f["state"] == "uploaded")
    for one, flight in zip(flown, flights, strict=True):
        await base.post(f"/flights/{flight}/start", confirm=one.name)
    for flight in flights:
        await base.until(flight, lambda f: f["viewpoints_reached"] >= 1)
    before = [records_of(base, flight) for flight in flights]
    commands = [one.truth["commands"] for one in flown]
    await restarted(base, *flown)
    for k, (one, flight) in enumerate(zip(flown, flights, strict=True)):
        done = await base.until(flight, lambda f: f["state"] in OVER)
        assert done["state"] == "completed", (done["problems"], base.get(f"/flights/{flight}/events")[-30:])
        assert done["problems"] == []
        assert nothing_lost(before[k], records_of(base, flight))
        texts = [e["text"] for e in base.get(f"/flights/{flight}/events")]
        assert "the station was started again during this flight" in texts
        assert "read back: what the vehicle holds equals the plan's mission" in texts
        after = one.truth["commands"]
        assert {c: after.get(c) for c in FLYING} == {c: commands[k].get(c) for c in FLYING}, "it only watched"
        is_whole(one, small_plan, base.data)


async def test_killed_in_an_offboard_flight(station, vehicle, small_plan, tmp_path, is_whole):
    flown = vehicle("px4", "--param", "COM_OF_LOSS_T=3", plan=small_plan, speedup=2, card=tmp_path / "card")
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
    done = await base.until(flight, lambda f: f["state"] in OVER)
    assert done["state"] == "completed", (done["problems"], base.get(f"/flights/{flight}/events")[-30:])
    assert nothing_lost(before, records_of(base, flight))
    is_whole(flown, small_plan, base.data)
