"""What may be asked to be inspected, and what is refused by name."""

import pytest
from pydantic import ValidationError

from gcs.core.errors import InputError
from gcs.core.inspection import MOST_CELLS, FaceTask, Inspection
from gcs.core.scenario import parse_scenario

FACE = {
    "name": "south",
    "origin_m": [0, 0, 0],
    "along_m": [4, 0, 0],
    "up_m": [0, 0, 88],
    "normal": [0, -2, 0],
    "cell_m": 1.0,
}
SCENARIO = {
    "structure": {"meshes": [{"file": "tower.stl"}]},
    "anchor": {"latitude_deg": 31.36, "longitude_deg": 121.6, "altitude_m": 4.0},
    "camera": {
        "sensor_width_mm": 13.2,
        "sensor_height_mm": 8.8,
        "focal_length_mm": 8.8,
        "image_width_px": 5472,
        "image_height_px": 3648,
    },
}


def parse(*faces, **inspection):
    return parse_scenario({**SCENARIO, "inspection": {"faces": list(faces), **inspection}})


def test_a_face_as_the_scenario_format_has_it():
    (face,) = parse(FACE).inspection.faces
    assert face.normal == (0, -1, 0), "made unit"
    assert (face.rows, face.columns) == (88, 4)
    assert face.gsd_mm is None
    assert face.cell_name(2, 3) == "south-r03-c04"


def test_names_of_many_rows_sort_as_they_are_numbered():
    (face,) = parse({**FACE, "cell_m": 0.5}).inspection.faces
    names = [face.cell_name(row, 0) for row in range(face.rows)]
    assert names == sorted(names)
    assert names[0] == "south-r001-c01"


def test_rows_and_columns_hold_the_last_piece_too():
    face = FaceTask(**{**FACE, "cell_m": 1.5})
    assert (face.rows, face.columns) == (59, 3)
    assert FaceTask(**{**FACE, "cell_m": 200.0}).rows == 1


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"along_m": [0, 0, 0]}, "inspection.faces.0.along_m: a side of the face must not be zero"),
        ({"up_m": [0, 0, 0]}, "inspection.faces.0.up_m: a side of the face must not be zero"),
        ({"normal": [0, 0, 0]}, "inspection.faces.0.normal: the normal must not be zero"),
        ({"up_m": [44, 0, 76.2]}, "inspection.faces.0: along_m and up_m must be at right angles, and are at 60.0"),
        ({"normal": [1, -1, 0]}, "inspection.faces.0: along_m and normal must be at right angles, and are at 45.0"),
        ({"normal": [0, 0, 1]}, "inspection.faces.0: up_m and normal must be at right angles, and are at 0.0"),
        ({"cell_m": 0}, "inspection.faces.0.cell_m"),
        ({"gsd_mm": -1}, "inspection.faces.0.gsd_mm"),
        ({"max_incidence_deg": 90}, "inspection.faces.0.max_incidence_deg"),
        ({"overlap": 0.3}, "inspection.faces.0.overlap: unknown field"),
        ({"cell_m": 0.1}, f"inspection: the faces have 35,200 cells (south: 35,200), and {MOST_CELLS:,} at most"),
        ({"cell_m": 1e-300}, "cells (south: "),
    ],
)
def test_what_is_wrong_with_a_face_is_named(changes, message):
    with pytest.raises(InputError) as caught:
        parse({**FACE, **changes})
    assert message in str(caught.value)


def test_right_angles_need_not_be_exact():
    assert parse({**FACE, "normal": [0.004, -1, 0.004]}).inspection.faces


def test_cells_of_all_faces_are_counted_together():
    faces = [{**FACE, "name": name, "cell_m": 0.2} for name in "ab"]
    assert parse(faces[0])
    with pytest.raises(InputError, match=r"17,600 cells \(a: 8,800, b: 8,800\)"):
        parse(*faces)


def test_names_must_differ():
    with pytest.raises(InputError, match="the names of faces must differ; given twice: south"):
        parse(FACE, FACE)
    point = {"name": "south-r03-c04", "position_m": [0, 0, 1], "normal": [0, -1, 0]}
    with pytest.raises(InputError, match="a point and a cell of face south are both named south-r03-c04"):
        parse(FACE, points=[point])
    assert parse(FACE, points=[{**point, "name": "south-r03-c05"}]), "there is no fifth column"


def test_something_must_be_asked_for():
    with pytest.raises(ValidationError, match="name at least one of surface, points and faces"):
        Inspection()
