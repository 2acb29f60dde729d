import csv
import hashlib
import json
from dataclasses import replace
from pathlib import Path

import jsonschema
import numpy as np
import pytest
import trimesh

from gcs.core.errors import InputError, StorageError
from gcs.core.scenario import parse_scenario
from gcs.storage import plan_files
from gcs.storage.plan_files import plan_hash, read_plan, read_structure, sample_times, write_plan


def read_columns(path):
    with path.open(newline="") as file:
        head, *rows = list(csv.reader(file))
    return head, rows


def test_the_files_of_the_interface_are_written(tmp_path, small_plan, small_structure):
    extra = {"mission.plan": b"{}", "mission.waypoints": b"QGC WPL 110\n", "report.html": b"<html>"}
    write_plan(small_plan, small_structure, tmp_path / "out", extra_files=extra)
    assert {p.name for p in (tmp_path / "out").iterdir()} == set(plan_files.FILE_NAMES)
    assert {p.name for p in tmp_path.iterdir()} == {"out"}


def test_a_plan_comes_back_exactly(tmp_path, small_plan, small_structure):
    write_plan(small_plan, small_structure, tmp_path / "out")
    back = read_plan(tmp_path / "out")
    assert back.scenario == small_plan.scenario
    assert back.cables == small_plan.cables
    assert back.certificates == small_plan.certificates
    for name in ("path_m", "path_stops", "corridor_m"):
        np.testing.assert_array_equal(getattr(back, name), getattr(small_plan, name))
    np.testing.assert_array_equal(back.trajectory.coefficients, small_plan.trajectory.coefficients)
    np.testing.assert_array_equal(back.trajectory.durations_s, small_plan.trajectory.durations_s)
    np.testing.assert_array_equal(back.yaw.angles_rad, small_plan.yaw.angles_rad)
    np.testing.assert_array_equal(back.viewpoints[0].position_m, small_plan.viewpoints[0].position_m)
    np.testing.assert_array_equal(back.coverage.seen, small_plan.coverage.seen)
    assert back.coverage.share_seen == 0.75


def test_stops_and_holds_come_back_and_are_stops_where_nothing_is_said(tmp_path, small_plan, small_structure):
    first, *others = small_plan.viewpoints
    passed = [replace(view, stops=False) for view in others]
    write_plan(replace(small_plan, viewpoints=(replace(first, hold_s=4.0), *passed)), small_structure, tmp_path / "out")
    back = read_plan(tmp_path / "out").viewpoints
    assert [v.stops for v in back] == [True] + [False] * len(passed)
    assert [v.hold_s for v in back] == [4.0] + [0.0] * len(passed)
    document = json.loads((tmp_path / "out" / "plan.json").read_text())
    for view in document["viewpoints"]:
        del view["stops"], view["hold_s"]
    (tmp_path / "out" / "plan.json").write_text(json.dumps(document))
    older = read_plan(tmp_path / "out").viewpoints
    assert all(v.stops and v.hold_s == 0.0 for v in older)


def test_a_camera_of_the_library_is_written_with_its_numbers(tmp_path, scenario_data, small_plan, small_structure):
    asked = {"model": "Mavic 3E", "exposure_s": 0.002}
    plan = replace(small_plan, scenario=parse_scenario({**scenario_data, "camera": asked}))
    write_plan(plan, small_structure, tmp_path / "out")
    document = json.loads((tmp_path / "out" / "plan.json").read_text())
    for camera in (document["camera"], document["scenario"]["camera"]):
        assert camera["model"] == "DJI Mavic 3 Enterprise wide"
        assert (camera["sensor_width_mm"], camera["exposure_s"]) == (17.3, 0.002)
    jsonschema.Draft202012Validator(json.loads(plan_files.plan_schema())).validate(document)
    assert read_plan(tmp_path / "out").scenario == plan.scenario


def test_the_structure_comes_back_exactly_and_other_programs_read_it(tmp_path, small_plan, small_structure):
    write_plan(small_plan, small_structure, tmp_path / "out")
    back = read_structure(tmp_path / "out")
    np.testing.assert_array_equal(back.vertices_m, small_structure.vertices_m)
    np.testing.assert_array_equal(back.faces, small_structure.faces)
    assert back.cables == small_structure.cables
    mesh = trimesh.load(tmp_path / "out" / "structure.ply", force="mesh", process=False)
    np.testing.assert_array_equal(mesh.vertices, small_structure.vertices_m)
    np.testing.assert_array_equal(mesh.faces, small_structure.faces)
    assert mesh.volume == pytest.approx(4 * 4 * 20)


def test_the_trajectory_is_sampled_at_50_hz_to_its_exact_end(tmp_path, small_plan, small_structure):
    write_plan(small_plan, small_structure, tmp_path / "out")
    head, rows = read_columns(tmp_path / "out" / "trajectory.csv")
    assert ",".join(head) == "t_s,x_m,y_m,z_m,vx_m_s,vy_m_s,vz_m_s,ax_m_s2,ay_m_s2,az_m_s2,yaw_rad"
    data = np.array(rows, dtype=float)
    t = data[:, 0]
    assert t[0] == 0
    assert t[-1] == pytest.approx(22.013, abs=1e-9)
    assert (np.diff(t) > 0).all()
    assert np.diff(t).max() <= 0.02 + 1e-9
    # Velocity and acceleration are the derivatives of the position, seen by finite differences.
    middle = slice(200, 240)
    speed = (data[201:241, 1:4] - data[199:239, 1:4]) / 0.04
    np.testing.assert_allclose(data[middle, 4:7], speed, atol=2e-3)
    acceleration = (data[201:241, 4:7] - data[199:239, 4:7]) / 0.04
    np.testing.assert_allclose(data[middle, 7:10], acceleration, atol=5e-3)
    for end in (data[0], data[-1]):
        np.testing.assert_allclose(end[4:10], 0, atol=1e-6)
    np.testing.assert_allclose(data[np.searchsorted(t, 11.0), 1:4], [8, 0, 10], atol=1e-6)


@pytest.mark.parametrize("duration", [0.01, 0.02, 1.0, 1.0 + 1e-12, 1.0 + 1e-7, 1.00001, 1.0199999, 7.777, 600.000001])
def test_sample_times_hold_for_any_duration(duration):
    times = sample_times(duration)
    steps = np.diff(times)
    assert times[0] == 0
    assert times[-1] == duration
    assert (steps > 1e-6).all()
    assert steps.max() <= 0.02 + 1e-8


def test_viewpoints_are_listed_in_visiting_order_with_the_units_of_the_interface(tmp_path, small_plan, small_structure):
    write_plan(small_plan, small_structure, tmp_path / "out")
    head, rows = read_columns(tmp_path / "out" / "viewpoints.csv")
    assert ",".join(head) == "id,name,x_m,y_m,z_m,dir_x,dir_y,dir_z,up_x,up_y,up_z,gsd_mm,time_s"
    assert rows[0][:2] == ["0", "A, west"]
    assert [float(c) for c in rows[0][2:]] == [8, 0, 10, 1, 0, 0, 0, 0, 1, 1.1, 11]


def test_the_report_has_all_keys_of_the_interface(tmp_path, small_plan, small_structure):
    report = plan_files.plan_report(small_plan, mission_items=7)
    write_plan(small_plan, small_structure, tmp_path / "out", report=report)
    written = json.loads((tmp_path / "out" / "report.json").read_text())
    keys = (
        "length_m path_length_m duration_s mean_deviation_m max_deviation_m min_clearance_m max_speed_m_s "
        "max_acceleration_m_s2 corridor_violation_m viewpoints coverage coverable tour_cost tour_lower_bound "
        "tour_metric energy_wh mission_items stages_s"
    )
    assert set(keys.split()) <= written.keys()
    assert written["mission_items"] == 7
    assert written["coverage"] == 0.75


def test_the_published_schema_is_the_present_one_and_accepts_a_plan(tmp_path, small_plan, small_structure):
    published = Path(plan_files.__file__).with_name("plan.schema.json").read_text()
    assert published == plan_files.plan_schema()
    write_plan(small_plan, small_structure, tmp_path / "out")
    document = json.loads((tmp_path / "out" / "plan.json").read_text())
    validator = jsonschema.Draft202012Validator(json.loads(published))
    validator.validate(document)
    assert document["camera"]["focal_length_mm"] == 8.8
    assert document["cables"][0]["radius_m"] == 0.05
    del document["trajectory"]["durations_s"]
    assert not validator.is_valid(document)


def test_the_hash_is_that_of_the_bytes_of_plan_json(tmp_path, small_plan, small_structure):
    said = write_plan(small_plan, small_structure, tmp_path / "out")
    assert said == plan_hash(tmp_path / "out")
    assert said == hashlib.sha256((tmp_path / "out" / "plan.json").read_bytes()).hexdigest()


def test_an_earlier_plan_is_replaced_whole(tmp_path, small_plan, small_structure):
    write_plan(small_plan, small_structure, tmp_path / "out", extra_files={"report.html": b"old"})
    write_plan(small_plan, small_structure, tmp_path / "out")
    assert not (tmp_path / "out" / "report.html").exists()
    assert read_plan(tmp_path / "out").viewpoints[0].name == "A, west"


def test_a_folder_with_other_files_is_left_alone(tmp_path, small_plan, small_structure):
    out = tmp_path / "out"
    write_plan(small_plan, small_structure, out)
    (out / "thesis.txt").write_text("years of work")
    with pytest.raises(InputError, match="other files"):
        write_plan(small_plan, small_structure, out)
    with pytest.raises(InputError, match="other files"):
        plan_files.check_output(out)
    assert (out / "thesis.txt").read_text() == "years of work"


def test_a_file_in_the_place_of_the_folder_is_left_alone(tmp_path, small_plan, small_structure):
    (tmp_path / "out").write_text("a file")
    with pytest.raises(InputError, match="not a folder"):
        write_plan(small_plan, small_structure, tmp_path / "out")


def test_a_full_disk_leaves_the_earlier_plan_and_nothing_half_written(
    tmp_path, small_plan, small_structure, monkeypatch
):
    out = tmp_path / "out"
    first = write_plan(small_plan, small_structure, out)
    write = Path.write_bytes

    def full(self, data):
        if self.name == "trajectory.csv":
            write(self, data[:100])
            raise OSError(28, "No space left on device")
        return write(self, data)

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(StorageError, match="disk is full"):
        write_plan(small_plan, small_structure, out)
    assert plan_hash(out) == first
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


def test_a_damaged_plan_is_named(tmp_path, small_plan, small_structure):
    out = tmp_path / "out"
    with pytest.raises(InputError, match="no such plan"):
        read_plan(out)
    write_plan(small_plan, small_structure, out)
    document = json.loads((out / "plan.json").read_text())
    document["trajectory"]["durations_s"] = ["soon"]
    (out / "plan.json").write_text(json.dumps(document))
    with pytest.raises(InputError, match=r"trajectory\.durations_s"):
        read_plan(out)
    (out / "structure.ply").write_bytes((out / "structure.ply").read_bytes()[:-5])
    with pytest.raises(InputError, match="not whole"):
        read_structure(out)
