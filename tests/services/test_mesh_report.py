"""The report on a mesh finds what was put into it."""

import numpy as np
import pytest
import trimesh

from gcs.core.errors import InputError
from gcs.services.mesh_report import inspect_mesh, units_guess


def write(folder, vertices, faces, ending="off"):
    path = folder / f"part.{ending}"
    content = trimesh.Trimesh(vertices, faces, process=False).export(file_type=ending)
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


@pytest.fixture
def cube():
    box = trimesh.creation.box([10, 20, 30])
    return np.array(box.vertices), np.array(box.faces)


def test_a_closed_box(tmp_path, cube):
    report = inspect_mesh(write(tmp_path, *cube, ending="stl"))
    assert (report.triangles, report.parts, report.holes, report.watertight) == (12, 1, 0, True)
    assert report.area == pytest.approx(2 * (200 + 300 + 600))
    text = "\n".join(report.lines())
    assert "part.stl: STL, 12 triangles, 1 part" in text
    assert "10 x 20 x 30" in text
    assert "metres" in text
    assert "closed: every edge joins two triangles" in text


def test_missing_triangles_are_holes(tmp_path, cube):
    vertices, faces = cube
    normals = np.cross(vertices[faces[:, 1]] - vertices[faces[:, 0]], vertices[faces[:, 2]] - vertices[faces[:, 0]])
    top_and_bottom = np.abs(normals[:, 2]) > 1
    report = inspect_mesh(write(tmp_path, vertices, faces[~top_and_bottom]))
    assert (report.border_edges, report.holes, report.watertight) == (8, 2, False)
    assert any("8 open edges in 2 holes" in line for line in report.lines())


def test_degenerate_duplicate_and_crowded(tmp_path, cube):
    vertices, faces = cube
    fin = np.vstack([vertices, [[0, 0, 99]]])
    faces = np.vstack([faces, faces[3][[1, 2, 0]], [[0, 0, 1]], [[faces[0][0], faces[0][1], 8]]])
    report = inspect_mesh(write(tmp_path, fin, faces))
    assert (report.duplicates, report.degenerate, report.crowded_edges) == (1, 1, 1)
    assert not report.watertight
    text = "\n".join(report.lines())
    assert "1 triangle without area" in text
    assert "1 triangle repeat" in text
    assert "1 edge of more than two triangles" in text


def test_parts_are_counted(tmp_path, cube):
    vertices, faces = cube
    report = inspect_mesh(write(tmp_path, np.vstack([vertices, vertices + 100]), np.vstack([faces, faces + 8])))
    assert report.parts == 2


def test_nan_is_said(tmp_path, cube):
    vertices, faces = cube
    vertices[0, 0] = np.nan
    report = inspect_mesh(write(tmp_path, vertices, faces, ending="stl"))
    assert report.not_finite == int((faces == 0).any(axis=1).sum())
    assert any("NaN" in line for line in report.lines())


def test_all_nan_still_gives_a_report(tmp_path, cube):
    vertices, faces = cube
    report = inspect_mesh(write(tmp_path, vertices * np.nan, faces, ending="stl"))
    assert report.not_finite == 12
    assert report.lines()


@pytest.mark.parametrize(
    ("extent", "unit"), [(1.2, "unclear"), (80, "metres"), (8000, "centimetres"), (80000, "millimetres")]
)
def test_units_are_guessed_by_size(extent, unit):
    assert units_guess(extent).startswith(unit)


def test_what_is_not_a_mesh_is_refused(tmp_path):
    (tmp_path / "part.stl").write_bytes(b"no mesh at all")
    with pytest.raises(InputError, match=r"part\.stl"):
        inspect_mesh(tmp_path / "part.stl")
