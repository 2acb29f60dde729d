"""The pilot comes first, and a lost stream is not taken up again by itself (safety rules 1 and 6)."""

import asyncio
import signal

import pytest

pytestmark = pytest.mark.system

OVER = {"completed", "incomplete", "aborted"}
DO_SET_MODE = "176"


async def quiet(vehicle, seconds=2.0):
    """Nothing that steers reaches the vehicle; returns its true state."""
    before = vehicle.truth
    await asyncio.sleep(seconds)
    after = vehicle.truth
    assert after["setpoints"] == before["setpoints"]
    assert after["commands"].get(DO_SET_MODE) == before["commands"].get(DO_SET_MODE)
    return after


async def flying(station, vehicle, mode):
    flight = await station.prepared(vehicle, mode)
    if mode == "mission":
        await station.post(f"/flights/{flight}/upload", expect=202)
        await station.until(flight, lambda f: f["state"] == "uploaded")
    await station.post(f"/flights/{flight}/start", confirm=vehicle.name)
    await station.until(flight, lambda f: f["viewpoints_reached"] >= 1)
    return flight


async def resumed_to_the_end(station, flight, vehicle, plan, is_whole):
    """Only with the vehicle's name it goes on, and then to the end."""
    await station.post(f"/flights/{flight}/resume", expect=403, confirm="yes")
    await station.post(f"/flights/{flight}/resume", expect=422)
    await quiet(vehicle, 0.5)
    await station.post(f"/flights/{flight}/resume", confirm=vehicle.name)
    done = await station.until(flight, lambda f: f["state"] in OVER)
    assert done["state"] == "completed", (done["problems"], station.get(f"/flights/{flight}/events")[-30:])
    is_whole(vehicle, plan, station.data)


@pytest.mark.parametrize(("kind", "switch"), [("px4", "POSCTL"), ("ardupilot", "LOITER")])
async def test_the_pilots_switch_in_mid_stream(kind, switch, station, vehicle, small_plan, tmp_path, is_whole):
    patient = ("--param", "COM_OF_LOSS_T=3") if kind == "px4" else ()
    flown = vehicle(kind, *patient, plan=small_plan, speedup=2, card=tmp_path / "card")
    base = await station(small_plan)
    flight = await flying(base, flown, "offboard")
    flown.ask(f"mode {switch}")
    held = await base.until(flight, lambda f: f["state"] == "held")
    assert "resume" in held["actions"]
    assert (await quiet(flown))["mode"] == switch
    await resumed_to_the_end(base, flight, flown, small_plan, is_whole)


async def test_the_station_stands_still(station, vehicle, small_plan, tmp_path, is_whole):
    flown = vehicle("px4", "--param", "COM_OF_LOSS_T=3", plan=small_plan, speedup=2, card=tmp_path / "card")
    base = await station(small_plan)
    flight = await flying(base, flown, "offboard")
    base.signal(signal.SIGSTOP)
    stopped = await flown.until(lambda t: t["mode"] == "AUTO.LOITER", what="its failsafe holds")
    await asyncio.sleep(1.0)
    base.signal(signal.SIGCONT)
    await base.until(flight, lambda f: f["state"] == "held")
    truth = await quiet(flown)
    assert truth["mode"] == "AUTO.LOITER"
    assert truth["setpoints"] - stopped["setpoints"] <= 1, "what was being sent when it was stopped, and no more"
    await resumed_to_the_end(base, flight, flown, small_plan, is_whole)


async def test_missions_with_a_pilots_switch_and_a_link_that_is_gone_for_a_while(
    station, vehicle, small_plan, tmp_path, is_whole
):
    switched = vehicle("px4", plan=small_plan, speedup=2, card=tmp_path / "card")
    silent = vehicle("ardupilot", plan=small_plan, speedup=2, card=tmp_path / "card", system_id=2)
    base = await station(small_plan)
    first = await flying(base, switched, "mission")
    switched.ask("mode POSCTL")
    await base.until(first, lambda f: f["state"] == "held")
    second = await flying(base, silent, "mission")
    silent.ask("kill-link")
    await base.until(second, lambda f: f["state"] == "unknown")
    silent.ask("restore-link")
    assert (await quiet(switched))["mode"] == "POSCTL"
    await resumed_to_the_end(base, first, switched, small_plan, is_whole)
    done = await base.until(second, lambda f: f["state"] in OVER)
    assert done["state"] == "completed", (done["problems"], base.get(f"/flights/{second}/events")[-30:])
    is_whole(silent, small_plan, base.data)
