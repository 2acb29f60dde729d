"""The camera library against itself and against what the makers say of the view; and how a scenario asks for it."""

import math
import subprocess
import sys
from pathlib import Path

import pytest

from gcs.core.camera import Camera
from gcs.core.camera_library import find_camera, library, library_camera
from gcs.core.errors import InputError
from gcs.core.scenario import parse_scenario

ROOT = Path(__file__).resolve().parents[2]
FULL_FRAME_DIAGONAL_MM = math.hypot(36, 24)
ENTRIES = pytest.mark.parametrize("entry", library(), ids=lambda entry: entry.name)


def scenario(**camera):
    return parse_scenario(
        {
            "structure": {"meshes": [{"file": "crane.stl"}]},
            "anchor": {"latitude_deg": 31.36, "longitude_deg": 121.6, "altitude_m": 4.0},
            "camera": camera,
            "inspection": {"surface": {"gsd_mm": 3.0}},
        }
    )


def test_there_are_cameras_of_every_kind():
    assert len(library()) >= 30
    assert {entry.shutter for entry in library()} == {"global", "leaf", "focal-plane", "rolling"}
    assert sum("focal_range_mm" in entry.camera for entry in library()) >= 4


@ENTRIES
def test_pixels_are_square(entry):
    c = Camera.model_validate(entry.fields())
    width, height = c.sensor_width_mm / c.image_width_px, c.sensor_height_mm / c.image_height_px
    assert width == pytest.approx(height, rel=0.02)
    assert 0.0007 < width < 0.020


@ENTRIES
def test_the_view_is_what_the_maker_says(entry):
    c = Camera.model_validate(entry.fields())
    diagonal = math.hypot(c.sensor_width_mm, c.sensor_height_mm)
    if entry.stated.equivalent_mm is not None:
        equivalent = c.focal_length_mm * FULL_FRAME_DIAGONAL_MM / diagonal
        assert equivalent == pytest.approx(entry.stated.equivalent_mm, rel=0.04)
    if entry.stated.diagonal_deg is not None:
        angle = 2 * math.degrees(math.atan(diagonal / 2 / c.focal_length_mm))
        assert angle == pytest.approx(entry.stated.diagonal_deg, rel=0.03)


@ENTRIES
def test_an_entry_is_complete(entry):
    c = Camera.model_validate(entry.fields())
    assert entry.source
    assert c.model == entry.name
    assert c.f_number is not None
    assert c.nearest_focus_m > 0
    assert c.min_interval_s > 0
    assert (c.readout_s is not None) == (entry.shutter in {"rolling", "focal-plane"})
    assert set(entry.estimated) <= set(entry.camera)
    known = entry.shutter == "rolling" and "readout_s" in entry.estimated
    assert known or entry.shutter != "rolling", "no maker publishes the readout time of a rolling shutter"
    if "focal_range_mm" in entry.camera:
        assert c.focal_range_mm is not None
        assert c.focal_length_mm == c.focal_range_mm[0] < c.focal_range_mm[1]
        assert entry.nearest_focus_zoomed_m is not None


@ENTRIES
def test_every_spelling_finds_it(entry):
    for name in (entry.name, *entry.aliases, entry.name.upper().replace(" ", "-")):
        assert find_camera(name) is entry


def test_the_documentation_lists_every_camera():
    text = (ROOT / "docs" / "cameras.md").read_text()
    assert [entry.name for entry in library() if f"| {entry.name} |" not in text] == []


def test_a_model_gives_all_numbers():
    c = scenario(model="mavic 3e").camera
    assert c.model == "DJI Mavic 3 Enterprise wide"
    assert (c.sensor_width_mm, c.focal_length_mm, c.image_width_px) == (17.3, 12.29, 5280)
    assert (c.shutter, c.readout_s, c.min_interval_s) == ("global", None, 0.7)
    assert c.gimbal.pitch_max_deg == 35


def test_the_scenario_comes_on_top():
    c = scenario(model="DJI Air 2S", exposure_s=0.001, f_number=5.6, gimbal={"pitch_max_deg": 10}).camera
    assert (c.exposure_s, c.f_number) == (0.001, 5.6)
    assert (c.gimbal.pitch_min_deg, c.gimbal.pitch_max_deg, c.gimbal.rate_deg_s) == (-90, 10, 100)
    assert (c.shutter, c.readout_s) == ("rolling", 0.032)
    assert scenario(model="DJI Air 2S", shutter="global").camera.readout_s is None


def test_a_zoom_stands_at_its_short_end_unless_asked():
    assert scenario(model="H20 zoom").camera.focal_length_mm == 6.83
    assert scenario(model="H20 zoom").camera.nearest_focus_m == 1.0
    zoomed = scenario(model="H20 zoom", focal_length_mm=119.94).camera
    assert zoomed.focal_length_mm == 119.94
    assert zoomed.nearest_focus_m == 8.0
    assert scenario(model="H20 zoom", focal_length_mm=50, nearest_focus_m=2).camera.nearest_focus_m == 2


@pytest.mark.parametrize(
    ("camera", "names"),
    [
        (
            {"model": "H20 zoom", "focal_length_mm": 150},
            "camera.focal_length_mm: 150 is outside the zoom range of 6.83 to",
        ),
        ({"model": "Zenmuse P1"}, "did you mean DJI Zenmuse P1 24 mm, DJI Zenmuse P1 35 mm, DJI Zenmuse P1 50 mm"),
        ({"model": "Mavick 3 Enterprize"}, "did you mean DJI Mavic 3 Enterprise wide"),
        ({"model": "Mavick 3 Enterprize", "sensor_width_mm": 13.2}, "camera.model: no camera"),
        (
            {"model": "xyzzy"},
            "camera.model: no camera of the library is called 'xyzzy': docs/cameras.md lists the names",
        ),
        ({"model": ""}, "camera.model: no camera"),
        ({"model": 3}, "camera.model: the name of a camera"),
        ({"model": ["P1"]}, "camera.model: the name of a camera"),
        ({"model": "{x}\n%s"}, "camera.model: no camera"),
        ({"model": "Mavic 3E", "f_number": 1.4}, "camera.f_number: 1.4 is wider than the lens"),
        ({"model": "Mavic 3E", "f_number": "wide"}, "camera.f_number"),
        ({"model": "Mavic 3E", "colour": "red"}, "camera.colour: unknown field"),
        ({"model": "Mavic 3E", "focal_length_mm": 0}, "camera.focal_length_mm"),
        ({"model": "Mavic 3E", "readout_s": 0.02}, "camera: readout_s is a rolling shutter's"),
        ({"model": "Mavic 3E", "gimbal": {"pitch_min_deg": 60}}, "camera.gimbal: pitch_min_deg must be below"),
        ({"model": "Mavic 3E", "gimbal": 3}, "camera.gimbal"),
        ({"model": None}, "camera.sensor_width_mm: this field is missing"),
    ],
)
def test_what_is_wrong_is_named(camera, names):
    with pytest.raises(InputError) as caught:
        scenario(**camera)
    assert names in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("asked", [{"model": "P1 35 mm"}, {"model": "H20 zoom", "focal_length_mm": 50, "f_number": 8}])
def test_a_resolved_scenario_resolves_to_itself(asked):
    given = scenario(**asked)
    written = given.model_dump(mode="json")
    assert written["camera"]["sensor_width_mm"] == given.camera.sensor_width_mm
    assert parse_scenario(written) == given
    assert type(given).model_validate_json(given.model_dump_json()) == given


def test_a_camera_by_name_in_code():
    assert library_camera("P1 35 mm", exposure_s=0.002).exposure_s == 0.002
    with pytest.raises(InputError, match=r"camera\.model"):
        library_camera("xyzzy")


def test_the_library_is_read_only_when_it_is_asked_for():
    code = "import sys, gcs.core.scenario, gcs.core.camera_library as c\n"
    code += "print('yaml' in sys.modules, c.library.cache_info())"
    out = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True, timeout=60)
    assert out.stdout.startswith("False")
    assert "currsize=0" in out.stdout
