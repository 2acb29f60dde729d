"""A battery that is not enough for all: sorties that are planned, written, proved, and flown one after the other."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import yaml

from gcs.core.clock import utc_now
from gcs.core.errors import ConflictError, InfeasibleError, InputError, RefusedError
from gcs.core.vehicle import Autopilot
from gcs.planning.dynamics.energy import energy_wh
from gcs.planning.flights.sorties import BATTERY_SWAP_S
from gcs.services.live_feed import LiveFeed
from gcs.services.mission_files import mission_of_plan
from gcs.services.plan_service import PlanService, plan_to_directory
from gcs.services.plan_verification import verify_plan
from gcs.services.remaining_flight import next_flight, pictured_before
from gcs.storage import sample_scenes as samples
from gcs.storage.database import Database
from gcs.storage.plan_files import is_plan_directory, part_directories, read_plan, read_report
from gcs.storage.records import FlightPath, FlightRecord, FlightState, ImageRecord, ImageState

CAPACITY_WH, RESERVE = 7.0, 0.25


def points():
    sides = {"west": (-1, 0), "south": (0, -1), "east": (1, 0), "north": (0, 1)}
    return [
        {"name": f"{name} {z}", "position_m": [2.0 * x, 2.0 * y, z], "normal": [x, y, 0]}
        for name, (x, y) in sides.items()
        for z in (4.0, 8.0)
    ]


@pytest.fixture(scope="module")
def scenario(box_scenario):
    battery = {"capacity_wh": CAPACITY_WH, "reserve": RESERVE}
    return {**box_scenario, "inspection": {"points": points()}, "vehicle": {"battery": battery}}


@pytest.fixture(scope="module")
def plan_it(tmp_path_factory, box_folder):
    def run(scenario):
        folder = tmp_path_factory.mktemp("sorties")
        shutil.copy(box_folder / "box.stl", folder / "box.stl")
        (folder / "box.yaml").write_text(yaml.safe_dump(scenario))
        return plan_to_directory(folder / "box.yaml", folder / "out"), folder / "out"

    return run


@pytest.fixture(scope="module")
def out(plan_it, scenario):
    """A plan of two or three sorties; to be read only."""
    return plan_it(scenario)[1]


def test_every_sortie_keeps_the_reserve_and_comes_home(out):
    plan = read_plan(out)
    assert 2 <= len(plan.sorties) <= 3
    assert [v for s in plan.sorties for v in s.viewpoints] == [v.id for v in plan.viewpoints]
    assert {v.name for v in plan.viewpoints} == {p["name"] for p in points()}
    for sortie in plan.sorties:
        needed = energy_wh(plan.trajectory, plan.scenario.vehicle, sortie.start_s, sortie.end_s)
        assert needed == pytest.approx(sortie.energy_wh, rel=1e-3)
        assert needed <= CAPACITY_WH * (1 - RESERVE)
        ends = plan.trajectory.value([sortie.start_s, sortie.end_s])
        np.testing.assert_allclose(ends, [plan.scenario.home_m] * 2, atol=1e-6)
    for before, after in zip(plan.sorties[:-1], plan.sorties[1:], strict=True):
        assert after.start_s - before.end_s == pytest.approx(BATTERY_SWAP_S)
    assert plan.certificates.energy_wh == pytest.approx(sum(s.energy_wh for s in plan.sorties))


def test_the_report_tells_of_them(out):
    sorties = read_report(out)["sorties"]
    assert [set(s) for s in sorties] == [{"viewpoints", "energy_wh", "duration_s", "start_s", "end_s"}] * len(sorties)
    assert all(s["duration_s"] == pytest.approx(s["end_s"] - s["start_s"]) for s in sorties)


def test_the_page_lists_them(out):
    page = (out / "report.html").read_text()
    assert "<h2>Sorties</h2>" in page
    assert "<h2>Sorties</h2>" not in (out / "sortie-1" / "report.html").read_text()


def test_each_is_a_complete_plan_of_its_own(out):
    whole, folders = read_plan(out), part_directories(out)
    assert [folder.name for folder in folders] == [f"sortie-{k + 1}" for k in range(len(whole.sorties))]
    for sortie, folder in zip(whole.sorties, folders, strict=True):
        part = read_plan(folder)
        assert is_plan_directory(folder)
        assert tuple(v.id for v in part.viewpoints) == sortie.viewpoints
        assert part.trajectory.duration_s == pytest.approx(sortie.duration_s)
        assert {p.name for p in part.scenario.inspection.points} == {v.name for v in part.viewpoints}
        assert (folder / "mission.plan").is_file()
    assert not (out / "mission.plan").exists()
    with pytest.raises(RefusedError, match="sorties"):
        mission_of_plan(whole, Autopilot.PX4)


@pytest.mark.parametrize(("name", "weight"), [("length", 1.0), ("energy", 3.0)])
def test_the_cost_is_that_of_the_asked_metric(plan_it, scenario, name, weight):
    _, folder = plan_it({**scenario, "planner": {"metric": name, "mu": 3.0, "k": 1.0}})
    plan = read_plan(folder)
    steps = np.diff(plan.path_m, axis=0) * [1.0, 1.0, weight**0.5]
    assert len(plan.sorties) >= 2
    assert plan.certificates.tour_metric == name
    assert plan.certificates.tour_cost == pytest.approx(np.linalg.norm(steps, axis=1).sum(), rel=1e-6)


def test_all_of_it_verifies(out):
    checks = verify_plan(out)
    assert [check.name for check in checks if not check.ok] == []
    assert {"sorties", "sortie-1: reserve", "sortie-2: min_clearance_m"} <= {check.name for check in checks}


def failed(out):
    return {check.name for check in verify_plan(out) if not check.ok}


def test_tampering_is_found(out, tmp_path):
    copy = shutil.copytree(out, tmp_path / "copy")
    document = json.loads((copy / "plan.json").read_text())
    document["sorties"][0]["energy_wh"] *= 0.5
    (copy / "plan.json").write_text(json.dumps(document))
    assert failed(copy) >= {"sortie-1: reserve", "report.json"}
    shutil.rmtree(copy / "sortie-2")
    assert "sorties" in failed(copy)
    shutil.copytree(copy / "sortie-1", copy / "sortie-2")
    assert "sortie-2: part of the whole" in failed(copy)


def test_enough_for_all_stays_one_flight(plan_it, scenario):
    battery = {"battery": {"capacity_wh": 100.0}}
    written, out = plan_it({**scenario, "vehicle": battery})
    assert written.plan.sorties == ()
    assert read_report(out)["sorties"] == []
    assert part_directories(out) == []
    assert (out / "mission.plan").is_file()


def test_too_small_for_a_single_viewpoint(plan_it, scenario):
    with pytest.raises(InfeasibleError, match=r"viewpoint \w+ \d\.0: .* takes \d+\.\d Wh, and 1\.5 Wh"):
        plan_it({**scenario, "vehicle": {"battery": {"capacity_wh": 2.0}}})


def test_faces_are_shared_too(plan_it, scenario):
    face = {"name": "south", "origin_m": [-2, -2, 3], "along_m": [4, 0, 0], "up_m": [0, 0, 6], "normal": [0, -1, 0]}
    inspection = {"points": points()[:2], "faces": [{**face, "cell_m": 1.0}]}
    battery = {"battery": {"capacity_wh": 9.0}}
    written, out = plan_it({**scenario, "inspection": inspection, "vehicle": battery})
    assert len(written.plan.sorties) > 1
    covered = [read_plan(folder).faces[0].covered for folder in part_directories(out)]
    assert sum(covered) == written.plan.faces[0].covered == 24
    assert failed(out) == set()


def test_the_sample_crane_on_small_batteries(plan_it):
    """About 12.5 Wh in one flight; a flight there and back is about 3 Wh of it."""
    sample = yaml.safe_load((Path(samples.__file__).parent / "samples" / "gantry-crane.scenario.yaml").read_text())
    sample["vehicle"]["battery"] = {"capacity_wh": 12.0, "reserve": 0.25}
    written, out = plan_it(sample)
    assert 2 <= len(written.plan.sorties) <= 3
    assert sum(len(s.viewpoints) for s in written.plan.sorties) == 18
    assert max(s.energy_wh for s in written.plan.sorties) <= 9.0
    assert failed(out) == set()


# ---- which one is flown next ----


@pytest.fixture
def station(tmp_path):
    database = Database(tmp_path)
    plans = PlanService(database, LiveFeed(), tmp_path, SimpleNamespace())
    plans.open()
    yield SimpleNamespace(database=database, plans=plans, scratch=tmp_path)
    database.close()


def chosen(station, out, sortie=None, rest=False):
    scratch = station.scratch / f"scratch-{len(list(station.scratch.iterdir()))}"
    scratch.mkdir()
    return next_flight(out, sortie, rest, station.database, station.plans, scratch)


def fly(station, folder, viewpoints):
    """A flight of a plan that brought the pictures of some of its viewpoints."""
    number = len(station.database.flights.summaries()) + 1
    plan_id, flight_id, now = station.plans.adopt(folder).plan.id, f"flight-{number}", utc_now()
    record = FlightRecord(
        flight_id, plan_id, "", "px4-1", 1, FlightPath.MISSION, FlightState.INCOMPLETE, now, now, len(viewpoints)
    )
    station.database.flights.add(record)
    for view in viewpoints:
        image = f"image-{number}-{view.id}"
        station.database.images.add(
            ImageRecord(image, flight_id, view.id, view.id, view.name, ImageState.STORED, "link", now)
        )


def test_the_first_sortie_without_all_its_pictures_comes_next(out, station):
    first, second, *_ = part_directories(out)
    assert chosen(station, out).directory == first
    fly(station, first, read_plan(first).viewpoints)
    assert chosen(station, out).directory == second
    assert chosen(station, out, sortie=1).directory == first
    for folder in part_directories(out)[1:]:
        fly(station, folder, read_plan(folder).viewpoints)
    with pytest.raises(InputError, match="all sorties"):
        chosen(station, out)


def test_a_sortie_that_was_cut_short_goes_on_from_its_next_viewpoint(out, station):
    folders = part_directories(out)
    number, plan = max(enumerate(map(read_plan, folders), start=1), key=lambda part: len(part[1].viewpoints))
    assert len(plan.viewpoints) >= 4
    fly(station, folders[number - 1], plan.viewpoints[:2])
    again = chosen(station, out, sortie=number, rest=True)
    rest = read_plan(again.directory)
    assert [v.name for v in rest.viewpoints] == [v.name for v in plan.viewpoints[2:]]
    assert f"from {plan.viewpoints[2].name} on" in again.said
    np.testing.assert_allclose(rest.trajectory.value([0.0])[0], plan.scenario.home_m, atol=1e-6)
    assert rest.certificates.energy_wh < plan.certificates.energy_wh
    fly(station, again.directory, rest.viewpoints[:1])
    assert pictured_before(plan, station.database, station.plans) == {v.id for v in plan.viewpoints[:3]}


def test_a_rest_of_which_nothing_was_flown_is_the_plan_itself(out, station):
    assert chosen(station, out, sortie=2, rest=True).directory == part_directories(out)[1]


def test_a_sortie_that_is_not_there(out, station):
    with pytest.raises(InputError, match=r"--sortie.*no sortie 9"):
        chosen(station, out, sortie=9)
    with pytest.raises(InputError, match="one flight"):
        chosen(station, part_directories(out)[0], sortie=1)


def test_nothing_is_left(out, station):
    first = part_directories(out)[0]
    fly(station, first, read_plan(first).viewpoints)
    with pytest.raises(InputError, match="nothing is left"):
        chosen(station, out, sortie=1, rest=True)


def test_the_station_takes_sorties_as_plans_of_their_own(out, station):
    station.plans.adopt(out)
    names = {view.plan.name for view in station.plans.list()}
    count = len(part_directories(out))
    assert names == {"box", *(f"box, sortie {k} of {count}" for k in range(1, count + 1))}


async def test_the_whole_is_not_flown_at_once(out, station):
    from gcs.services.flight_service import FlightControlService

    vehicles = SimpleNamespace(vehicle=lambda name: SimpleNamespace(identity=SimpleNamespace(name=name, system_id=1)))
    flights = FlightControlService(station.database, None, None, LiveFeed(), station.plans, vehicles)
    with pytest.raises(ConflictError, match="sorties"):
        await flights.create(station.plans.adopt(out).plan.id, "px4-1", FlightPath.MISSION)
