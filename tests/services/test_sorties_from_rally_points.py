"""Sorties that take off from rally points where that is cheaper: planned, written, proved, and flown one by one."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from click.testing import CliRunner

from gcs.cli import cli
from gcs.core.clock import utc_now
from gcs.core.errors import InfeasibleError, InputError
from gcs.core.progress import SilentProgress
from gcs.planning.dynamics.energy import energy_wh
from gcs.planning.flights.sorties import BATTERY_SWAP_S
from gcs.services.live_feed import LiveFeed
from gcs.services.plan_service import PlanService, plan_to_directory
from gcs.services.plan_verification import verify_plan
from gcs.services.remaining_flight import next_flight
from gcs.storage.database import Database
from gcs.storage.plan_files import is_group_directory, part_directories, read_plan
from gcs.storage.plan_group_files import read_group
from gcs.storage.records import FlightPath, FlightRecord, FlightState, ImageRecord, ImageState, PlanState

APART_M = 60.0
HOME_M, RALLY_M = (-12.0, -12.0, 0.0), (72.0, -12.0, 0.0)
CAPACITY_WH, RESERVE = 9.0, 0.25
CHECKER = Path(__file__).resolve().parents[3] / "shared" / "verify" / "check_plan.py"


def points(name, x0):
    sides = {"west": (-1, 0), "south": (0, -1), "east": (1, 0), "north": (0, 1)}
    return [
        {"name": f"{name} {side} {z}", "position_m": [x0 + 2.0 * x, 2.0 * y, z], "normal": [x, y, 0]}
        for side, (x, y) in sides.items()
        for z in (4.0, 8.0)
    ]


@pytest.fixture(scope="module")
def scenario(box_scenario):
    """Two boxes, 60 m apart; home beside the one, a rally point beside the other."""
    return {
        **box_scenario,
        "structure": {"meshes": [{"file": "box.stl"}, {"file": "box.stl", "position_m": [APART_M, 0, 0]}]},
        "inspection": {"points": [*points("A", 0.0), *points("B", APART_M)]},
        "vehicle": {"battery": {"capacity_wh": CAPACITY_WH, "reserve": RESERVE}},
        "home_m": list(HOME_M),
        "rally_m": [[-40.0, 30.0, 0.0], list(RALLY_M)],
    }


@pytest.fixture(scope="module")
def files(tmp_path_factory, box_folder):
    def write(scenario):
        folder = tmp_path_factory.mktemp("rally")
        shutil.copy(box_folder / "box.stl", folder / "box.stl")
        (folder / "boxes.yaml").write_text(yaml.safe_dump(scenario))
        return folder / "boxes.yaml", folder / "out"

    return write


@pytest.fixture(scope="module")
def out(files, scenario):
    """Sorties from two places; to be read only."""
    file, out = files(scenario)
    plan_to_directory(file, out)
    return out


def failed(out):
    return {check.name for check in verify_plan(out) if not check.ok}


def test_each_box_is_visited_from_beside_it(out):
    assert is_group_directory(out)
    document = read_group(out)
    assert [(s.rally, s.home_m) for s in document.sorties] == [(None, HOME_M), (2, RALLY_M)]
    assert [{name[0] for name in s.viewpoints} for s in document.sorties] == [{"A"}, {"B"}]
    assert sorted(n for s in document.sorties for n in s.viewpoints) == sorted(
        p["name"] for p in [*points("A", 0.0), *points("B", APART_M)]
    )


def test_each_is_a_complete_plan_that_keeps_the_reserve_and_lands_where_it_started(out):
    document, folders = read_group(out), part_directories(out)
    for sortie, folder in zip(document.sorties, folders, strict=True):
        plan = read_plan(folder)
        ends = plan.trajectory.value([0.0, plan.trajectory.duration_s])
        np.testing.assert_allclose(ends, [sortie.home_m] * 2, atol=1e-6)
        needed = energy_wh(plan.trajectory, plan.scenario.vehicle)
        assert needed == pytest.approx(sortie.energy_wh)
        assert needed <= CAPACITY_WH * (1 - RESERVE)
        assert plan.sorties == ()
        assert plan.own_ways is not None
        assert {p.name for p in plan.scenario.inspection.points} == {v.name for v in plan.viewpoints}
        assert (folder / "mission.plan").is_file()
    first, second = document.sorties
    assert second.start_s - first.end_s == pytest.approx(BATTERY_SWAP_S)
    assert document.duration_s == second.end_s
    assert document.energy_wh == pytest.approx(first.energy_wh + second.energy_wh)


def test_it_is_clearly_cheaper_than_from_home_alone(out, files, scenario):
    alone = plan_to_directory(*files({**scenario, "rally_m": []})).plan
    document = read_group(out)
    assert len(alone.sorties) > len(document.sorties)
    assert document.energy_wh < 0.75 * alone.certificates.energy_wh
    assert 0.8 * document.tour_cost < document.tour_lower_bound <= document.tour_cost < alone.certificates.tour_cost


def test_all_of_it_verifies(out):
    names = {check.name for check in verify_plan(out)}
    assert failed(out) == set()
    assert {
        "sorties",
        "sorties.json",
        "sortie-2: min_clearance_m",
        "sortie-2: energy_wh",
        "sortie-2: own_ways",
    } <= names


def test_tampering_is_found(out, tmp_path):
    copy = shutil.copytree(out, tmp_path / "copy")
    path = copy / "sorties.json"
    document = json.loads(path.read_text())

    def with_second(**changes):
        sorties = [document["sorties"][0], {**document["sorties"][1], **changes}]
        path.write_text(json.dumps({**document, "sorties": sorties}))
        return failed(copy)

    assert with_second(rally=1) == {"sorties"}
    assert with_second(rally=3) == {"sorties"}
    assert with_second(start_s=document["sorties"][0]["end_s"] + 1.0) == {"sorties", "sorties.json"}
    assert with_second(energy_wh=1.0) == {"sorties.json"}
    path.write_text(json.dumps({**document, "tour_cost": 1.0}))
    assert failed(copy) == {"sorties.json"}
    path.write_text("{")
    assert failed(copy) == {str(path)}


@pytest.mark.system
def test_an_independent_check_agrees(out):
    if not CHECKER.is_file():
        pytest.skip("the independent checker is not here")
    for folder in part_directories(out):
        command = [sys.executable, str(CHECKER), str(folder), "--samples", "2000"]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr


def test_what_no_battery_reaches_from_home_is_visited_from_there(files, scenario):
    small = {**scenario, "vehicle": {"battery": {"capacity_wh": 5.5, "reserve": RESERVE}}}
    with pytest.raises(InfeasibleError, match=r"viewpoint B \w+ \d\.0: .* alone takes"):
        plan_to_directory(*files({**small, "rally_m": []}))
    document = plan_to_directory(*files(small)).document
    assert {s.rally for s in document.sorties if s.viewpoints[0][0] == "B"} == {2}
    assert max(s.energy_wh for s in document.sorties) <= 5.5 * (1 - RESERVE)


def test_one_sortie_from_a_rally_point_may_be_enough(files, scenario):
    """From home the way to the boxes and back takes too much besides."""
    surface = {"gsd_mm": 20.0, "max_incidence_deg": 75.0, "overlap": 0.0}
    asked = {
        "home_m": [-80.0, -12.0, 0.0],
        "inspection": {"points": points("B", APART_M), "surface": surface},
        "vehicle": {"battery": {"capacity_wh": 20.0, "reserve": RESERVE}},
    }
    file, out = files({**scenario, **asked})
    document = plan_to_directory(file, out).document
    assert [s.rally for s in document.sorties] == [2]
    assert document.coverage > 0.99
    assert failed(out) == set()


@pytest.mark.parametrize("more", [{}, {"rally_m": [[-40.0, 30.0, 0.0]]}])
def test_with_nothing_to_gain_all_stays_one_plan(files, scenario, more):
    """A battery for all, or a rally point that is nowhere nearer."""
    capacity = CAPACITY_WH if more else 100.0
    file, out = files({**scenario, "vehicle": {"battery": {"capacity_wh": capacity, "reserve": RESERVE}}, **more})
    plan = plan_to_directory(file, out).plan
    assert (out / "plan.json").is_file()
    assert len(plan.sorties) == (3 if more else 0)


@pytest.mark.parametrize(
    ("place", "words"), [([2.5, 0.0, 0.0], "from the structure"), ([72.0, -12.0, 3.0], "off the ground")]
)
def test_a_rally_point_that_cannot_be_used_is_named(files, scenario, place, words):
    with pytest.raises(InputError, match=rf"rally_m\.1.*{words}"):
        plan_to_directory(*files({**scenario, "rally_m": [list(RALLY_M), place]}))


def test_the_command_writes_them_and_puts_one_plan_in_their_place(files, scenario):
    file, out = files(scenario)
    said = CliRunner().invoke(cli, ["plan", str(file), "-o", str(out)])
    assert said.exit_code == 0, said.output
    assert "sortie-2: 8 viewpoints in " in said.output
    assert "Wh, from rally point 2 at (72.0, -12.0, 0.0) m" in said.output
    file.write_text(yaml.safe_dump({**scenario, "vehicle": {}}))
    assert CliRunner().invoke(cli, ["plan", str(file), "-o", str(out)]).exit_code == 0
    assert (out / "plan.json").is_file()
    assert not (out / "sorties.json").exists()


# ---- flown one by one, and by the station ----


@pytest.fixture
def station(tmp_path):
    database = Database(tmp_path)

    async def run(job_id, work, *args, tell):
        return work(SilentProgress(), *args)

    async def close():
        pass

    plans = PlanService(database, LiveFeed(), tmp_path, SimpleNamespace(run=run, close=close))
    plans.open()
    yield SimpleNamespace(database=database, plans=plans, folder=tmp_path)
    database.close()


def chosen(station, out, sortie=None, rest=False):
    scratch = station.folder / f"scratch-{len(list(station.folder.iterdir()))}"
    scratch.mkdir()
    return next_flight(out, sortie, rest, station.database, station.plans, scratch)


def fly(station, folder, viewpoints):
    """A flight of a plan that brought the pictures of some of its viewpoints."""
    plan_id, now = station.plans.adopt(folder).plan.id, utc_now()
    flight = f"flight-{len(station.database.flights.summaries()) + 1}"
    state, count = FlightState.INCOMPLETE, len(viewpoints)
    station.database.flights.add(
        FlightRecord(flight, plan_id, "", "px4-1", 1, FlightPath.MISSION, state, now, now, count)
    )
    for view in viewpoints:
        station.database.images.add(
            ImageRecord(f"{flight}-{view.id}", flight, view.id, view.id, view.name, ImageState.STORED, "link", now)
        )


def test_the_next_sortie_is_flown_from_its_own_place(out, station):
    first, second = part_directories(out)
    assert chosen(station, out) == (first, "sortie 1 of 2, from home at (-12.0, -12.0, 0.0) m")
    fly(station, first, read_plan(first).viewpoints)
    assert chosen(station, out) == (second, "sortie 2 of 2, from rally point 2 at (72.0, -12.0, 0.0) m")


def test_a_sortie_that_was_cut_short_goes_on_from_its_next_viewpoint_and_from_its_own_place(out, station):
    second = part_directories(out)[1]
    plan = read_plan(second)
    fly(station, second, plan.viewpoints[:3])
    rest = read_plan(chosen(station, out, sortie=2, rest=True).directory)
    assert [v.name for v in rest.viewpoints] == [v.name for v in plan.viewpoints[3:]]
    np.testing.assert_allclose(rest.trajectory.value([0.0, rest.trajectory.duration_s]), [RALLY_M] * 2, atol=1e-6)


def test_where_one_plan_is_wanted_the_folder_says_that_it_holds_several(out):
    with pytest.raises(InputError, match="several plans: give the folder of one"):
        read_plan(out)


async def test_the_station_lists_each_sortie_as_a_plan(scenario, station, box_folder):
    meshes = station.folder / "structures" / "boxes"
    meshes.mkdir(parents=True)
    shutil.copy(box_folder / "box.stl", meshes / "box.stl")
    placed = [{**mesh, "file": "boxes/box.stl"} for mesh in scenario["structure"]["meshes"]]
    asked = await station.plans.submit({**scenario, "structure": {"meshes": placed}})
    made = await station.plans.wait(asked.plan.id)
    assert made.plan.state is PlanState.READY, made.plan.failure
    views = {view.plan.name: view for view in station.plans.list()}
    assert set(views) == {"box, sortie 1 of 2", "box, sortie 2 of 2"}
    assert views["box, sortie 1 of 2"].plan.id == asked.plan.id
    for name, home in zip(sorted(views), (HOME_M, RALLY_M), strict=True):
        view = views[name]
        assert station.plans.read(view.plan.id).scenario.home_m == home
        assert tuple(view.plan.scenario["home_m"]) == home
        assert "mission.plan" in view.files
        assert failed(station.plans.directory(view.plan.id)) == set()
