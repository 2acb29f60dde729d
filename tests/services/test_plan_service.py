import json
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
import trimesh

from gcs.core.errors import ConflictError, InputError, NotFoundError, OperationCancelled
from gcs.core.progress import SilentProgress
from gcs.core.scenario import parse_scenario
from gcs.services.live_feed import LiveFeed
from gcs.services.plan_service import PlanService, plan_to_directory, write_planned
from gcs.storage.database import Database
from gcs.storage.mesh_files import sample_scenario
from gcs.storage.plan_files import FILE_NAMES, plan_hash, read_plan, write_plan


@pytest.fixture
def service(tmp_path):
    database = Database(tmp_path)
    service = PlanService(database, LiveFeed(), tmp_path, jobs=None)
    service.open()
    yield service
    database.close()


@pytest.fixture
def scenario_file(tmp_path, scenario_data):
    trimesh.creation.box((4, 4, 20)).export(tmp_path / "box.stl")
    path = tmp_path / "scenario.json"
    path.write_text(json.dumps(scenario_data))
    return path


@pytest.fixture
def planner(monkeypatch, small_plan):
    """The planner's front door, which plans in no time."""
    calls = []

    def make_plan(scenario, structure, progress):
        calls.append((scenario, structure))
        progress.report("tour", 0.5)
        return small_plan

    monkeypatch.setitem(sys.modules, "gcs.planning.planner", SimpleNamespace(make_plan=make_plan))
    return calls


def test_from_a_scenario_file_to_all_files(scenario_file, planner, tmp_path):
    written = plan_to_directory(scenario_file, tmp_path / "out")
    assert written.plan_hash == plan_hash(tmp_path / "out")
    assert written.plan.viewpoints[0].name == "A, west"
    assert {p.name for p in (tmp_path / "out").iterdir()} == set(FILE_NAMES)
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert report["mission_items"] > 3
    ((scenario, structure),) = planner
    assert len(scenario.structure.meshes[0].sha256) == 64
    assert len(structure.faces) == 12


def test_a_folder_with_other_files_is_refused_before_any_planning(scenario_file, planner, tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "notes.txt").write_text("mine")
    with pytest.raises(InputError, match="other files"):
        plan_to_directory(scenario_file, tmp_path / "out")
    assert planner == []


def test_a_cancel_leaves_nothing_behind(scenario_file, planner, tmp_path):
    class Cancelled:
        def report(self, stage, fraction):
            if stage == "write":
                raise OperationCancelled("stop")

    before = set(tmp_path.iterdir())
    with pytest.raises(OperationCancelled):
        plan_to_directory(scenario_file, tmp_path / "out", Cancelled())
    assert set(tmp_path.iterdir()) == before


def test_a_missing_mesh_is_named(tmp_path, scenario_data, planner):
    (tmp_path / "s.json").write_text(json.dumps(scenario_data))
    with pytest.raises(InputError, match=r"box\.stl"):
        plan_to_directory(tmp_path / "s.json", tmp_path / "out")


def test_a_plan_written_elsewhere_is_taken_over_once(service, tmp_path, small_plan, small_structure):
    out = tmp_path / "out"
    write_plan(small_plan, small_structure, out)
    view = service.adopt(out)
    assert view.plan.plan_hash == plan_hash(out)
    assert plan_hash(service.directory(view.plan.id)) == plan_hash(out)
    assert service.read(view.plan.id).viewpoints[0].name == "A, west"
    assert service.anchor(view.plan.id).altitude_m == 4.0
    assert service.adopt(out).plan.id == view.plan.id
    assert len(service.list()) == 1


def test_a_folder_without_a_plan_is_not_taken_over(service, tmp_path):
    with pytest.raises(InputError, match="no such plan"):
        service.adopt(tmp_path / "nothing")
    assert service.list() == []


@pytest.mark.parametrize("name", ["plan.json", "report.json", "structure.ply"])
@pytest.mark.parametrize("content", [None, b"", b"["])
def test_a_damaged_folder_is_not_taken_over(service, tmp_path, small_plan, small_structure, name, content):
    out = tmp_path / "out"
    write_plan(small_plan, small_structure, out)
    (out / name).unlink() if content is None else (out / name).write_bytes(content)
    with pytest.raises(InputError, match=name):
        service.adopt(out)
    assert service.list() == []
    assert list((tmp_path / "plans").iterdir()) == []


def test_a_plan_is_removed_with_its_files(service, tmp_path, small_plan, small_structure):
    write_plan(small_plan, small_structure, tmp_path / "out")
    view = service.adopt(tmp_path / "out")
    folder = service.directory(view.plan.id)
    service.delete(view.plan.id)
    assert not folder.exists()
    with pytest.raises(NotFoundError):
        service.directory(view.plan.id)


async def test_only_what_is_being_made_is_cancelled(service, tmp_path, small_plan, small_structure):
    write_plan(small_plan, small_structure, tmp_path / "out")
    view = service.adopt(tmp_path / "out")
    with pytest.raises(ConflictError):
        await service.cancel(view.plan.id)


@pytest.mark.system
def test_the_sample_is_planned_and_an_independent_check_agrees(tmp_path):
    root = Path(__file__).resolve().parents[2]
    checker = root.parent / "shared" / "verify" / "check_plan.py"
    if not checker.is_file():
        pytest.skip("the independent checker is not here")
    written = write_planned(
        parse_scenario(sample_scenario("gantry-crane")), tmp_path, tmp_path / "out", SilentProgress()
    )
    assert read_plan(tmp_path / "out").certificates == written.plan.certificates
    done = subprocess.run(
        [sys.executable, str(checker), str(tmp_path / "out")], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
