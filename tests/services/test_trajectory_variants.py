"""Plans of every `planner.trajectory` from a scenario to its folder and back through the check of the files."""

import json

import numpy as np
import pytest
import trimesh

from gcs.core.errors import InputError
from gcs.core.progress import SilentProgress
from gcs.core.scenario import parse_scenario
from gcs.services.plan_service import write_planned
from gcs.services.plan_verification import verify_plan


def asked(box_scenario, variant):
    return box_scenario | {"planner": {"trajectory": variant}}


@pytest.mark.parametrize("variant", ["plain", "corrected", "geometric", "corridor"])
def test_a_written_plan_is_checked_from_its_files(variant, box_scenario, tmp_path):
    trimesh.creation.box((4, 4, 10)).apply_translation([0, 0, 5]).export(tmp_path / "box.stl")
    out = tmp_path / "out"
    write_planned(parse_scenario(asked(box_scenario, variant)), tmp_path, out, SilentProgress())
    assert [check for check in verify_plan(out) if not check.ok] == []
    document = json.loads((out / "plan.json").read_text())
    assert document["scenario"]["planner"]["trajectory"] == variant
    boxes = np.array([[b["low_m"], b["high_m"]] for b in document["corridor"]])
    assert len(boxes) == len(document["trajectory"]["durations_s"])
    rows = np.genfromtxt(out / "trajectory.csv", delimiter=",", names=True)
    starts = np.concatenate([[0.0], np.cumsum(document["trajectory"]["durations_s"])])
    piece = np.clip(np.searchsorted(starts, rows["t_s"], side="right") - 1, 0, len(boxes) - 1)
    places = np.column_stack([rows["x_m"], rows["y_m"], rows["z_m"]])
    assert (places >= boxes[piece, 0] - 1e-3).all()
    assert (places <= boxes[piece, 1] + 1e-3).all()


def test_another_word_is_refused_by_name(box_scenario):
    with pytest.raises(InputError, match=r"planner\.trajectory: .*'plain', 'corrected', 'geometric' or 'corridor'"):
        parse_scenario(asked(box_scenario, "straight"))
