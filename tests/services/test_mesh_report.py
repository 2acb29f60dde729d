"""The report on a mesh finds what was put into it."""

import numpy as np
import pytest
import trimesh

from gcs.core.errors import InputError
from gcs.services.mesh_report import inspect_mesh, units_guess
from gcs.services.mesh_topology import MeshTopology


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
    assert (report.triangles, report.topology, report.watertight) == (12, MeshTopology(parts=1), True)
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
    assert (report.topology.border_edges, report.topology.holes, report.watertight) == (8, 2, False)
    assert any("8 open edges in 2 holes" in line for line in report.lines())


def test_degenerate_duplicate_and_crowded(tmp_path, cube):
    vertices, faces = cube
    fin = np.vstack([vertices, [[0, 0, 99]]])
    faces = np.vstack([faces, faces[3][[1, 2, 0]], [[0, 0, 1]], [[faces[0][0], faces[0][1], 8]]])
    report = inspect_mesh(write(tmp_path, fin, faces))
    assert (report.duplicates, report.degenerate, report.topology.crowded_edges) == (1, 1, 1)
    assert not report.watertight
    text = "\n".join(report.lines())
    assert "1 triangle without area" in text
    assert "1 triangle repeat" in text
    assert "1 edge of more than two triangles" in text


def test_parts_are_counted(tmp_path, cube):
    vertices, faces = cube
    report = inspect_mesh(write(tmp_path, np.vstack([vertices, vertices + 100]), np.vstack([faces, faces + 8])))
    assert report.topology.parts == 2


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


def test_flipped_triangles_are_counted_the_short_way(tmp_path):
    ball = trimesh.creation.icosphere(subdivisions=2, radius=5)
    faces = np.array(ball.faces)
    turned = np.random.default_rng(3).choice(len(faces), size=21, replace=False)
    faces[turned] = faces[turned][:, ::-1]
    report = inspect_mesh(write(tmp_path, ball.vertices, faces))
    assert report.topology.flipped == 21
    assert not report.inside_out
    assert any("21 triangles facing the other way" in line for line in report.lines())


def test_flipped_triangles_of_two_bodies_are_those_of_each(tmp_path, cube):
    vertices, faces = cube
    first, second = faces.copy(), faces.copy()
    first[:2] = first[:2][:, ::-1]
    second[:9] = second[:9][:, ::-1]  # turning the three others round is shorter
    report = inspect_mesh(write(tmp_path, np.vstack([vertices, vertices + 100]), np.vstack([first, second + 8])))
    assert report.topology.flipped == 2 + 3


def test_a_surface_with_one_side_has_no_flipped_triangles(tmp_path):
    steps = 30
    around = 2 * np.pi * np.arange(steps) / steps
    ribbon = [
        [(10 + w * np.cos(a / 2)) * np.cos(a), (10 + w * np.cos(a / 2)) * np.sin(a), w * np.sin(a / 2)]
        for a in around
        for w in (-2, 2)
    ]
    faces = []
    for k in range(steps):
        a, b, c, d = 2 * k, 2 * k + 1, 2 * k + 2, 2 * k + 3
        if k == steps - 1:
            c, d = 1, 0  # half a turn: a Moebius strip
        faces += [[a, b, c], [b, d, c]]
    report = inspect_mesh(write(tmp_path, np.array(ribbon), np.array(faces)))
    assert (report.topology.flipped, report.topology.parts) == (0, 1)


def test_a_body_that_faces_inwards(tmp_path, cube):
    vertices, faces = cube
    report = inspect_mesh(write(tmp_path, vertices, faces[:, ::-1]))
    assert report.inside_out
    assert any("face inwards" in line for line in report.lines())
    assert not inspect_mesh(write(tmp_path, vertices, faces)).inside_out


def test_inner_faces_are_found_by_rays(tmp_path, cube):
    vertices, faces = cube
    shrunk = vertices / 2
    report = inspect_mesh(write(tmp_path, np.vstack([vertices, shrunk]), np.vstack([faces, faces + 8])))
    assert report.inner == pytest.approx(0.25 / 1.25, abs=0.02)  # a box of half the size in a closed one
    assert any("inner faces: about 2" in line for line in report.lines())


def test_the_floor_of_an_open_box_is_no_inner_face(tmp_path, cube):
    vertices, faces = cube
    is_top = (vertices[faces][:, :, 2] > 14).all(axis=1)
    report = inspect_mesh(write(tmp_path, vertices, faces[~is_top]))
    assert report.inner == 0
    assert any("no inner faces found (10,000 sampled points, 128 directions)" in line for line in report.lines())


def test_map_coordinates_are_said_with_the_position_that_centres(tmp_path, cube):
    vertices, faces = cube
    report = inspect_mesh(write(tmp_path, vertices + np.array([500000, 4649776, 15]), faces, ending="stl"))
    text = "\n".join(report.lines())
    assert "`position_m: [-500000, -4649776, 0]`" in text
    assert "single precision, in steps of 0.5" in text
    near = "\n".join(inspect_mesh(write(tmp_path, vertices, faces)).lines())
    assert "map coordinates" not in near
    assert "single precision" not in near


def test_a_large_mesh_says_how_it_is_simplified(tmp_path):
    side = np.linspace(0, 10, 330)
    x, y = np.meshgrid(side, side, indexing="ij")
    number = np.arange(x.size).reshape(x.shape)
    a, b, c, d = (n.reshape(-1) for n in (number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]))
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    vertices = np.stack([x.reshape(-1), y.reshape(-1), np.sin(x).reshape(-1)], 1)
    report = inspect_mesh(write(tmp_path, vertices, faces, ending="stl"))
    assert len(faces) > 200_000
    assert 0 < report.planned_error_m <= 0.05
    assert report.planned_triangles < len(faces) / 2
    assert any(f"nowhere further than {report.planned_error_m:.3f} m" in line for line in report.lines())


def test_a_small_mesh_is_not_simplified(tmp_path, cube):
    assert "planned with 12 triangles, not simplified" in inspect_mesh(write(tmp_path, *cube)).lines()
