"""What makes a tour impossible is named in one line, before anything is written."""

import shutil

import pytest
import yaml

from gcs.core.errors import GcsError
from gcs.services.plan_service import plan_to_directory


def square(west, east, south, north):
    return [[west, south], [east, south], [east, north], [west, north]]


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ({"fence": {"include": [square(-5, 30, -30, 30)]}}, r"home_m: home is outside the fence"),
        ({"fence": {"exclude": [square(-15, -10, -15, -10)]}}, r"home_m: home is outside the fence"),
        ({"fence": {"exclude": [square(-30, -2.5, -5, 5)]}}, r"inspection\.points\.W: the fence leaves out every"),
        (
            {"fence": {"include": [square(-30, 30, -30, 10)]}, "rally_m": [[0, 20, 0]]},
            r"rally_m\.0: is outside the fence",
        ),
        ({"planner": {"metric": "energy", "k": -1.0}}, r"planner\.k"),
        ({"planner": {"metric": "energy", "mu": -0.5}}, r"planner\.mu"),
        ({"vehicle": {"count": 2}}, r"vehicle\.count: 2 vehicles for 1 viewpoints: use 1"),
        ({"vehicle": {"battery": {"capacity_wh": 0.5}}}, r"viewpoint W: a flight to it alone takes \d\.\d Wh"),
    ],
)
def test_one_line_names_it(box_scenario, box_folder, tmp_path, asked, words):
    inspection = {"points": box_scenario["inspection"]["points"]}
    shutil.copy(box_folder / "box.stl", tmp_path / "box.stl")
    (tmp_path / "box.yaml").write_text(yaml.safe_dump({**box_scenario, "inspection": inspection, **asked}))
    with pytest.raises(GcsError, match=words) as refused:
        plan_to_directory(tmp_path / "box.yaml", tmp_path / "out")
    assert "\n" not in str(refused.value)
    assert not (tmp_path / "out").exists()
