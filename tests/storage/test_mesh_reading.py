"""Files as other programs write them: several objects, instances, transforms, and numbers of many digits."""

import numpy as np
import pytest
import trimesh

from gcs.storage.mesh_reading import read_mesh

MAP = np.array([500000.123456, 4649776.654321, 12.345678])
CORNERS = np.array([[0, 0, 0], [2, 0, 0], [0, 3, 0], [0, 0, 4.0]])
FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])


def numbers(vertices, start=""):
    return "".join(start + " ".join(f"{c:.6f}" for c in v) + "\n" for v in vertices)


def text_stl(vertices):
    facets = (f"facet normal 0 0 1\nouter loop\n{numbers(vertices[f], 'vertex ')}endloop\nendfacet\n" for f in FACES)
    return f"solid part\n{''.join(facets)}endsolid part\n"


def text_obj(vertices):
    return numbers(vertices, "v ") + "".join(f"f {a + 1} {b + 1} {c + 1}\n" for a, b, c in FACES)


def text_ply(vertices, kind="float"):
    return (
        f"ply\nformat ascii 1.0\ncomment by hand\nelement vertex 4\nproperty {kind} x\nproperty {kind} y\n"
        f"property {kind} z\nelement face 4\nproperty list uchar int vertex_indices\nend_header\n"
        + numbers(vertices)
        + "".join(f"3 {a} {b} {c}\n" for a, b, c in FACES)
    )


def text_off(vertices):
    return "OFF\n4 4 0\n" + numbers(vertices) + "".join(f"3 {a} {b} {c}\n" for a, b, c in FACES)


def collada(vertices, nodes='<node><instance_geometry url="#g"/></node>', library="", text=None):
    values = text or " ".join(f"{c:.6f}" for c in vertices.reshape(-1))
    index = " ".join(str(i) for i in FACES.reshape(-1))
    return f"""<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit name="meter" meter="1"/><up_axis>Z_UP</up_axis></asset>
<library_geometries><geometry id="g"><mesh>
<source id="p"><float_array id="pa" count="12">{values}</float_array><technique_common>
<accessor source="#pa" count="4" stride="3"><param name="X" type="float"/><param name="Y" type="float"/>
<param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles count="4"><input semantic="VERTEX" source="#v" offset="0"/><p>{index}</p></triangles>
</mesh></geometry></library_geometries>{library}
<library_visual_scenes><visual_scene id="s">{nodes}</visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#s"/></scene></COLLADA>"""


def read(folder, name, content):
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return read_mesh(path)


def corners(content):
    return content.vertices[content.faces]


@pytest.mark.parametrize(
    ("name", "writer"),
    [("a.stl", text_stl), ("a.obj", text_obj), ("a.ply", text_ply), ("a.off", text_off), ("a.dae", collada)],
)
def test_text_keeps_all_digits_of_map_coordinates(tmp_path, name, writer):
    content = read(tmp_path, name, writer(CORNERS + MAP))
    np.testing.assert_allclose(corners(content), (CORNERS + MAP)[FACES], atol=2e-9)
    assert content.step == 0


def test_binary_files_say_how_coarse_they_are(tmp_path):
    mesh = trimesh.Trimesh(CORNERS + MAP, FACES, process=False)
    for name in ("a.stl", "a.glb"):
        assert read(tmp_path, name, mesh.export(file_type=name[2:])).step == 0.5
    head = "ply\nformat binary_little_endian 1.0\nelement vertex 4\nproperty {0} x\nproperty {0} y\nproperty {0} z\n"
    head += "element face 4\nproperty list uchar int vertex_indices\nend_header\n"
    body = np.empty(4, dtype=[("n", "u1"), ("c", "<i4", 3)])
    body["n"], body["c"] = 3, FACES
    for kind, step in (("float", 0.5), ("double", 0.0)):
        places = (CORNERS + MAP).astype("<f4" if kind == "float" else "<f8")
        content = read(tmp_path, "a.ply", head.format(kind).encode() + places.tobytes() + body.tobytes())
        assert content.step == step
        np.testing.assert_array_equal(corners(content), places.astype(float)[FACES])
    near = trimesh.Trimesh(CORNERS, FACES, process=False).export(file_type="stl")
    assert read(tmp_path, "a.stl", near).step < 1e-6


def test_a_gltf_node_may_carry_the_offset(tmp_path):
    scene = trimesh.Scene()
    box = trimesh.Trimesh(CORNERS, FACES, process=False)
    scene.add_geometry(box, transform=trimesh.transformations.translation_matrix(MAP))
    scene.add_geometry(box)
    content = read(tmp_path, "a.glb", scene.export(file_type="glb"))
    found = corners(content)
    is_far = found[:, 0, 0] > 1000
    np.testing.assert_allclose(found[is_far], (CORNERS + MAP)[FACES], atol=1e-6)
    np.testing.assert_allclose(found[~is_far], CORNERS[FACES], atol=1e-6)
    assert content.step < 1e-6


def test_obj_objects_with_relative_numbers(tmp_path):
    shifted = CORNERS + np.array([10, 0, 0])
    relative = "".join(f"f {a - 4} {b - 4} {c - 4}\n" for a, b, c in FACES)
    text = f"o one\n{numbers(CORNERS, 'v ')}{relative}o two\n{numbers(shifted, 'v ')}{relative}"
    content = read(tmp_path, "a.obj", text)
    expected = np.concatenate([CORNERS[FACES], shifted[FACES]])
    np.testing.assert_allclose(np.sort(corners(content), axis=0), np.sort(expected, axis=0))


def test_obj_relative_numbers_of_texture_and_normal(tmp_path):
    text = numbers(CORNERS, "v ") + "vt 0 0\nvt 1 0\nvn 0 0 1\n"
    text += "".join(f"f {a - 4}/-1/-1 {b - 4}/-2/-1 {c - 4}/-1/-1\n" for a, b, c in FACES)
    text += numbers(CORNERS + 7, "v ") + "vt 1 1\nvn 1 0 0\n"
    text += "".join(f"f {a - 4}//-1 {b - 4}//-1 {c - 4}//-1\n" for a, b, c in FACES)
    content = read(tmp_path, "a.obj", text)
    expected = np.concatenate([CORNERS[FACES], (CORNERS + 7)[FACES]])
    key = np.round(corners(content).mean(axis=1), 6)
    np.testing.assert_allclose(key[np.lexsort(key.T)], (m := expected.mean(axis=1))[np.lexsort(m.T)], atol=1e-5)


def test_obj_with_quads_polygons_materials_and_objects(tmp_path):
    square = np.array([[0, 0, 0], [4, 0, 0], [4, 4, 0], [0, 4, 0.0]])
    angle = 2 * np.pi * np.arange(6) / 6
    hexagon = np.stack([10 + np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    text = f"mtllib none.mtl\no square\nusemtl red\n{numbers(square, 'v ')}f 1 2 3 4\n"
    text += f"o hexagon\nusemtl blue\n{numbers(hexagon, 'v ')}f 5 6 7 8 9 10\n"
    t = corners(read(tmp_path, "a.obj", text))
    area = np.linalg.norm(np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0]), axis=1).sum() / 2
    assert area == pytest.approx(16 + 3 * np.sqrt(3) / 2, rel=1e-5)


def test_collada_nodes_turn_scale_shift_and_repeat(tmp_path):
    nodes = """
    <node><translate>500000.125 4649776.25 0</translate><rotate>0 0 1 90</rotate><scale>2 2 2</scale>
      <node><translate>0 0 5</translate><instance_geometry url="#g"/></node></node>
    <node><matrix>0 -1 0 7 1 0 0 0 0 0 1 0 0 0 0 1</matrix><instance_node url="#shared"/></node>
    """
    library = """<library_nodes><node id="shared"><translate>1 2 3</translate><instance_geometry url="#g"/></node>
    </library_nodes>"""
    content = read(tmp_path, "a.dae", collada(CORNERS, nodes, library))
    lifted = 2 * (CORNERS + np.array([0, 0, 5]))
    first = np.stack([-lifted[:, 1], lifted[:, 0], lifted[:, 2]], axis=1) + np.array([500000.125, 4649776.25, 0])
    moved = CORNERS + np.array([1, 2, 3])
    second = np.stack([7 - moved[:, 1], moved[:, 0], moved[:, 2]], axis=1)
    np.testing.assert_allclose(corners(content), np.concatenate([first[FACES], second[FACES]]), atol=1e-8)


def test_collada_nan_stays_nan(tmp_path):
    content = read(tmp_path, "a.dae", collada(CORNERS, text="0 0 0 2 0 0 0 NaN 0 0 0 4"))
    assert (~content.finite_faces).sum() == 3


def test_collada_polygons(tmp_path):
    text = collada(CORNERS).replace('<triangles count="4">', '<polylist count="1">')
    text = text.replace("</triangles>", "</polylist>").replace('offset="0"/><p>', 'offset="0"/><vcount>4</vcount><p>')
    text = text.replace(" ".join(str(i) for i in FACES.reshape(-1)), "0 1 2 3")
    assert read(tmp_path, "a.dae", text).faces.shape == (2, 3)


def test_an_stl_of_several_solids(tmp_path):
    content = read(tmp_path, "a.stl", text_stl(CORNERS) + text_stl(CORNERS + 10))
    assert len(content.faces) == 8
    np.testing.assert_allclose(content.vertices.max(axis=0), [12, 13, 14])
