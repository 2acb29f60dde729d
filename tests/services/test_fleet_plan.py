"""One inspection by two vehicles: planned, written, proved apart, and checked again."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml
from click.testing import CliRunner

from gcs.cli import cli
from gcs.core.errors import InfeasibleError, InputError
from gcs.services.plan_service import plan_to_directory
from gcs.services.plan_verification import verify_plan
from gcs.services.remaining_flight import next_flight
from gcs.storage import sample_scenes as samples
from gcs.storage.plan_files import is_group_directory, part_directories, read_plan
from gcs.storage.plan_group_files import read_group


def points():
    sides = {"west": (-1, 0), "south": (0, -1), "east": (1, 0), "north": (0, 1)}
    return [
        {"name": f"{name} {z}", "position_m": [2.0 * x, 2.0 * y, z], "normal": [x, y, 0]}
        for name, (x, y) in sides.items()
        for z in (4.0, 8.0)
    ]


@pytest.fixture(scope="module")
def scenario(box_scenario):
    return {**box_scenario, "inspection": {"points": points()}, "vehicle": {"count": 2}}


@pytest.fixture(scope="module")
def files(tmp_path_factory, box_folder):
    def write(scenario):
        folder = tmp_path_factory.mktemp("fleet")
        shutil.copy(box_folder / "box.stl", folder / "box.stl")
        (folder / "box.yaml").write_text(yaml.safe_dump(scenario))
        return folder / "box.yaml", folder / "out"

    return write


@pytest.fixture(scope="module")
def out(files, scenario):
    """Plans of two vehicles; to be read only."""
    file, out = files(scenario)
    plan_to_directory(file, out)
    return out


def test_the_work_is_shared_and_done_sooner(out, files, scenario):
    fleet = read_group(out)
    assert sorted(name for v in fleet.vehicles for name in v.viewpoints) == sorted(p["name"] for p in points())
    alone = plan_to_directory(*files({**scenario, "vehicle": {}})).plan.certificates.duration_s
    assert fleet.duration_lower_bound_s <= fleet.duration_s < 0.8 * alone
    assert min(v.start_s for v in fleet.vehicles) == 0.0


def test_they_are_never_nearer_than_asked(out):
    """By dense samples: 5 m and the errors of both, 2 x 0.8 m."""
    fleet = read_group(out)
    plans = [read_plan(folder) for folder in part_directories(out)]
    times = np.arange(-1.0, fleet.duration_s + 1.0, 0.01)
    a, b = (p.trajectory.value(times - v.start_s) for p, v in zip(plans, fleet.vehicles, strict=True))
    nearest = np.linalg.norm(a - b, axis=1).min()
    assert fleet.apart_m == pytest.approx(6.6)
    assert nearest >= fleet.apart_m
    assert nearest - 0.1 <= fleet.min_separation_m <= nearest


def test_each_has_a_pad_and_a_complete_plan_of_its_own(out):
    assert is_group_directory(out)
    homes = []
    for folder in part_directories(out):
        plan = read_plan(folder)
        homes.append(plan.scenario.home_m)
        assert plan.scenario.vehicle.count == 1
        ends = plan.trajectory.value([0.0, plan.trajectory.duration_s])
        np.testing.assert_allclose(ends, [plan.scenario.home_m] * 2, atol=1e-6)
        assert (folder / "mission.plan").is_file()
    assert np.linalg.norm(np.subtract(*homes)) >= 6.6


def failed(out):
    return {check.name for check in verify_plan(out) if not check.ok}


def test_all_of_it_verifies(out):
    names = {check.name for check in verify_plan(out)}
    assert failed(out) == set()
    assert {"min_separation_m", "fleet.json", "vehicle-2: min_clearance_m"} <= names


def test_vehicles_that_start_at_another_time_are_found(out, tmp_path):
    copy = shutil.copytree(out, tmp_path / "copy")
    document = json.loads((copy / "fleet.json").read_text())
    other = copy / "vehicle-2"
    shutil.rmtree(other)
    shutil.copytree(copy / "vehicle-1", other)
    assert failed(copy) >= {"min_separation_m", "fleet.json"}
    document["vehicles"][0]["directory"] = "vehicle-9"
    (copy / "fleet.json").write_text(json.dumps(document))
    assert failed(copy) == {str(copy / "fleet.json")}
    shutil.rmtree(other)
    (copy / "fleet.json").write_text((out / "fleet.json").read_text())
    assert failed(copy) == {"fleet.json"}


def test_two_about_the_sample_crane(files):
    sample = yaml.safe_load((Path(samples.__file__).parent / "samples" / "gantry-crane.scenario.yaml").read_text())
    sample["vehicle"]["count"] = 2
    file, out = files(sample)
    fleet = plan_to_directory(file, out).document
    assert fleet.viewpoints == 18
    assert fleet.min_separation_m >= fleet.apart_m
    assert failed(out) == set()


def test_they_are_flown_one_by_one(out, tmp_path):
    with pytest.raises(InputError, match="vehicle-1"):
        next_flight(out, None, False, None, None, tmp_path)


def test_the_command_writes_them_and_replaces_them(files, scenario):
    file, out = files(scenario)
    for _ in range(2):
        said = CliRunner().invoke(cli, ["plan", str(file), "-o", str(out)])
        assert said.exit_code == 0, said.output
    assert "vehicle-2: " in said.output
    assert "6.60 m asked" in said.output
    assert CliRunner().invoke(cli, ["verify", str(out)]).exit_code == 0


@pytest.mark.parametrize(
    ("vehicle", "safety", "error", "words"),
    [
        ({"count": 9}, {}, InputError, r"vehicle\.count.*9 vehicles for 8 viewpoints"),
        ({"count": 2, "pads_m": [[-10.0, -12.0, 0.0]]}, {}, InputError, r"vehicle\.pads_m.*2\.0 m apart"),
        ({"count": 2, "battery": {"capacity_wh": 3.0}}, {}, InfeasibleError, r"vehicle\.battery"),
        ({"count": 2}, {"separation_m": 200.0}, InfeasibleError, r"safety\.separation_m|no way leads"),
    ],
)
def test_what_cannot_be(files, scenario, vehicle, safety, error, words):
    file, out = files({**scenario, "vehicle": vehicle, "safety": safety})
    with pytest.raises(error, match=words):
        plan_to_directory(file, out)
    assert not out.exists()
