"""What must not be flown is refused before the vehicle is armed, with one line and the exit status of the interface."""

import asyncio

import pytest

pytestmark = pytest.mark.system

ARM = "400"
HOME_3_M_HIGH = "--home=31.36201962,121.61528979,7.0"


async def fly(gcs, plan, vehicle, data, *extra):
    return await gcs(
        "fly", plan, "--connect", vehicle.url, "--mode", "mission", "--yes", vehicle.name, "--json", "--data", data,
        *extra,
    )  # fmt: skip


def is_refused(told, vehicle, *words):
    assert told.status == 5, told.text
    last = told.lines[-1]
    assert last.startswith("gcs: ")
    for word in words:
        assert word in last
    summary = told.summary
    assert summary["ok"] is False
    assert summary["problems"], summary
    truth = vehicle.truth
    assert ARM not in truth["commands"], "it was not even asked to arm"
    assert not truth["armed"]


async def test_datum_3_m_off(gcs, vehicle, small_plan, tmp_path):
    async def one(kind, mode):
        flown = vehicle(kind, HOME_3_M_HIGH, plan=small_plan)
        told = await fly(gcs, small_plan, flown, tmp_path / kind, "--mode", mode)
        is_refused(told, flown, "datum", "+3.0")

    async with asyncio.TaskGroup() as group:
        group.create_task(one("px4", "mission"))
        group.create_task(one("ardupilot", "offboard"))


async def test_limits_below_the_plan_and_a_battery_too_empty(gcs, vehicle, small_plan, tmp_path):
    async def too_slow():
        flown = vehicle("px4", "--param", "MPC_XY_VEL_MAX=2", plan=small_plan)
        told = await fly(gcs, small_plan, flown, tmp_path / "slow")
        is_refused(told, flown, "horizontal speed", "2.00 m/s")
        assert flown.truth["mission_items"] == 0, "nothing was uploaded"

    async def too_empty():
        flown = vehicle("ardupilot", plan=small_plan)
        flown.ask("battery 0.27")
        told = await fly(gcs, small_plan, flown, tmp_path / "empty")
        is_refused(told, flown, "battery", "% left, ")

    async with asyncio.TaskGroup() as group:
        group.create_task(too_slow())
        group.create_task(too_empty())


async def test_a_companion_that_is_not_there_or_cannot_get_the_plan(gcs, vehicle, small_plan, tmp_path, free_port):
    port, nobody, token = free_port(), f"http://127.0.0.1:{free_port()}", tmp_path / "token"
    token.write_text("token")
    flown = vehicle("px4", "--companion", str(port), plan=small_plan, speedup=1)
    told = await fly(gcs, small_plan, flown, tmp_path / "data", "--mode", "companion")
    is_refused(told, flown, "companion: no companion is heard", "start `gcs companion`")
    own = ("--connect", f"udpin:127.0.0.1:{port}", "--keep", tmp_path / "kept")
    async with gcs.running("companion", *own, "--station", nobody, "--token-file", token) as beside:
        await beside.until("beside the autopilot")
        told = await fly(gcs, small_plan, flown, tmp_path / "data", "--mode", "companion")
    is_refused(told, flown, "the companion cannot fly this plan", f"{nobody}: the station does not answer")


async def test_a_mission_that_the_vehicle_would_fly_too_near_to_the_structure(gcs, vehicle, small_plan, tmp_path):
    flown = vehicle("px4", "--param", "MPC_XY_VEL_P_ACC=0.2", plan=small_plan)
    told = await fly(gcs, small_plan, flown, tmp_path)
    is_refused(told, flown, "predicted flight: as a mission it comes", "m too near at")
    assert flown.truth["mission_items"] == 0, "nothing was uploaded"


@pytest.mark.parametrize("kind", ["px4", "ardupilot"])
async def test_a_mission_that_is_gone_when_a_paused_flight_is_resumed(station, vehicle, small_plan, kind):
    flown = vehicle(kind, plan=small_plan, speedup=3)
    base = await station(small_plan)
    flight = await base.prepared(flown, "mission")
    await base.post(f"/flights/{flight}/upload", expect=202)
    await base.until(flight, lambda f: f["state"] == "uploaded")
    await base.post(f"/flights/{flight}/start", confirm=flown.name)
    await base.until(flight, lambda f: f["viewpoints_reached"] >= 1)
    await base.post(f"/flights/{flight}/pause")
    flown.ask("clear-mission")
    commands = flown.truth["commands"]
    refused = await base.post(f"/flights/{flight}/resume", expect=403, confirm=flown.name)
    assert "no longer holds the plan's mission" in refused["detail"]
    assert base.flight(flight)["proved"] is False
    assert base.flight(flight)["state"] == "paused"
    assert flown.truth["commands"] == commands, "nothing was commanded"


async def test_a_failsafe_that_is_off_is_accepted_by_its_name_and_the_return_altitude_raised(
    gcs, vehicle, small_plan, tmp_path, records
):
    flown = vehicle("px4", "--param", "NAV_DLL_ACT=0", "--param", "RTL_RETURN_ALT=20", plan=small_plan, speedup=5)
    told = await fly(gcs, small_plan, flown, tmp_path / "data")
    is_refused(told, flown, "NAV_DLL_ACT", "must be accepted by name")
    assert flown.truth["mission_items"] == 0
    told = await fly(gcs, small_plan, flown, tmp_path / "data", "--accept", "NAV_DLL_ACT")
    assert told.status == 0, told.text
    raised = [t for t in records(tmp_path / "data").texts("command") if "return altitude" in t]
    assert len(raised) == 1
    assert "from 20 m to 34 m" in raised[0] and "RTL_RETURN_ALT = 34" in raised[0]
    assert raised[0] in told.text


async def test_a_vehicle_that_vanishes_in_mid_upload(gcs, vehicle, small_plan, tmp_path, records):
    flown = vehicle("px4", "--delay", "0.08", plan=small_plan, speedup=1)
    data = tmp_path / "data"
    async with gcs.running(
        "fly", small_plan, "--connect", flown.url, "--mode", "mission", "--yes", flown.name, "--json", "--data", data
    ) as told:
        await told.until("sending the mission")
        flown.ask("vanish")
        await asyncio.wait_for(told.process.wait(), 300)
    assert told.status == 4, told.text
    assert told.lines[-1].startswith("gcs: px4-1: ")
    assert told.summary["proved"] is False
    assert records(data).rows("select state, proved from flights") == [("upload_failed", 0)]
    assert records(data).rows("select state from uploads") == [("failed",)]
