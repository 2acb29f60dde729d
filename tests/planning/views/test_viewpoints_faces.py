"""Viewpoints of faces on a box tower of 8 x 8 x 24 m, where distances and obstacles are known by hand."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from gcs.core.errors import InfeasibleError, InputError, OperationCancelled
from gcs.core.inspection import FaceTask, Inspection, NamedPoint, Region, SurfaceTask
from gcs.core.plan import CellNote, FaceCoverage
from gcs.core.progress import SilentProgress
from gcs.core.scenario import Fence
from gcs.core.structure import Structure
from gcs.core.structure_source import Cable
from gcs.planning.face_certificate import recheck_faces
from gcs.planning.flights.flight_scene import prepare_scene
from gcs.planning.scene.visibility import SightLines
from gcs.planning.views.camera_footprint import faces_camera, in_image
from gcs.planning.views.face_grid import face_cells
from gcs.planning.views.face_obstacles import (
    CABLE_HIDES,
    CABLE_NEAR,
    GROUND_NEAR,
    OUTSIDE_FENCE,
    STRUCTURE_NEAR,
    UNDER_COVER,
    UNREACHABLE,
)
from gcs.planning.views.stand_off import cell_stand_off
from gcs.planning.views.viewpoints import KEPT_MORE_M, find_viewpoints
from gcs.planning.views.viewpoints_faces import OFF_SURFACE, OUT_OF_GIMBAL

QUIET = SilentProgress()
CELL = 4.0
EAST = FaceTask(name="east", origin_m=(4, -4, 8), along_m=(0, 8, 0), up_m=(0, 0, 16), normal=(1, 0, 0), cell_m=CELL)


def asking(scenario, *faces, **changes):
    more = changes.pop("inspection", {})
    return scenario.model_copy(update={"fence": None, **changes, "inspection": Inspection(faces=faces, **more)})


def found_in(scenario, structure, scene=None):
    scene = scene or prepare_scene(scenario, structure, QUIET)
    return find_viewpoints(scenario, structure, scene.space, scene.distance, QUIET), scene


@pytest.fixture(scope="module")
def tower_scene(tower_scenario, tower):
    return prepare_scene(asking(tower_scenario, EAST), tower, QUIET)


def stand_off_m(scenario, cell_m=CELL):
    """The footprint is the cell and the position error on every side; the larger distance wins."""
    camera, error = scenario.camera, scenario.safety.position_m
    asked = cell_m + 2 * error
    across = asked * camera.focal_length_mm / camera.sensor_width_mm
    return max(across, asked * camera.focal_length_mm / camera.sensor_height_mm)


def assert_shows_whole_cell(pose, cell, normal, scenario, structure, incidence_deg=60.0):
    """The cell's edge is in the picture wherever the position error puts the camera, and all of it is in sight."""
    share = np.linspace(-1, 1, 9)
    grid = cell.at(np.stack(np.meshgrid(share, share), axis=-1).reshape(-1, 2))
    error = 0.999 * scenario.safety.position_m
    right = np.cross(pose.direction, pose.up)
    for shift in (error * right, -error * right, error * pose.up, -error * pose.up):
        assert in_image(scenario.camera, pose.position_m + shift, pose.direction, pose.up, grid, math.inf).all()
    assert faces_camera(pose.position_m, grid, np.tile(normal, (81, 1)), math.radians(incidence_deg) + 1e-6).all()
    inner = cell.middle_m + 0.99 * (grid - cell.middle_m) + 0.02 * np.asarray(normal)
    assert SightLines(structure).clear(pose.position_m, inner).all()


def test_the_tower_papers_grid():
    face = FaceTask(name="south", origin_m=(1, 2, 0), along_m=(4, 0, 0), up_m=(0, 0, 88), normal=(0, -1, 0), cell_m=1.0)
    cells = face_cells(face)
    assert len(cells) == 4 * 88 == face.rows * face.columns
    assert [c.name for c in cells[:5]] == [
        "south-r01-c01",
        "south-r01-c02",
        "south-r01-c03",
        "south-r01-c04",
        "south-r02-c01",
    ]
    expected = [[1 + c + 0.5, 2, r + 0.5] for r in range(88) for c in range(4)]
    np.testing.assert_allclose([c.middle_m for c in cells], expected)


def test_the_last_row_and_column_are_as_much_smaller_as_the_face_is():
    face = FaceTask(name="f", origin_m=(0, 0, 0), along_m=(2.5, 0, 0), up_m=(0, 0, 1.2), normal=(0, 1, 0), cell_m=1.0)
    cells = face_cells(face)
    width = [2 * np.linalg.norm(c.along_m) for c in cells]
    height = [2 * np.linalg.norm(c.up_m) for c in cells]
    np.testing.assert_allclose(width, [1, 1, 0.5] * 2)
    np.testing.assert_allclose(height, [1] * 3 + [0.2] * 3)
    np.testing.assert_allclose(cells[-1].at(np.array([[1.0, 1.0]]))[0], [2.5, 0, 1.2])


def test_a_side_that_is_a_rounding_error_too_long_gets_no_sliver():
    third = FaceTask(name="f", origin_m=(0, 0, 0), along_m=(0.3, 0, 0), up_m=(0, 0, 0.7), normal=(0, 1, 0), cell_m=0.1)
    assert (third.columns, third.rows) == (3, 7)


def test_cells_are_photographed_from_where_their_footprint_and_the_position_error_fit(
    tower_scenario, tower, tower_scene
):
    scenario = asking(tower_scenario, EAST)
    found, _ = found_in(scenario, tower, tower_scene)
    distance = stand_off_m(scenario)
    assert distance == pytest.approx((CELL + 2 * 0.3) / (2 * 0.5))
    straight = cell_stand_off(scenario.camera, CELL, CELL, math.pi / 2, width_error_m=0.3, length_error_m=0.3)
    assert distance == pytest.approx(straight.distance_m), "the yard paper's stand-off, put right, says the same"
    expected = [[4 + distance, -4 + CELL * (c + 0.5), 8 + CELL * (r + 0.5)] for r in range(4) for c in range(2)]
    np.testing.assert_allclose([p.position_m for p in found.poses], expected)
    assert [p.name for p in found.poses] == [c.name for c in face_cells(EAST)]
    assert found.faces == (FaceCoverage("east", 8, (), ()),)
    for pose, cell in zip(found.poses, face_cells(EAST), strict=True):
        np.testing.assert_allclose(pose.direction, [-1, 0, 0], atol=1e-12)
        assert pose.gsd_m == pytest.approx(scenario.camera.gsd_at(distance))
        assert_shows_whole_cell(pose, cell, [1, 0, 0], scenario, tower)


def test_small_cells_are_photographed_from_the_clearance(tower_scenario, tower, tower_scene):
    face = EAST.model_copy(update={"cell_m": 1.0})
    scenario = asking(tower_scenario, face)
    found, scene = found_in(scenario, tower, tower_scene)
    nearest = scene.space.clearance_m + KEPT_MORE_M
    assert stand_off_m(scenario, 1.0) < nearest
    np.testing.assert_allclose([p.position_m[0] - 4 for p in found.poses], nearest)
    assert found.faces[0].covered == len(found.poses) == 8 * 16


def test_a_gsd_must_hold_where_the_cell_fits(tower_scenario, tower, tower_scene):
    best = 1000 * tower_scenario.camera.gsd_at(stand_off_m(tower_scenario))
    good = EAST.model_copy(update={"gsd_mm": 1.001 * best})
    found, _ = found_in(asking(tower_scenario, good), tower, tower_scene)
    assert all(1000 * p.gsd_m <= good.gsd_mm for p in found.poses)
    fine = EAST.model_copy(update={"gsd_mm": 0.99 * best})
    with pytest.raises(
        InfeasibleError,
        match=rf"inspection\.faces\.east: .* the best it can have is {math.ceil(100 * best) / 100:.2f} mm",
    ):
        found_in(asking(tower_scenario, fine), tower, tower_scene)


def test_cells_too_large_for_any_viewpoint_say_so(tower_scenario, tower, tower_scene):
    huge = EAST.model_copy(update={"along_m": (0, 80, 0), "up_m": (0, 0, 80), "cell_m": 80.0})
    with pytest.raises(
        InfeasibleError, match=r"faces\.east: .* only from 80\.60 m, and viewpoints are at most 40 m away"
    ):
        prepare_scene(asking(tower_scenario, huge), tower, QUIET)


def test_the_incidence_limit_holds_at_the_corners(tower_scenario, tower, tower_scene):
    square = EAST.model_copy(update={"max_incidence_deg": 25.0})
    scenario = asking(tower_scenario, square)
    found, _ = found_in(scenario, tower, tower_scene)
    half_diagonal = CELL / math.sqrt(2)
    distance = half_diagonal / math.tan(math.radians(25))
    assert distance > stand_off_m(scenario)
    np.testing.assert_allclose([p.position_m[0] - 4 for p in found.poses], distance)


@pytest.fixture(scope="module")
def beside_a_stay(tower_scenario, tower):
    """A vertical cable through the wanted places of the cells with y > 0, and the viewpoints that are found."""
    scenario = asking(tower_scenario, EAST)
    x = 4 + stand_off_m(scenario)
    structure = replace(tower, cables=(Cable(from_m=(x, 2, 0), to_m=(x, 2, 30), radius_m=0.05),))
    found, scene = found_in(scenario, structure)
    return SimpleNamespace(scenario=scenario, structure=structure, found=found, scene=scene)


def test_a_stay_blocks_the_cells_that_it_is_in_front_of(beside_a_stay):
    space = beside_a_stay.scene.space
    assert space.clearance_m < 4, "the free column's places are 4 m from the cable"
    blocked = [cell.name for cell in face_cells(EAST) if cell.middle_m[1] > 0]
    (face,) = beside_a_stay.found.faces
    assert face.moved == tuple(CellNote(name, CABLE_NEAR) for name in blocked)
    assert (face.not_covered, face.covered) == ((), 8)


def test_moved_viewpoints_are_free_and_show_their_whole_cell(beside_a_stay):
    scenario, structure, scene = beside_a_stay.scenario, beside_a_stay.structure, beside_a_stay.scene
    poses = {p.name: p for p in beside_a_stay.found.poses}
    distance = scene.distance.distance([p.position_m for p in beside_a_stay.found.poses])
    assert distance.min() >= scene.space.clearance_m
    for cell in face_cells(EAST):
        pose = poses[cell.name]
        assert_shows_whole_cell(pose, cell, [1, 0, 0], scenario, structure)
        np.testing.assert_allclose(np.cross(pose.direction, cell.middle_m - pose.position_m), 0, atol=1e-9)
        straight = np.allclose(pose.position_m, cell.middle_m + np.array([stand_off_m(scenario), 0, 0]))
        assert straight == (cell.middle_m[1] < 0)


def test_a_cell_right_behind_a_stay_is_named_with_the_reason(tower_scenario, tower):
    # half a metre off the wall and in the middle of the column of cells: it hides part of them from everywhere
    structure = replace(tower, cables=(Cable(from_m=(4.5, 2, 0), to_m=(4.5, 2, 30), radius_m=0.05),))
    found, scene = found_in(asking(tower_scenario, EAST), structure)
    assert stand_off_m(tower_scenario) - 0.5 > scene.space.clearance_m, "the places themselves are free"
    (face,) = found.faces
    hidden = [cell.name for cell in face_cells(EAST) if cell.middle_m[1] > 0]
    assert [note.cell for note in face.not_covered] == hidden
    other = "no other place within 60 degrees of its normal sees all of it"
    assert {note.reason for note in face.not_covered} == {f"{CABLE_HIDES}, and {other}"}
    assert {p.name for p in found.poses} == {cell.name for cell in face_cells(EAST)} - set(hidden)


def test_places_under_a_stay_are_moved_out_into_the_open(tower_scenario, tower):
    # over the column of places with y > 0, and far above them: they are free and see their cells
    x = 4 + stand_off_m(tower_scenario)
    structure = replace(tower, cables=(Cable(from_m=(x, 2, 30), to_m=(x, 5, 30), radius_m=0.05),))
    found, scene = found_in(asking(tower_scenario, EAST), structure)
    (face,) = found.faces
    assert face.moved == tuple(CellNote(cell.name, UNDER_COVER) for cell in face_cells(EAST) if cell.middle_m[1] > 0)
    assert scene.space.is_open_sky([p.position_m for p in found.poses]).all()


def test_places_too_near_the_ground_are_moved_up(tower_scenario, tower, tower_scene):
    low = EAST.model_copy(update={"origin_m": (4, -4, 0), "up_m": (0, 0, 8)})
    found, scene = found_in(asking(tower_scenario, low), tower, tower_scene)
    assert CELL / 2 < scene.space.clearance_m < 1.5 * CELL
    (face,) = found.faces
    assert face.moved == tuple(CellNote(f"east-r01-c0{c}", GROUND_NEAR) for c in (1, 2))
    assert min(p.position_m[2] for p in found.poses) >= scene.space.clearance_m
    assert all(p.direction[2] < 0 for p in found.poses if "r01" in p.name)


def test_places_outside_the_fence_are_moved_into_it(tower_scenario, tower):
    # straight in front of the cells with y > 0 is inside, of the others is not
    corners = [(-40, -40), (3.9, -40), (3.9, -1), (40, -1), (40, 40), (-40, 40)]
    scenario = asking(tower_scenario, EAST, fence=Fence(include=(corners,)))
    (face,) = found_in(scenario, tower)[0].faces
    blocked = {note.cell: note.reason for note in (*face.moved, *face.not_covered)}
    assert set(blocked) == {cell.name for cell in face_cells(EAST) if cell.middle_m[1] < 0}
    assert all(reason.startswith(OUTSIDE_FENCE) for reason in blocked.values())


def test_structure_in_front_is_told_from_cables(tower_scenario, tower):
    # a wall 5 m in front of the lower half: its cells' places have no room
    wall = np.array([[x, y, z] for x in (9.0, 9.2) for y in (-30.0, 30.0) for z in (0.0, 14.0)])
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (1, 5, 7, 3), (0, 2, 6, 4)]
    triangles = np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))])
    structure = Structure(
        np.concatenate([tower.vertices_m, wall]), np.concatenate([tower.faces, triangles + len(tower.vertices_m)])
    )
    (face,) = found_in(asking(tower_scenario, EAST), structure)[0].faces
    notes = {note.cell: note.reason for note in (*face.moved, *face.not_covered)}
    assert {name for name in notes if name[:8] in ("east-r01", "east-r02")} == {
        f"east-r0{r}-c0{c}" for r in (1, 2) for c in (1, 2)
    }
    assert all(reason.startswith(STRUCTURE_NEAR) for reason in notes.values())


def test_an_underside_is_seen_aslant_when_the_gimbal_cannot_look_up(tower_scenario):
    deck = np.array([[x, y, z] for x in (-16.0, 16.0) for y in (-16.0, 16.0) for z in (20.0, 21.0)])
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (1, 5, 7, 3), (0, 2, 6, 4)]
    structure = Structure(deck, np.array([t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]))
    under = FaceTask(
        name="under", origin_m=(-1, -1, 20), along_m=(2, 0, 0), up_m=(0, 2, 0), normal=(0, 0, -1), cell_m=2.0
    )
    scenario = asking(tower_scenario, under)
    with pytest.raises(InfeasibleError, match=rf"faces\.under: not one of its 1 cells .*{OUT_OF_GIMBAL}, and no other"):
        found_in(asking(tower_scenario, under, camera=_with_gimbal(scenario, 25.0)), structure)
    found, _ = found_in(asking(tower_scenario, under, camera=_with_gimbal(scenario, 45.0)), structure)
    assert found.faces[0].moved == (CellNote("under-r01-c01", OUT_OF_GIMBAL),)
    assert 0 < math.degrees(found.poses[0].gimbal_pitch_rad) <= 45 + 1e-6
    straight, _ = found_in(asking(tower_scenario, under, camera=_with_gimbal(scenario, 90.0)), structure)
    assert straight.faces[0].moved == (), "the open sky is too far away to be had"
    np.testing.assert_allclose(straight.poses[0].direction, [0, 0, 1], atol=1e-12)


def _with_gimbal(scenario, pitch_max_deg):
    gimbal = scenario.camera.gimbal.model_copy(update={"pitch_max_deg": pitch_max_deg})
    return scenario.camera.model_copy(update={"gimbal": gimbal})


def test_straight_down_the_picture_is_turned_to_go_with_the_face(tower_scenario, tower, tower_scene):
    c, s = math.cos(0.5), math.sin(0.5)
    top = FaceTask(
        name="top",
        origin_m=(0, 0, 24),
        along_m=(2 * c, 2 * s, 0),
        up_m=(-3.9 * s * 0.5, 3.9 * c * 0.5, 0),
        normal=(0, 0, 1),
        cell_m=2.0,
    )
    scenario = asking(tower_scenario, top)
    (pose,) = found_in(scenario, tower, tower_scene)[0].poses
    np.testing.assert_allclose(pose.direction, [0, 0, -1], atol=1e-12)
    np.testing.assert_allclose(pose.up, [-s, c, 0], atol=1e-12)
    assert_shows_whole_cell(pose, face_cells(top)[0], [0, 0, 1], scenario, tower)


def test_a_face_off_the_structure_says_how_far(tower_scenario, tower, tower_scene):
    off = EAST.model_copy(update={"origin_m": (5.5, -4, 8)})
    with pytest.raises(InputError, match=r"inspection\.faces\.east: the face lies up to 1\.50 m from any surface"):
        found_in(asking(tower_scenario, off), tower, tower_scene)


def test_cells_off_the_structure_are_named(tower_scenario, tower, tower_scene):
    beyond = EAST.model_copy(update={"along_m": (0, 12, 0)})
    found, _ = found_in(asking(tower_scenario, beyond), tower, tower_scene)
    assert found.faces[0].not_covered == tuple(CellNote(f"east-r0{r}-c03", OFF_SURFACE) for r in (1, 2, 3, 4))
    assert [p.name for p in found.poses] == [c.name for c in face_cells(EAST)]


@pytest.mark.parametrize("behind_m", [0.1, -0.1])
def test_a_face_a_little_off_the_surface_is_seen_all_the_same(tower_scenario, tower, tower_scene, behind_m):
    off = EAST.model_copy(update={"origin_m": (4 - behind_m, -4, 8)})
    found, _ = found_in(asking(tower_scenario, off), tower, tower_scene)
    assert found.faces[0].covered == 8


def test_a_point_on_no_surface_is_named_with_its_distance(tower_scenario, tower, tower_scene):
    point = NamedPoint(name="L3", position_m=(6.25, 0, 12), normal=(1, 0, 0))
    scenario = asking(tower_scenario, inspection={"points": (point,)})
    with pytest.raises(InputError, match=r"inspection\.points\.L3: this point lies 2\.25 m from any surface"):
        found_in(scenario, tower, tower_scene)


def test_a_face_whose_normal_points_inwards_is_refused(tower_scenario, tower, tower_scene):
    inwards = EAST.model_copy(update={"normal": (-1, 0, 0)})
    with pytest.raises(InfeasibleError, match=r"faces\.east: not one of its 8 cells can be photographed whole: ") as no:
        found_in(asking(tower_scenario, inwards), tower, tower_scene)
    assert UNREACHABLE in str(no.value) or STRUCTURE_NEAR in str(no.value)


def test_what_faces_show_is_not_photographed_twice(tower_scenario, tower, tower_scene):
    region = Region(min_m=(3.9, -3.9, 8.1), max_m=(4.1, 3.9, 23.9))
    surface = SurfaceTask(gsd_mm=4.0, overlap=0.0, regions=(region,))
    point = NamedPoint(name="P", position_m=(-4, 0, 11), normal=(-1, 0, 0))
    scenario = asking(tower_scenario, EAST, inspection={"surface": surface, "points": (point,)})
    found, _ = found_in(scenario, tower, tower_scene)
    assert [p.name for p in found.poses] == ["P", *(cell.name for cell in face_cells(EAST))]


def test_cancelling_stops_the_search(tower_scenario, tower, tower_scene):
    told = []

    class Cancelling:
        def report(self, stage, fraction):
            assert stage == "viewpoints"
            told.append(fraction)
            if len(told) == 12:
                raise OperationCancelled("stop")

    with pytest.raises(OperationCancelled):
        find_viewpoints(asking(tower_scenario, EAST), tower, tower_scene.space, tower_scene.distance, Cancelling())
    assert len(told) == 12
    assert told == sorted(told)
    assert told[-1] < 1


def recheck(beside, **changes):
    plan = SimpleNamespace(scenario=beside.scenario, faces=beside.found.faces, viewpoints=beside.found.poses)
    vars(plan).update(changes)
    (check,) = recheck_faces(plan, SightLines(beside.structure), beside.scene.distance)
    return check


def test_a_finished_plan_is_checked_cell_by_cell(beside_a_stay):
    assert recheck(beside_a_stay).ok
    first, *others = beside_a_stay.found.poses
    assert not recheck(beside_a_stay, viewpoints=others).ok, "a cell without its viewpoint"
    higher = replace(first, position_m=first.position_m + np.array([0, 0, 0.1]))
    found = recheck(beside_a_stay, viewpoints=[higher, *others])
    assert not found.ok
    assert (found.value, found.limit) == (7, 8)
    assert "not seen: east-r01-c01" in found.message
    near = replace(first, position_m=first.position_m - np.array([0.2, 0, 0]))
    assert not recheck(beside_a_stay, viewpoints=[near, *others]).ok, "the position error no longer fits"


def test_a_plan_that_is_silent_about_cells_is_found_out(beside_a_stay):
    assert not recheck(beside_a_stay, faces=()).ok
    (face,) = beside_a_stay.found.faces
    fewer = replace(face, cells=7)
    assert not recheck(beside_a_stay, faces=(fewer,)).ok
    stranger = replace(face, not_covered=(CellNote("east-r99-c01", "?"),))
    assert not recheck(beside_a_stay, faces=(stranger,)).ok
