"""Points of one's own against a written plan: what is seen, what is not and why, and tables that are none."""

import pytest

from gcs.core.errors import InputError
from gcs.core.surface_coverage import Verdict
from gcs.services.point_verdicts import judge_points
from gcs.storage.plan_files import read_structure

HEAD = "name,x_m,y_m,z_m,normal_x,normal_y,normal_z\n"


def table(tmp_path, text):
    path = tmp_path / "points.csv"
    path.write_text(text)
    return path


def test_a_side_is_seen_and_its_back_is_not(box_plan, tmp_path):
    low, high = read_structure(box_plan).bounds_m
    x, y, _ = (low + high) / 2
    path = table(tmp_path, f"{HEAD}top,{x},{y},{high[2]},0,0,5\n,{x},{y},{high[2]},0,0,-1\n")
    top, inside = judge_points(box_plan, path)
    assert (top.name, top.verdict) == ("top", Verdict.SEEN)
    assert (inside.name, inside.verdict) == ("line 3", Verdict.OCCLUDED)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x_m,y_m,z_m\n1,2,3\n", "normal_x is missing"),
        (HEAD, "no points"),
        (f"{HEAD}a,1,2,3,0,0,0\n", "line 2 has no normal"),
        (f"{HEAD}a,1,2,3,0,0,1\nb,1,2,,0,0,1\n", "line 3 is not six numbers"),
        (f"{HEAD}a,nan,2,3,0,0,1\n", "line 2"),
        (f"{HEAD}a,1,2\n", "line 2"),
    ],
)
def test_what_is_no_table_of_points_is_bad_input(box_plan, tmp_path, text, message):
    with pytest.raises(InputError, match=message):
        judge_points(box_plan, table(tmp_path, text))


def test_a_missing_table_is_bad_input(box_plan, tmp_path):
    with pytest.raises(InputError, match="cannot be read"):
        judge_points(box_plan, tmp_path / "none.csv")
