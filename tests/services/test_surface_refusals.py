"""Surfaces that cannot be inspected as asked: refused by `gcs plan` in one line that names the field, and no plan."""

import re

import pytest
import trimesh
import yaml

from gcs.core.errors import InfeasibleError, InputError
from gcs.services.plan_service import plan_to_directory


@pytest.fixture
def scenario(tmp_path):
    """A box of 6 m x 6 m x 12 m on the ground."""
    mesh = trimesh.creation.box((6, 6, 12))
    mesh.apply_translation((0, 0, 6))
    mesh.export(tmp_path / "box.stl")
    return {
        "structure": {"meshes": [{"file": "box.stl"}]},
        "anchor": {"latitude_deg": 31.3622, "longitude_deg": 121.6155, "altitude_m": 4.0},
        "ground_m": 0.0,
        "camera": {
            "sensor_width_mm": 13.2,
            "sensor_height_mm": 8.8,
            "focal_length_mm": 8.8,
            "image_width_px": 5472,
            "image_height_px": 3648,
        },
        "inspection": {"surface": {"gsd_mm": 5, "overlap": 0.0}},
        "home_m": [-20, -20, 0],
    }


def refused(scenario, tmp_path, kind):
    (tmp_path / "box.yaml").write_text(yaml.safe_dump(scenario))
    with pytest.raises(kind) as caught:
        plan_to_directory(tmp_path / "box.yaml", tmp_path / "out")
    assert not (tmp_path / "out").exists()
    assert "\n" not in str(caught.value)
    return caught.value


def test_a_region_that_selects_nothing(scenario, tmp_path):
    scenario["inspection"]["surface"]["regions"] = [{"min_m": [30, 0, 0], "max_m": [40, 10, 10]}]
    assert refused(scenario, tmp_path, InputError).field == "inspection.surface.regions"


def test_a_region_inside_the_structure_that_holds_none_of_its_surface(scenario, tmp_path):
    scenario["inspection"]["surface"]["regions"] = [{"min_m": [-1, -1, 2], "max_m": [1, 1, 10]}]
    assert refused(scenario, tmp_path, InputError).field == "inspection.surface.regions"


def test_a_structure_of_which_nothing_can_be_seen(scenario, tmp_path):
    scenario["structure"]["meshes"][0]["position_m"] = [0, 0, -30]  # all of it is under the ground
    error = refused(scenario, tmp_path, InfeasibleError)
    assert error.field == "inspection.surface"
    assert "allow" in error.message


def test_a_gsd_that_needs_the_vehicle_closer_than_its_clearance(scenario, tmp_path):
    scenario["inspection"]["surface"]["gsd_mm"] = 0.4
    error = refused(scenario, tmp_path, InfeasibleError)
    assert error.field == "inspection.surface.gsd_mm"
    best = float(re.search(r"best it can have is ([0-9.]+) mm", error.message).group(1))
    # the centre keeps 2.4 m, and a little; the margin on the curve is less than a tenth of that
    assert 2.4 < best / 1000 * 8.8 * 5472 / 13.2 < 2.7


def test_hardly_more_than_the_best_gsd_that_was_told_can_be_had(scenario, tmp_path):
    scenario["inspection"]["surface"] = {
        "gsd_mm": 0.4,
        "overlap": 0.0,
        "regions": [{"min_m": [-3, -3.1, 5], "max_m": [0, -2.9, 8]}],
    }
    message = refused(scenario, tmp_path, InfeasibleError).message
    best = float(re.search(r"best it can have is ([0-9.]+) mm", message).group(1))
    scenario["inspection"]["surface"]["gsd_mm"] = 1.03 * best
    (tmp_path / "box.yaml").write_text(yaml.safe_dump(scenario))
    assert plan_to_directory(tmp_path / "box.yaml", tmp_path / "out").plan.certificates.coverage > 0
