"""A scenario file is read as it is meant, or refused in one line."""

import json

import pytest
import yaml

from gcs.core.errors import InputError
from gcs.storage.scenario_files import read_scenario_file


@pytest.mark.parametrize(
    ("name", "text", "field"),
    [
        ("none.yaml", None, "none.yaml"),
        ("bad.yaml", "a: [1, 2", "bad.yaml"),
        ("bad.json", '{"a": ', "bad.json"),
        ("binary.yaml", b"\xff\xfe\x00", "binary.yaml"),
        ("date.yaml", "name: 2001-99-99", "date.yaml"),
        ("deep.json", "[" * 100_000, "deep.json"),
        ("list.yaml", "- 1\n- 2\n", "scenario"),
        ("field.yaml", "structure: {sample: gantry-crane}\ncolour: red\n", "anchor"),
    ],
)
def test_a_scenario_file_that_is_wrong_is_one_line_that_names_it(tmp_path, name, text, field):
    path = tmp_path / name
    if text is not None:
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(InputError) as caught:
        read_scenario_file(path)
    assert field in (caught.value.field or "")
    assert "\n" not in str(caught.value)


def test_yaml_and_json_say_the_same(tmp_path, scenario_data):
    (tmp_path / "s.json").write_text(json.dumps(scenario_data))
    (tmp_path / "s.yaml").write_text(yaml.safe_dump(scenario_data))
    assert read_scenario_file(tmp_path / "s.json") == read_scenario_file(tmp_path / "s.yaml")


def test_plain_text_only(tmp_path):
    path = tmp_path / "s.yaml"
    path.write_text('!!python/object/apply:os.mkdir ["made"]')
    with pytest.raises(InputError, match=r"s\.yaml"):
        read_scenario_file(path)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("s.yaml", "safety: {clearance_m: 5, tracking_m: 0.5, clearance_m: 1}"),
        ("s.yaml", "safety:\n  clearance_m: 5\nsafety:\n  clearance_m: 1\n"),
        ("s.json", '{"safety": {"clearance_m": 5, "clearance_m": 1}}'),
    ],
)
def test_a_field_that_is_given_twice_is_refused(tmp_path, name, text):
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(InputError, match="given twice"):
        read_scenario_file(path)


def test_a_merge_key_may_be_overridden(tmp_path, scenario_data):
    scenario_data["vehicle"] = {"<<": {"radius_m": 0.5, "mass_kg": 3.0}, "radius_m": 0.7}
    path = tmp_path / "s.yaml"
    path.write_text(yaml.safe_dump(scenario_data).replace("'<<'", "<<"))
    vehicle = read_scenario_file(path).vehicle
    assert (vehicle.radius_m, vehicle.mass_kg) == (0.7, 3.0)


def test_spots_may_be_a_table_beside_the_scenario(tmp_path, scenario_data):
    (tmp_path / "spots.csv").write_text("name,x_m,y_m,z_m,normal_x,normal_y,normal_z\nbolt,1,2,3,0,0,2\n,4,5,6,1,0,0\n")
    scenario_data["inspection"] = {"surface": {"gsd_mm": 5, "spots": "spots.csv"}}
    path = tmp_path / "s.yaml"
    path.write_text(yaml.safe_dump(scenario_data))
    bolt, other = read_scenario_file(path).inspection.surface.spots
    assert (bolt.name, bolt.position_m, bolt.normal) == ("bolt", (1.0, 2.0, 3.0), (0.0, 0.0, 1.0))
    assert (other.name, other.position_m) == ("line 3", (4.0, 5.0, 6.0))
    (tmp_path / "spots.csv").unlink()
    with pytest.raises(InputError, match=r"spots\.csv"):
        read_scenario_file(path)
