"""The scenario's gate: what is wrong is named, and nothing unknown slips through."""

import copy
import math

import pytest

from gcs.core.errors import InputError
from gcs.core.scenario import parse_scenario

GOOD = {
    "structure": {"meshes": [{"file": "crane.stl"}]},
    "anchor": {"latitude_deg": 31.36, "longitude_deg": 121.6, "altitude_m": 4.0},
    "camera": {
        "sensor_width_mm": 13.2,
        "sensor_height_mm": 8.8,
        "focal_length_mm": 8.8,
        "image_width_px": 5472,
        "image_height_px": 3648,
    },
    "inspection": {"surface": {"gsd_mm": 3.0}},
}


def changed(path, value):
    data = copy.deepcopy(GOOD)
    node = data
    for key in path[:-1]:
        node = node[key]
    if value is None:
        del node[path[-1]]
    else:
        node[path[-1]] = value
    return data


def test_a_minimal_scenario_gets_the_documented_defaults():
    s = parse_scenario(GOOD)
    assert s.safety.hull_clearance_m == pytest.approx(1.0 + 0.5 + 0.3 + 0.1)
    assert s.centre_clearance_m == pytest.approx(2.4)
    assert s.inspection.surface.overlap == 0.3
    assert s.camera.gimbal.pitch_min_deg == -90


def test_camera_distances_follow_similar_triangles():
    camera = parse_scenario(GOOD).camera
    assert camera.distance_for_gsd(0.003) == pytest.approx(0.003 * 5472 * 8.8 / 13.2)
    assert camera.gsd_at(camera.distance_for_gsd(0.003)) == pytest.approx(0.003)
    assert camera.distance_for_footprint(3.0) == pytest.approx(2.0), "the crane paper's 3000 mm picture needs 2000 mm"


@pytest.mark.parametrize(
    ("path", "value", "names"),
    [
        (["camera"], None, "camera: this field is missing"),
        (["anchor", "latitude_deg"], 95.0, "anchor.latitude_deg"),
        (["camera", "sensor_width_mm"], -1.0, "camera.sensor_width_mm"),
        (["camera", "focal_length_mm"], math.nan, "camera.focal_length_mm"),
        (["camera", "model"], "Nikon Coolpix", "camera.model: no camera of the library is called 'Nikon Coolpix'"),
        (["wind"], 3, "wind: unknown field"),
        (["inspection", "surface", "gsd"], 3, "inspection.surface.gsd: unknown field"),
        (["inspection"], None, "inspection is missing"),
        (["inspection"], {}, "inspection: name at least one"),
        (["inspection", "points"], [{"name": "a", "position_m": [0, 0, 1], "normal": [0, 0, 0]}], "points.0.normal"),
        (["structure"], {"meshes": [], "sample": None}, "structure: give either"),
        (["structure", "meshes"], [{"file": "a.stl", "scale": 0}], "structure.meshes.0.scale"),
        (["vehicle"], {"count": 0}, "vehicle.count"),
        (["vehicle"], {"count": 3, "pads_m": [[5, 5, 0]]}, "vehicle"),
        (["rally_m"], [[0, 0]], "rally_m.0"),
        (["fence"], {"include": [[[0, 0], [1, 1]]]}, "fence.include"),
    ],
)
def test_what_is_wrong_is_named(path, value, names):
    with pytest.raises(InputError) as caught:
        parse_scenario(changed(path, value))
    assert names in str(caught.value)
    assert "\n" not in str(caught.value)
    assert caught.value.exit_status == 2


@pytest.mark.parametrize("data", [None, [], "text", 3])
def test_something_else_than_a_mapping(data):
    with pytest.raises(InputError, match="scenario"):
        parse_scenario(data)


def test_two_points_of_one_name_are_refused():
    point = {"name": "L1", "position_m": [0, 0, 1], "normal": [0, -2, 0]}
    with pytest.raises(InputError, match="given twice: L1"):
        parse_scenario(changed(["inspection", "points"], [point, point]))


def test_normals_are_made_unit():
    point = {"name": "L1", "position_m": [0, 0, 1], "normal": [0, -2, 0]}
    assert parse_scenario(changed(["inspection", "points"], [point])).inspection.points[0].normal == (0, -1, 0)
