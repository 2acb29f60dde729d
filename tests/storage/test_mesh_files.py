"""Structures from files of every format, their placement, and files that are not what they should be."""

import hashlib
import re
import warnings

import numpy as np
import pytest
import trimesh

from gcs.core.errors import InputError
from gcs.core.scenario import parse_scenario
from gcs.core.structure_source import Cable, MeshSource, StructureSource
from gcs.storage import mesh_loading
from gcs.storage.mesh_files import AVAILABLE_SAMPLES, load_structure, sample_scenario
from gcs.storage.mesh_reading import read_mesh

CORNERS = np.array([[0, 0, 0], [2, 0, 0], [0, 3, 0], [0, 0, 4]], dtype=float)
FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
ENDINGS = ["stl", "obj", "ply", "glb", "gltf", "off", "dae"]


def write(folder, ending, vertices=CORNERS, faces=FACES):
    path = folder / f"part.{ending}"
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        content = mesh.export(file_type=ending)
    if isinstance(content, dict):  # a glTF with its buffers beside it
        for name, data in content.items():
            (path if name.endswith(".gltf") else folder / name).write_bytes(data)
    else:
        path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


def load(folder, **mesh):
    return load_structure(StructureSource(meshes=(MeshSource(**{"file": "part.stl", **mesh}),)), folder)


def sorted_rows(a):
    a = np.round(np.asarray(a).reshape(len(a), -1), 5)
    return a[np.lexsort(a.T[::-1])]


@pytest.mark.parametrize("ending", ENDINGS)
def test_every_format_gives_the_same_triangles(tmp_path, ending):
    path = write(tmp_path, ending)
    structure, source = load(tmp_path, file=path.name)
    assert structure.faces.shape == (4, 3)
    np.testing.assert_allclose(
        sorted_rows(structure.triangles_m.mean(axis=1)), sorted_rows(CORNERS[FACES].mean(axis=1)), atol=1e-5
    )
    np.testing.assert_allclose(structure.bounds_m, [[0, 0, 0], [2, 3, 4]], atol=1e-6)
    assert source.meshes[0].sha256 == hashlib.sha256(path.read_bytes()).hexdigest()


def test_placement_is_scale_then_up_then_rotation_then_position(tmp_path):
    write(tmp_path, "stl")
    structure, _ = load(tmp_path, scale=10, up="y", rotation_deg=90, position_m=(100, 0, 5))
    # (x, y, z) -> 10 (x, -z, y) -> turned a quarter: (-y', x', z') -> moved
    by_hand = np.array([[100 + 10 * z, 10 * x, 5 + 10 * y] for x, y, z in CORNERS])
    np.testing.assert_allclose(sorted_rows(np.unique(structure.vertices_m.round(6), axis=0)), sorted_rows(by_hand))


def test_meshes_are_put_together_with_their_cables(tmp_path):
    write(tmp_path, "stl")
    cable = Cable(from_m=(0, 0, 0), to_m=(0, 0, 9), radius_m=0.1)
    source = StructureSource(
        meshes=(MeshSource(file="part.stl"), MeshSource(file="part.stl", position_m=(50, 0, 0))), cables=(cable,)
    )
    structure, filled = load_structure(source, tmp_path)
    assert len(structure.faces) == 8
    assert structure.cables == (cable,)
    np.testing.assert_allclose(structure.bounds_m, [[-0.1, -0.1, -0.1], [52, 3, 9.1]])
    assert all(m.sha256 for m in filled.meshes)


def test_a_scene_graph_places_its_objects(tmp_path):
    box = trimesh.Trimesh(CORNERS, FACES, process=False)
    scene = trimesh.Scene()
    scene.add_geometry(box)
    scene.add_geometry(box, transform=trimesh.transformations.translation_matrix([0, 0, 30]))
    (tmp_path / "part.glb").write_bytes(scene.export(file_type="glb"))
    structure, _ = load(tmp_path, file="part.glb")
    assert len(structure.faces) == 8
    np.testing.assert_allclose(structure.bounds_m[1], [2, 3, 34], atol=1e-5)


def test_degenerate_triangles_are_dropped_and_said(tmp_path):
    thin = np.vstack([FACES, [[0, 1, 1]], [[2, 2, 2]]])
    write(tmp_path, "off", faces=thin)
    structure, _ = load(tmp_path, file="part.off")
    assert len(structure.faces) == 4
    assert structure.notes == ("part.off: 2 triangles without area were left out",)


def test_a_file_with_only_lines_is_refused(tmp_path):
    write(tmp_path, "off", faces=np.array([[0, 1, 1]]))
    with pytest.raises(InputError, match=r"part\.off: all its triangles are only lines"):
        load(tmp_path, file="part.off")


def test_a_written_unit_is_ignored_and_said(tmp_path):
    path = write(tmp_path, "dae")
    inch = '<unit name="inch" meter="0.0254"/><up_axis>Y_UP</up_axis></asset>'
    path.write_text(path.read_text().replace("<up_axis>Y_UP</up_axis>", "").replace("</asset>", inch))
    structure, _ = load(tmp_path, file="part.dae")
    np.testing.assert_allclose(structure.bounds_m[1], [2, 3, 4], atol=1e-6)
    assert "0.0254" in structure.notes[0]
    assert "ignored" in structure.notes[0]


def test_nan_is_refused(tmp_path):
    bad = CORNERS.copy()
    bad[3, 1] = np.nan
    write(tmp_path, "stl", vertices=bad)
    with pytest.raises(InputError, match=r"part\.stl: 3 triangles have corners that are not finite"):
        load(tmp_path)


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(InputError, match=r"part\.stl: there is no such file"):
        load(tmp_path)


def test_an_empty_file_is_refused(tmp_path):
    (tmp_path / "part.stl").touch()
    with pytest.raises(InputError, match="the file is empty"):
        load(tmp_path)


@pytest.mark.parametrize("ending", ENDINGS)
@pytest.mark.parametrize("content", [b"\x89PNG\r\n\x1a\n" + bytes(range(256)) * 4, b"hello, this is a letter\n" * 9])
def test_what_is_not_a_mesh_is_refused(tmp_path, ending, content):
    (tmp_path / f"part.{ending}").write_bytes(content)
    with pytest.raises(InputError) as caught:
        load(tmp_path, file=f"part.{ending}")
    assert f"part.{ending}" in caught.value.field
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("ending", ["stl", "ply", "glb"])
def test_a_file_cut_short_is_refused(tmp_path, ending):
    path = write(tmp_path, ending)
    path.write_bytes(path.read_bytes()[:-30])
    with pytest.raises(InputError, match=rf"part\.{ending}"):
        load(tmp_path, file=path.name)


def test_a_point_cloud_is_not_a_mesh(tmp_path):
    (tmp_path / "part.ply").write_bytes(trimesh.PointCloud(CORNERS).export(file_type="ply"))
    with pytest.raises(InputError, match="no triangles"):
        load(tmp_path, file="part.ply")


def test_another_kind_of_file_is_refused(tmp_path):
    (tmp_path / "part.docx").write_bytes(b"x")
    with pytest.raises(InputError, match="a mesh is one of STL, OBJ"):
        load(tmp_path, file="part.docx")


def test_a_face_without_its_vertex_is_refused(tmp_path):
    (tmp_path / "part.off").write_text("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 7\n")
    with pytest.raises(InputError, match=r"part\.off"):
        load(tmp_path, file="part.off")


def test_a_file_that_changed_since_the_plan_is_refused(tmp_path):
    write(tmp_path, "stl")
    _, source = load(tmp_path)
    load_structure(source, tmp_path)
    write(tmp_path, "stl", vertices=CORNERS * 2)
    with pytest.raises(InputError, match="has changed"):
        load_structure(source, tmp_path)


def test_the_sample_scenario_is_complete_and_its_structure_loads(tmp_path):
    scenario = parse_scenario(sample_scenario("gantry-crane"))
    structure, source = load_structure(scenario.structure, tmp_path)
    assert source == scenario.structure
    assert len(structure.named_points) == 18


@pytest.mark.parametrize("name", AVAILABLE_SAMPLES)
def test_every_sample_loads_with_its_scenario(tmp_path, name):
    structure, _ = load_structure(parse_scenario(sample_scenario(name)).structure, tmp_path)
    assert len(structure.faces) > 100


def test_a_file_that_is_named_often_is_read_once(tmp_path, monkeypatch):
    write(tmp_path, "stl")
    read = []
    monkeypatch.setattr(mesh_loading, "read_mesh", lambda path: read.append(path) or read_mesh(path))
    meshes = tuple(
        MeshSource(file="part.stl", position_m=(20 * k, 0, 0), scale=1 + k, up="y" if k == 2 else "z") for k in range(3)
    )
    structure, source = load_structure(StructureSource(meshes=meshes), tmp_path)
    assert len(read) == 1
    assert structure.faces.shape == (12, 3)
    lying = np.stack([3 * CORNERS[:, 0] + 40, -3 * CORNERS[:, 2], 3 * CORNERS[:, 1]], axis=1)
    by_hand = [CORNERS[FACES], 2 * CORNERS[FACES] + np.array([20, 0, 0]), lying[FACES]]
    np.testing.assert_allclose(structure.triangles_m, np.concatenate(by_hand))
    assert len({m.sha256 for m in source.meshes}) == 1


def test_a_sha_256_is_checked_for_every_instance(tmp_path):
    write(tmp_path, "stl")
    meshes = (MeshSource(file="part.stl"), MeshSource(file="part.stl", sha256="0" * 64))
    with pytest.raises(InputError, match="has changed"):
        load_structure(StructureSource(meshes=meshes), tmp_path)


def test_repeated_triangles_are_dropped_and_said(tmp_path):
    write(tmp_path, "stl", faces=np.vstack([FACES, FACES[:2], FACES[2:3, ::-1]]))
    structure, _ = load(tmp_path)
    assert len(structure.faces) == 4
    assert structure.notes == ("part.stl: 3 triangles that repeat another one were left out",)


def test_an_stl_shares_its_vertices_and_keeps_its_triangles(tmp_path):
    ball = trimesh.creation.icosphere(subdivisions=3, radius=7)
    (tmp_path / "part.stl").write_bytes(ball.export(file_type="stl"))
    structure, _ = load(tmp_path)
    assert structure.vertices_m.shape == ball.vertices.shape
    np.testing.assert_array_equal(structure.triangles_m, ball.triangles.astype(np.float32))


@pytest.mark.parametrize("ending", ["stl", "obj", "ply", "off"])
def test_a_position_takes_map_coordinates_off_before_they_hurt(tmp_path, ending):
    offset = np.array([500000.0, 4649776.0, 20.0])
    corners = CORNERS + np.array([0.1234, 0.5678, 0.0042])
    lines = [" ".join(f"{c:.4f}" for c in v) for v in corners + offset]
    if ending == "stl":
        facet = "facet normal 0 0 0\nouter loop\n{}endloop\nendfacet\n"
        facets = (facet.format("".join(f"vertex {lines[k]}\n" for k in f)) for f in FACES)
        text = f"solid s\n{''.join(facets)}endsolid s\n"
    elif ending == "obj":
        text = "".join(f"v {v}\n" for v in lines) + "".join(f"f {a + 1} {b + 1} {c + 1}\n" for a, b, c in FACES)
    else:
        head = "OFF\n4 4 0\n"
        if ending == "ply":
            head = "ply\nformat ascii 1.0\nelement vertex 4\n" + "".join(f"property float {c}\n" for c in "xyz")
            head += "element face 4\nproperty list uchar int vertex_indices\nend_header\n"
        text = head + "\n".join(lines) + "\n" + "".join(f"3 {a} {b} {c}\n" for a, b, c in FACES)
    (tmp_path / f"part.{ending}").write_text(text)
    structure, _ = load(tmp_path, file=f"part.{ending}", position_m=tuple(-offset))
    np.testing.assert_allclose(structure.triangles_m, corners[FACES], atol=1e-6)
    assert structure.placement_error_m == 0


def test_a_structure_far_from_the_anchor_is_refused_with_the_position_that_centres_it(tmp_path):
    write(tmp_path, "off", vertices=CORNERS + np.array([500000, 4649776, 120]))
    with pytest.raises(InputError, match=r"structure\.meshes\.0\.position_m: part\.off would stand 4677 km") as caught:
        load(tmp_path, file="part.off")
    position = re.search(r"\[(.*)\]", caught.value.message)[1]
    structure, _ = load(tmp_path, file="part.off", position_m=tuple(float(c) for c in position.split(",")))
    low, high = structure.bounds_m
    assert np.abs((low + high)[:2]).max() <= 1.01
    assert abs(low[2]) <= 0.51


def test_the_position_that_centres_counts_with_what_was_given(tmp_path):
    write(tmp_path, "off")
    with pytest.raises(InputError, match=r"\[-1, -2, 0\]"):
        load(tmp_path, file="part.off", position_m=(0, 90000, 0))


@pytest.mark.parametrize(
    ("size", "given", "said"),
    [
        (30000.0, 1.0, r"with scale 1 it is 30 km in size: is that right\? Else set `scale: 0.001` for 30 m"),
        (4000.0, 1.0, r"4 km in size.*Else set `scale: 0.01` for 40 m"),
        (0.03, 1.0, r"30 mm in size.*Else set `scale: 1000` for 30 m"),
        (30.0, 0.001, r"with scale 0.001 it is 30 mm in size.*Else set `scale: 1` for 30 m"),
        (30.0, 1000.0, r"30 km in size.*Else set `scale: 1` for 30 m"),
    ],
)
def test_units_that_must_be_wrong_are_asked_about(tmp_path, size, given, said):
    write(tmp_path, "off", vertices=CORNERS / 4 * size)
    with pytest.raises(InputError, match=r"part\.off: .*" + said):
        load(tmp_path, file="part.off", scale=given)


def test_an_unlikely_size_can_be_confirmed(tmp_path):
    write(tmp_path, "off", vertices=CORNERS / 4 * 0.3)
    structure, _ = load_structure(StructureSource(meshes=(MeshSource(file="part.off"),), size_is_right=True), tmp_path)
    assert structure.bounds_m[1, 2] == pytest.approx(0.3)


def test_a_small_part_beside_a_large_one_is_nothing_to_ask_about(tmp_path):
    write(tmp_path, "off")
    meshes = (MeshSource(file="part.off"), MeshSource(file="part.off", scale=0.01))
    assert len(load_structure(StructureSource(meshes=meshes), tmp_path)[0].faces) == 8
