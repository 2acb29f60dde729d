"""What became of the cells of faces, in plan.json and report.json."""

import json
from dataclasses import replace

import jsonschema
import pytest

from gcs.core.errors import InputError
from gcs.core.plan import CellNote, FaceCoverage
from gcs.storage import plan_files

MOVED = (CellNote("south-r01-c01", "too near the ground"),)
MISSED = (CellNote("south-r02-c01", "a cable hides part of it"), CellNote("south-r03-c01", "the structure <hides> it"))
FACES = (FaceCoverage("south", 6, MOVED, MISSED), FaceCoverage("north", 6, (), ()))


@pytest.fixture
def out(tmp_path, small_plan, small_structure):
    plan_files.write_plan(replace(small_plan, faces=FACES), small_structure, tmp_path / "out")
    return tmp_path / "out"


def test_faces_come_back_exactly(out):
    assert plan_files.read_plan(out).faces == FACES
    document = json.loads((out / "plan.json").read_text())
    jsonschema.Draft202012Validator(json.loads(plan_files.plan_schema())).validate(document)


def test_the_report_says_how_many_cells_are_covered_and_why_others_are_not(out):
    south, north = json.loads((out / "report.json").read_text())["faces"]
    assert (south["name"], south["cells"], south["covered"]) == ("south", 6, 4)
    assert south["not_covered"] == [{"cell": note.cell, "reason": note.reason} for note in MISSED]
    assert south["moved"] == [{"cell": note.cell, "reason": note.reason} for note in MOVED]
    assert north == {"name": "north", "cells": 6, "covered": 6, "moved": [], "not_covered": []}


def test_a_plan_whose_cells_do_not_add_up_is_damaged(out):
    document = json.loads((out / "plan.json").read_text())
    document["faces"][0]["covered"] = 6
    (out / "plan.json").write_text(json.dumps(document))
    with pytest.raises(InputError, match="faces"):
        plan_files.read_plan(out)


def test_a_plan_without_faces_says_nothing_of_them(tmp_path, small_plan, small_structure):
    plan_files.write_plan(small_plan, small_structure, tmp_path / "out")
    assert plan_files.read_plan(tmp_path / "out").faces == ()
    assert json.loads((tmp_path / "out" / "report.json").read_text())["faces"] == []
