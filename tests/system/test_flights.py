"""`gcs fly`: both ways to fly, both kinds of vehicle, over good links and bad ones."""

import asyncio

import pytest

from gcs.storage.plan_files import plan_hash, read_plan

pytestmark = pytest.mark.system

# The stream of a sped-up flight passes through two processes of a machine that may be busy with other things; with
# PX4's usual second of patience a pause of a fifth of a second of ours would already be the stream's loss.
PATIENT = {"px4": ("--param", "COM_OF_LOSS_T=3"), "ardupilot": ()}


async def flown(kind, mode, plan, loss, gcs, vehicle, folder, records, is_whole):
    extra = PATIENT[kind] if mode == "offboard" else ()
    speedup = 8 if mode == "mission" else 2
    drone = vehicle(kind, "--loss", loss, *extra, plan=plan, speedup=speedup, card=folder / f"card-{kind}")
    data = folder / f"data-{kind}"
    told = await gcs("fly", plan, "--connect", drone.url, "--mode", mode, "--yes", drone.name, "--json", "--data", data)
    summary, points = told.summary, len(read_plan(plan).viewpoints)
    worst = max(records(data).misses(drone).values())
    print(f"{kind} {mode} loss {loss}: {told.seconds:.0f} s, worst miss {worst:.2f} m, {summary}")
    assert told.status == 0, told.text
    assert summary["ok"] is True
    assert summary["proved"] is (mode == "mission")
    assert summary["reached"] == summary["viewpoints"] == points
    assert summary["images_received"] == summary["images_expected"] == points
    assert summary["problems"] == []
    assert 0.0 < summary["max_cross_track_m"] < (2.0 if mode == "mission" else 0.5)
    assert 0.0 < summary["duration_s"] < told.seconds
    is_whole(drone, plan, data)
    truth = drone.truth
    assert not truth["armed"]
    assert truth["forced_arms"] == 0


async def test_a_small_plan_over_a_good_link(gcs, vehicle, small_plan, tmp_path, records, is_whole):
    async with asyncio.TaskGroup() as group:
        for kind, mode in (("px4", "mission"), ("ardupilot", "offboard")):
            group.create_task(flown(kind, mode, small_plan, "0", gcs, vehicle, tmp_path, records, is_whole))


@pytest.mark.parametrize("mode", ["mission", "offboard"])
async def test_all_of_the_crane_over_a_bad_link(mode, gcs, vehicle, crane_plan, tmp_path, records, is_whole):
    async with asyncio.TaskGroup() as group:
        for kind in ("px4", "ardupilot"):
            group.create_task(flown(kind, mode, crane_plan, "0.1", gcs, vehicle, tmp_path, records, is_whole))


async def test_a_detour_is_reported_once(gcs, vehicle, small_plan, tmp_path, records, is_whole):
    drone = vehicle("px4", "--replan", "--loss", "0.1", plan=small_plan, speedup=4, card=tmp_path / "card")
    data = tmp_path / "data"
    told = await gcs(
        "fly", small_plan, "--connect", drone.url, "--mode", "mission", "--yes", drone.name, "--json", "--data", data
    )
    print(told.seconds, told.summary)
    assert told.status == 0, told.text
    is_whole(drone, small_plan, data)
    assert records(data).rows("select number, plan_hash from replan_reports") == [(1, plan_hash(small_plan))]
    replan = drone.truth["replan"]
    assert replan["acknowledged"] == [1]
    assert replan["pending"] == []
    assert replan["plan_hash"] == plan_hash(small_plan)
