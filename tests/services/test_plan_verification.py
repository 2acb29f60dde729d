"""A good plan verifies from its files alone; one that was tampered with does not, and what is wrong is named."""

from __future__ import annotations

import json
import shutil
from functools import partial

import pytest

from gcs.core.errors import InputError
from gcs.services import plan_verification
from gcs.services.plan_verification import verify_plan
from gcs.storage.plan_files import plan_tables, read_plan, read_structure
from gcs.storage.ply_files import ply_bytes


@pytest.fixture(autouse=True)
def few_samples(monkeypatch):
    monkeypatch.setattr(
        plan_verification, "recheck_coverage", partial(plan_verification.recheck_coverage, samples=10_000)
    )


@pytest.fixture
def plan(box_plan, tmp_path):
    """A copy to tamper with."""
    return shutil.copytree(box_plan, tmp_path / "plan")


def failed(plan):
    return {check.name for check in verify_plan(plan) if not check.ok}


def rewrite(plan, change):
    """Change plan.json, and make the tables follow, as somebody thorough would."""
    document = json.loads((plan / "plan.json").read_text())
    change(document)
    (plan / "plan.json").write_text(json.dumps(document))
    for name, content in plan_tables(read_plan(plan)).items():
        (plan / name).write_bytes(content)
    report = json.loads((plan / "report.json").read_text())
    (plan / "report.json").write_text(json.dumps({**report, **document["certificates"]}))


def moved_structure(plan, by_m):
    structure = read_structure(plan)
    (plan / "structure.ply").write_bytes(ply_bytes(structure.vertices_m + by_m, structure.faces))


def test_a_good_plan_verifies(box_plan):
    checks = verify_plan(box_plan)
    assert [check.name for check in checks if not check.ok] == []
    names = {check.name for check in checks}
    assert names >= {"coverable", "coverage_reasons", "not_covered_m2", "gimbal_range", "viewpoints_lower_bound"}
    assert names >= {"min_clearance_m", "max_speed_m_s", "max_acceleration_m_s2", "continuity", "coverage", "W"}
    assert names >= {"trajectory.csv", "viewpoints.csv", "path.csv", "report.json", "mission.plan", "energy_wh"}


def test_a_bent_trajectory_is_found(plan):
    def bend(document):
        middle = len(document["trajectory"]["coefficients_m"]) // 2
        box = document["corridor"][middle]
        width, axis = min(
            (high - low, axis) for axis, (low, high) in enumerate(zip(box["low_m"], box["high_m"], strict=True))
        )
        document["trajectory"]["coefficients_m"][middle][0][axis] += width

    rewrite(plan, bend)
    assert failed(plan) >= {"continuity", "corridor_violation_m"}


def test_a_faster_trajectory_is_found(plan):
    def hurry(document):
        document["trajectory"]["durations_s"] = [t * 0.8 for t in document["trajectory"]["durations_s"]]
        for timed in (*document["viewpoints"], *document["events"]):
            timed["time_s"] *= 0.8

    rewrite(plan, hurry)
    assert failed(plan) >= {"max_acceleration_m_s2", "recorded duration_s"}


@pytest.mark.parametrize("name", ["trajectory.csv", "viewpoints.csv", "path.csv", "mission.plan", "mission.waypoints"])
def test_a_changed_digit_of_a_table_is_found(plan, name):
    content = (plan / name).read_text()
    place = next(k for k in range(len(content) * 2 // 3, len(content)) if content[k] in "12345678")
    (plan / name).write_text(content[:place] + str(int(content[place]) + 1) + content[place + 1 :])
    assert failed(plan) == {name}


@pytest.mark.parametrize("name", ["trajectory.csv", "mission.plan"])
def test_a_missing_table_is_found(plan, name):
    (plan / name).unlink()
    assert failed(plan) == {name}


@pytest.mark.parametrize(
    ("key", "value"),
    [("min_clearance_m", 99.0), ("coverage", 0.5), ("length_m", 1.0), ("mission_items", 1), ("energy_wh", None)],
)
def test_a_changed_figure_of_the_report_is_found(plan, key, value):
    report = json.loads((plan / "report.json").read_text())
    (plan / "report.json").write_text(json.dumps({**report, key: value}))
    (check,) = [check for check in verify_plan(plan) if not check.ok]
    assert check.name == "report.json"
    assert key in check.message


@pytest.mark.parametrize(
    ("key", "value", "found"),
    [
        ("min_clearance_m", 99.0, "recorded min_clearance_m"),
        ("duration_s", 1.0, "recorded duration_s"),
        ("energy_wh", 0.1, "energy_wh"),
        ("coverage", 1.5, "coverage"),
    ],
)
def test_a_figure_that_is_wrong_in_all_files_is_computed_again(plan, key, value, found):
    rewrite(plan, lambda document: document["certificates"].update({key: value}))
    follows = {"own_ways"} if key == "min_clearance_m" else set()  # how accurately the way back must be remembered
    assert failed(plan) == {found} | follows


def test_a_viewpoint_that_is_not_passed_is_found(plan):
    def shift(document):
        document["viewpoints"][0]["position_m"][0] += 1.0

    rewrite(plan, shift)
    assert "worst_viewpoint_miss_m" in failed(plan)


def test_a_camera_that_looks_elsewhere_is_found(plan):
    def turn(document):
        for viewpoint in document["viewpoints"]:
            viewpoint["direction"] = [-c for c in viewpoint["direction"]]

    rewrite(plan, turn)
    assert failed(plan) >= {"viewing_angles", "W", "coverage"}


def test_a_side_that_was_given_another_reason_is_found(plan):
    def blame(document):
        for side in ("front", "back"):
            document["coverage"][side] = document["coverage"][side].replace("a", "8")

    rewrite(plan, blame)
    assert failed(plan) == {"coverage_reasons", "not_covered_m2"}


def test_more_that_is_coverable_than_there_is_is_found(plan):
    rewrite(plan, lambda document: document["certificates"].update(coverable=0.9))
    assert failed(plan) == {"coverable"}


def test_a_bound_over_the_number_of_viewpoints_is_found(plan):
    rewrite(plan, lambda document: document["certificates"].update(viewpoints_lower_bound=1e3))
    assert failed(plan) == {"viewpoints_lower_bound"}


def test_a_plan_that_keeps_silent_on_the_surface_is_found(plan):
    rewrite(plan, lambda document: document.update(coverage=None))
    assert failed(plan) == {"coverage"}


def test_a_camera_that_would_have_to_look_too_far_up_is_found(plan):
    def limit(document):
        document["scenario"]["camera"]["gimbal"].update(pitch_max_deg=-89.0)
        document["camera"]["gimbal"].update(pitch_max_deg=-89.0)

    rewrite(plan, limit)
    assert "gimbal_range" in failed(plan)


def test_a_structure_that_is_nearer_is_found(plan):
    (before,) = [check.value for check in verify_plan(plan) if check.name == "min_clearance_m"]
    moved_structure(plan, [-1.5, 0.0, 0.0])
    checks = {check.name: check for check in verify_plan(plan)}
    assert not checks["min_clearance_m"].ok
    assert checks["min_clearance_m"].value < before - 1.0
    assert not checks["recorded min_clearance_m"].ok


def test_a_structure_that_is_further_away_is_found_too(plan):
    moved_structure(plan, [0.0, 0.0, -3.0])
    assert failed(plan) & {"recorded min_clearance_m", "coverage", "W"}


@pytest.mark.parametrize(
    "change",
    [
        lambda d: d["corridor"].pop(),
        lambda d: d["path"]["stops"].pop(),
        lambda d: d["trajectory"]["durations_s"].__setitem__(0, 0.0),
        lambda d: d["yaw"]["angles_rad"].pop(),
        lambda d: d["gimbal_pitch"]["times_s"].reverse(),
        lambda d: d["camera"].update(focal_length_mm=88.0),
        lambda d: d["tour"]["order"].reverse(),
        lambda d: d["events"].pop(1),
        lambda d: d["coverage"].update(front=d["coverage"]["front"][1:]),
    ],
)
def test_parts_that_do_not_fit_each_other_are_damage(plan, change):
    document = json.loads((plan / "plan.json").read_text())
    change(document)
    (plan / "plan.json").write_text(json.dumps(document))
    (check,) = verify_plan(plan)
    assert not check.ok
    assert "does not fit the other parts" in check.message


@pytest.mark.parametrize("name", ["plan.json", "structure.ply", "report.json"])
@pytest.mark.parametrize("content", [b"", b"[", b"\xff\xfe"])
def test_a_damaged_file_is_the_one_check_that_fails(plan, name, content):
    (plan / name).write_bytes(content)
    (check,) = verify_plan(plan)
    assert not check.ok
    assert check.name.endswith(name)
    assert "plan again" in check.message or "gcs wrote" in check.message


def test_a_structure_with_nan_is_damaged(plan):
    moved_structure(plan, [float("nan"), 0.0, 0.0])
    (check,) = verify_plan(plan)
    assert not check.ok
    assert "NaN" in check.message


def test_no_plan_at_all_is_bad_input(tmp_path):
    with pytest.raises(InputError, match="no such plan"):
        verify_plan(tmp_path)


@pytest.mark.parametrize(
    "changes",
    [
        {"action": "retrace"},
        {"return_blocked_s": [[1.0, 2.0]]},
        {"landing_blocked_s": [[0.0, 0.5]]},
        {"return_altitude_m": 5.0},
        {"retrace_points": 1},
    ],
)
def test_what_the_vehicle_can_do_by_itself_is_computed_again(plan, changes):
    rewrite(plan, lambda document: document["own_ways"].update(changes))
    assert failed(plan) == {"own_ways", "report.json"}
