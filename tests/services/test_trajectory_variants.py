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


@pytest.mark.parametrize("kind", ["tubes", "polytopes"])
def test_a_written_corridor_of_planes_holds_the_written_curve(kind, box_scenario, tmp_path):
    trimesh.creation.box((4, 4, 10)).apply_translation([0, 0, 5]).export(tmp_path / "box.stl")
    out = tmp_path / "out"
    scenario = parse_scenario(box_scenario | {"planner": {"corridor": kind}})
    write_planned(scenario, tmp_path, out, SilentProgress())
    assert [check for check in verify_plan(out) if not check.ok] == []
    document = json.loads((out / "plan.json").read_text())
    sets = [np.array(planes) for planes in document["corridor_planes"]]
    assert len(sets) == len(document["trajectory"]["durations_s"]) == len(document["corridor"])
    assert max(len(planes) for planes in sets) > 6
    powers = np.linspace(0, 1, 50)[:, None] ** np.arange(8)
    for planes, coefficients in zip(sets, document["trajectory"]["coefficients_m"], strict=True):
        points = powers @ np.array(coefficients)
        assert (points @ planes[:, :3].T - planes[:, 3]).max() <= 1e-9
    moved = document["corridor_planes"][3][0]
    moved[3] -= 5.0
    (out / "plan.json").write_text(json.dumps(document))
    failed = {check.name for check in verify_plan(out) if not check.ok}
    assert "corridor_violation_m" in failed
    document["corridor_planes"].pop()
    (out / "plan.json").write_text(json.dumps(document))
    (check,) = verify_plan(out)
    assert not check.ok
    assert "corridor_planes" in check.message


def test_flights_on_several_batteries_keep_their_planes(box_scenario, tmp_path):
    trimesh.creation.box((4, 4, 10)).apply_translation([0, 0, 5]).export(tmp_path / "box.stl")
    points = [{"name": f"P{x}", "position_m": [2.0 * x, 0.0, 6.0], "normal": [x, 0.0, 0.0]} for x in (-1, 1)]
    scenario = box_scenario | {
        "planner": {"corridor": "tubes"},
        "inspection": {"points": points},
        "vehicle": {"battery": {"capacity_wh": 3.4}},
    }
    write_planned(parse_scenario(scenario), tmp_path, tmp_path / "out", SilentProgress())
    assert [check for check in verify_plan(tmp_path / "out") if not check.ok] == []
    document = json.loads((tmp_path / "out" / "plan.json").read_text())
    assert len(document["sorties"]) > 1
    assert len(document["corridor_planes"]) == len(document["trajectory"]["durations_s"])


def test_a_kind_of_corridor_without_a_corridor_is_refused(box_scenario):
    with pytest.raises(InputError, match="corridor: tubes needs trajectory: corridor, not plain"):
        parse_scenario(box_scenario | {"planner": {"trajectory": "plain", "corridor": "tubes"}})


def test_another_word_is_refused_by_name(box_scenario):
    with pytest.raises(InputError, match=r"planner\.trajectory: .*'plain', 'corrected', 'geometric' or 'corridor'"):
        parse_scenario(asked(box_scenario, "straight"))
