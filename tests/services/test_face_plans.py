"""A face from the scenario file to the written plan, and its check."""

import json
import shutil
from dataclasses import replace

import pytest
import yaml

from gcs.core.errors import InputError
from gcs.core.plan import CellNote, FaceCoverage
from gcs.services.plan_service import plan_to_directory
from gcs.services.plan_verification import verify_plan
from gcs.services.report_page import report_page
from gcs.storage.plan_files import plan_report, read_plan, read_structure

WEST = {
    "name": "west",
    "origin_m": [-2, 2, 0],
    "along_m": [0, -4, 0],
    "up_m": [0, 0, 10],
    "normal": [-1, 0, 0],
    "cell_m": 2.0,
}


def planned(box_folder, box_scenario, folder, face):
    shutil.copy(box_folder / "box.stl", folder)
    (folder / "face.yaml").write_text(yaml.safe_dump({**box_scenario, "inspection": {"faces": [face]}}))
    return plan_to_directory(folder / "face.yaml", folder / "out")


@pytest.fixture(scope="module")
def face_plan(box_folder, box_scenario, tmp_path_factory):
    folder = tmp_path_factory.mktemp("faces")
    planned(box_folder, box_scenario, folder, WEST)
    return folder / "out"


def test_a_face_is_planned_written_and_verified(face_plan):
    report = json.loads((face_plan / "report.json").read_text())
    (face,) = report["faces"]
    assert (face["name"], face["cells"], face["covered"], face["not_covered"]) == ("west", 10, 10, [])
    assert report["viewpoints"] == 10
    assert {v.name for v in read_plan(face_plan).viewpoints} == {
        f"west-r0{r}-c0{c}" for r in range(1, 6) for c in (1, 2)
    }
    checks = verify_plan(face_plan)
    assert [check.name for check in checks if not check.ok] == []
    assert "west" in {check.name for check in checks}


def test_cells_that_no_picture_shows_are_found(face_plan, tmp_path):
    plan = shutil.copytree(face_plan, tmp_path / "plan")
    document = json.loads((plan / "plan.json").read_text())
    document["viewpoints"][0]["name"], document["viewpoints"][1]["name"] = "elsewhere", "nowhere"
    (plan / "plan.json").write_text(json.dumps(document))
    failed = {check.name: check for check in verify_plan(plan) if not check.ok}
    assert failed["west"].value == 8
    assert "8 of 10 cells are seen whole, reported 10" in failed["west"].message


def test_a_report_that_tells_of_more_cells_than_the_plan_is_found(face_plan, tmp_path):
    plan = shutil.copytree(face_plan, tmp_path / "plan")
    report = json.loads((plan / "report.json").read_text())
    report["faces"][0]["cells"] = 11
    (plan / "report.json").write_text(json.dumps(report))
    (check,) = (check for check in verify_plan(plan) if not check.ok)
    assert check.name == "report.json"
    assert "faces" in check.message


def test_the_page_lists_the_cells_by_their_reasons(face_plan):
    notes = tuple(CellNote(f"west-r0{r}-c01", "a cable <hides> it") for r in (1, 2))
    faces = (FaceCoverage("west", 10, (CellNote("west-r05-c02", "too near"),), notes),)
    plan = replace(read_plan(face_plan), faces=faces)
    page = report_page(plan, read_structure(face_plan), plan_report(plan))
    assert "<li>a cable &lt;hides&gt; it (2): west-r01-c01, west-r02-c01</li>" in page
    assert "<li>too near (1): west-r05-c02</li>" in page
    assert "<h2>Faces</h2>" not in report_page(replace(plan, faces=()), read_structure(face_plan), plan_report(plan))


def test_a_face_beside_the_mesh_is_bad_input(box_folder, box_scenario, tmp_path):
    with pytest.raises(InputError, match=r"inspection\.faces\.west: the face lies up to 3\.00 m from any surface"):
        planned(box_folder, box_scenario, tmp_path, {**WEST, "origin_m": [-5, 2, 0]})
    assert not (tmp_path / "out").exists()
