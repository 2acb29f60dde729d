"""Station, vehicle and companion as processes: a flight round what no plan knows, and its reports at the station."""

from __future__ import annotations

import asyncio
import contextlib
import json
import signal

import numpy as np
import pytest

from gcs.core.frames import GeoPoint, geodetic_from_enu
from gcs.core.progress import SilentProgress
from gcs.services.benchmarks.wall_plan import ANCHOR, HOME_M, WALL_M, wall_plan
from gcs.services.home_column import column_times
from gcs.services.plan_writing import write_certified
from gcs.storage.plan_files import plan_hash, read_plan
from gcs.storage.solid_shapes import box, structure_of_solids

pytestmark = pytest.mark.system

OVER = {"completed", "incomplete", "aborted"}
STREAM_HZ = 50


def on_the_way(plan_directory, back=False):
    """A place on the way from home to the first viewpoint, half-way; or from the last one back."""
    plan = read_plan(plan_directory)
    leave, enter = column_times(plan)
    times = np.linspace(*((plan.viewpoints[-1].time_s, enter) if back else (leave, plan.viewpoints[0].time_s)), 400)
    places = plan.trajectory.value(times)
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(places, axis=0), axis=1))])
    return places[np.searchsorted(way, way[-1] / 2)]


@pytest.fixture
def obstacle(tmp_path, small_plan):
    """A mast on the way that no plan knows."""
    return masts(tmp_path, on_the_way(small_plan))


def masts(tmp_path, *places):
    file = tmp_path / "obstacles.json"
    size = {"kind": "vehicle", "radius_m": 0.6, "height_m": 80.0}
    file.write_text(json.dumps({"obstacles": [{**size, "path_m": [[x, y]]} for x, y, _ in places]}))
    return file


@contextlib.asynccontextmanager
async def beside(gcs, port, station, tmp_path, *extra):
    """A companion, up to where it has met its autopilot."""
    arguments = ["--connect", f"udpin:127.0.0.1:{port}", "--station", f"http://127.0.0.1:{station.port}"]
    arguments += ["--token-file", station.data / "token", "--keep", tmp_path / "kept", *extra]
    async with gcs.running("companion", *arguments) as told:
        await told.until("beside the autopilot")
        yield told


@pytest.mark.parametrize("kind", ["px4", "ardupilot"])
async def test_a_whole_flight_round_an_obstacle(kind, gcs, station, vehicle, obstacle, small_plan, tmp_path, free_port):
    port = free_port()
    flown = vehicle(
        kind, "--companion", str(port), "--obstacles", str(obstacle), plan=small_plan, speedup=1, card=tmp_path / "card"
    )
    base = await station(small_plan)
    async with beside(gcs, port, base, tmp_path):
        flight = await base.prepared(flown, "companion")
        checks = (await asyncio.to_thread(base.get, f"/flights/{flight}/preflight"))["checks"]
        assert [check["detail"] for check in checks if check["name"] == "companion"] == [
            "holds the plan, ready to fly it"
        ]
        await base.post(f"/flights/{flight}/start", confirm=flown.name)
        done = await base.until(flight, lambda f: f["state"] in OVER)
    events = [event["text"] for event in base.get(f"/flights/{flight}/events")]
    assert done["state"] in {"completed", "incomplete"}, (done["problems"], events)
    truth = flown.truth
    assert truth["obstacles"]["touched"] == {}
    assert (tmp_path / "kept" / "plans" / plan_hash(small_plan) / "plan.json").is_file()
    reports = base.get(f"/flights/{flight}/replans")
    skipped = {v["viewpoint_id"] for report in reports for v in report["viewpoints"]}
    pictured = truth["captures"]
    assert reports, "the station was told of it"
    assert pictured + len(skipped) == len(read_plan(small_plan).viewpoints), "pictured, or reported as skipped"
    assert any("finished" in text for text in events), "the companion flew the plan to its end"
    assert any("companion: leading" in text for text in events)
    assert not any("hands off" in text for text in events), "the companion's own landing is no take-over"


async def test_it_goes_on_without_the_station_and_its_reports_come_later_each_once_and_in_order(
    gcs, station, vehicle, tmp_path, free_port
):
    port, plan = free_port(), tmp_path / "wall"
    write_certified(wall_plan().plan, structure_of_solids([box(*WALL_M)]), plan, SilentProgress())
    home = geodetic_from_enu(np.array(HOME_M), GeoPoint(*ANCHOR))
    _, first, second, _ = read_plan(plan).viewpoints
    between = (first.position_m + second.position_m) / 2
    obstacles = masts(tmp_path, on_the_way(plan), between, on_the_way(plan, back=True))
    there = ("--home", ",".join(str(float(c)) for c in home), "--obstacles", str(obstacles))
    alone = ("--companion", str(port), "--param", "NAV_DLL_ACT=0")  # or its autopilot would return without a station
    flown = vehicle("px4", *there, *alone, plan=plan, speedup=1, card=tmp_path / "card")
    base = await station(plan)

    def undelivered():
        return list((tmp_path / "kept" / "reports").glob("*.json"))

    async with beside(gcs, port, base, tmp_path):
        flight = await base.prepared(flown, "companion")
        await base.post(f"/flights/{flight}/start", confirm=flown.name, accept=["NAV_DLL_ACT"])
        await base.until(flight, lambda f: f["state"] == "flying" and f["lease"]["state"] == "leading")
        base.signal(signal.SIGKILL)
        landed = await flown.until(lambda truth: not truth["armed"])
        assert landed["mode"] == "AUTO.LAND", "the companion flew the plan to its end, and landed"
        assert landed["obstacles"]["touched"] == {}
        assert undelivered()
        await asyncio.to_thread(base.start)
        await base.until(flight, lambda f: f["state"] in OVER and not undelivered())
    reports = base.get(f"/flights/{flight}/replans")
    assert len(reports) >= 2
    assert [r["number"] for r in sorted(reports, key=lambda r: r["id"])] == list(range(1, len(reports) + 1))
    assert {report["chain"] for report in reports} == {"known"}
    skipped = {v["viewpoint_id"] for report in reports for v in report["viewpoints"]}
    assert flown.truth["captures"] + len(skipped) == len(read_plan(plan).viewpoints)


async def test_the_pilots_switch_while_the_companion_leads(gcs, station, vehicle, small_plan, tmp_path, free_port):
    port = free_port()
    flown = vehicle("px4", "--companion", str(port), plan=small_plan, speedup=1, card=tmp_path / "card")
    base = await station(small_plan)
    async with beside(gcs, port, base, tmp_path):
        flight = await base.prepared(flown, "companion")
        await base.post(f"/flights/{flight}/start", confirm=flown.name)
        await base.until(flight, lambda f: f["state"] == "flying")
        await flown.until(lambda truth: truth["mode"] == "OFFBOARD")
        flown.ask("mode POSCTL")
        held = await base.until(flight, lambda f: f["state"] == "held")
        assert "resume" in held["actions"]
        before = flown.truth["setpoints"]
        await flown.until(lambda truth: truth["seconds_since_setpoint"] > 2.0)
        assert flown.truth["setpoints"] - before < STREAM_HZ / 2, "no more than was under way on a busy machine"
        assert flown.truth["mode"] == "POSCTL"


async def led(gcs, base, flown, small_plan):
    flight = await base.prepared(flown, "companion")
    await base.post(f"/flights/{flight}/start", confirm=flown.name)
    under_way = await base.until(flight, lambda f: f["state"] == "flying" and f["lease"]["state"] == "leading")
    await base.until(flight, lambda f: f["lease"]["plan_time_s"] > under_way["lease"]["plan_time_s"] + 1.0)
    return flight


def hands_off(base, flight):
    return [e["text"] for e in base.get(f"/flights/{flight}/events") if "hands off" in e["text"]]


@pytest.mark.parametrize(("kind", "hold"), [("px4", "AUTO.LOITER"), ("ardupilot", "BRAKE")])
async def test_a_pilots_own_hold_is_told_from_the_companions_and_the_flight_goes_on_when_it_is_resumed(
    kind, hold, gcs, station, vehicle, small_plan, tmp_path, free_port
):
    port = free_port()
    flown = vehicle(kind, "--companion", str(port), plan=small_plan, speedup=1, card=tmp_path / "card")
    base = await station(small_plan)
    async with beside(gcs, port, base, tmp_path):
        flight = await led(gcs, base, flown, small_plan)
        shown = (await base.until(flight, lambda f: (f["lease"] or {}).get("state") == "leading"))["lease"]
        assert shown["lease"] != "00000000"
        assert 0.0 <= shown["lidar_age_s"] < 5.0
        flown.ask(f"mode {hold}")
        held = await base.until(flight, lambda f: f["state"] == "held" and f["lease"]["state"] == "taken_over")
        assert "resume" in held["actions"]
        assert len(hands_off(base, flight)) == 1, hands_off(base, flight)
        await base.post(f"/flights/{flight}/resume", expect=403, confirm="somebody")
        await base.post(f"/flights/{flight}/resume", confirm=flown.name)
        again = await base.until(flight, lambda f: f["state"] == "flying" and f["lease"]["state"] == "leading")
        assert again["lease"]["lease"] != shown["lease"]
        assert len(hands_off(base, flight)) == 1, "the companion's own change of mode is no take-over"


async def test_a_pilots_own_landing_ends_the_flight_as_one(gcs, station, vehicle, small_plan, tmp_path, free_port):
    port = free_port()
    flown = vehicle("px4", "--companion", str(port), plan=small_plan, speedup=1, card=tmp_path / "card")
    base = await station(small_plan)
    async with beside(gcs, port, base, tmp_path):
        flight = await led(gcs, base, flown, small_plan)
        flown.ask("mode AUTO.LAND")
        await base.until(flight, lambda f: f["state"] == "landing" and f["lease"]["state"] == "taken_over")
        done = await base.until(flight, lambda f: f["state"] in OVER)
    assert done["state"] == "aborted", [e["text"] for e in base.get(f"/flights/{flight}/events")]
    assert any("AUTO.LAND" in problem for problem in done["problems"])
    assert len(hands_off(base, flight)) == 1
