"""Meshes placed by surveyed points: where they come to stand, what is added to the error, what is refused."""

import json

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from gcs.core.errors import InputError
from gcs.core.scenario import parse_scenario
from gcs.core.structure_source import StructureSource
from gcs.storage.mesh_files import load_structure
from gcs.storage.ply_files import ply_bytes

TURN = Rotation.from_euler("zyx", [70, 4, -3], degrees=True).as_matrix()
SHIFT = np.array([12.5, -30.25, 1.75])
PICKED = np.array([[-2, -3, -10], [2, -3, -10], [2, 3, -10], [-2, 3, 10], [2, -3, 10.0]])


@pytest.fixture
def box():
    return trimesh.creation.box((4, 6, 20))


@pytest.fixture
def load(tmp_path, box):
    def load(picked=PICKED, world=None, mesh=None, **options):
        (mesh or box).export(tmp_path / "box.ply")
        world = PICKED @ TURN.T + SHIFT if world is None else world
        points = [{"mesh": m, "world_m": w} for m, w in zip(picked.tolist(), world.tolist(), strict=True)]
        align = {"points": points, **options.pop("align", {})}
        source = {"meshes": [{"file": "box.ply", **options, "align": align}]}
        return load_structure(StructureSource.model_validate(source), tmp_path)

    return load


def same_places(found, expected, atol=1e-9):
    a, b = (np.round(x[np.lexsort(np.round(x, 6).T)], 12) for x in (found, expected))
    np.testing.assert_allclose(a, b, atol=atol)


@pytest.mark.parametrize("count", [3, 4, 5])
def test_exact_points_place_exactly(load, box, count):
    structure, _ = load(PICKED[:count], (PICKED @ TURN.T + SHIFT)[:count])
    same_places(structure.vertices_m, np.array(box.vertices) @ TURN.T + SHIFT)
    assert structure.placement_error_m < 1e-9


def test_map_coordinates_in_the_file_are_placed_to_less_than_a_millimetre(load, box, tmp_path):
    origin = np.array([500000.125, 4649776.75, 35.5])
    places = np.array(box.vertices) + origin
    lines = [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in places]
    lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in box.faces]
    (tmp_path / "map.obj").write_text("\n".join(lines) + "\n")
    structure, _ = load(PICKED + origin, file="map.obj")
    same_places(structure.vertices_m, np.array(box.vertices) @ TURN.T + SHIFT, atol=1e-6)
    assert structure.placement_error_m < 1e-6


def test_coarse_numbers_of_a_file_count_as_error(load, box):
    origin = np.array([500000.0, 4649776.0, 35.0])
    moved = box.copy()
    moved.vertices = moved.vertices + origin
    structure, source = load(PICKED + origin, mesh=moved)
    assert structure.placement_error_m == pytest.approx(np.sqrt(3) / 4)
    assert "single precision, in steps of 0.5 m" in structure.notes[-1]
    assert source.meshes[0].file == "structure.ply"


def test_scale_of_units_stays_and_a_scale_can_be_found(load, box):
    small = box.copy()
    small.vertices = small.vertices * 1000
    structure, _ = load(PICKED * 1000, mesh=small, scale=0.001)
    same_places(structure.vertices_m, np.array(box.vertices) @ TURN.T + SHIFT, atol=1e-6)
    structure, _ = load(PICKED * 1000, mesh=small, align={"find_scale": True})
    same_places(structure.vertices_m, np.array(box.vertices) @ TURN.T + SHIFT, atol=1e-6)
    assert any("scale 0.001" in note for note in structure.notes)


def test_the_error_is_no_less_than_the_worst_residual(load):
    world = PICKED @ TURN.T + SHIFT
    world[3] += [0.08, -0.05, 0.06]
    structure, _ = load(world=world)
    fit, _ = Rotation.align_vectors(world - world.mean(axis=0), PICKED - PICKED.mean(axis=0))
    placed = fit.apply(PICKED - PICKED.mean(axis=0)) + world.mean(axis=0)
    worst = np.linalg.norm(placed - world, axis=1).max()
    assert worst <= structure.placement_error_m < 4 * worst
    (note,) = structure.notes
    assert f"{worst:.3f} m at worst (point 4)" in note
    assert f"{structure.placement_error_m:.3f} m come on top of safety.model_m" in note


def test_points_close_together_make_the_far_end_uncertain(load):
    """Five points in one corner of the box say little about its other end."""
    rng = np.random.default_rng(1)
    close = np.array([-2, -3, -10]) + rng.uniform(0, 1.5, (5, 3))
    structure, _ = load(close, close @ TURN.T + SHIFT + rng.normal(0, 0.01, (5, 3)))
    assert structure.placement_error_m > 0.05


def test_what_is_recorded_places_the_same_for_a_program_that_knows_no_alignment(load, tmp_path):
    world = PICKED @ TURN.T + SHIFT
    world[0] += [0.05, 0, 0]
    structure, source = load(world=world)
    recorded = json.loads(source.model_dump_json())
    (mesh,) = recorded["meshes"]
    assert (mesh["file"], mesh["scale"], mesh["up"], mesh["rotation_deg"]) == ("structure.ply", 1.0, "z", 0.0)
    assert mesh["position_m"] == [0, 0, 0]
    assert mesh["align"] is None
    assert recorded["placed_from"][0]["file"] == "box.ply"
    assert len(recorded["placed_from"][0]["align"]["points"]) == 5
    (tmp_path / "structure.ply").write_bytes(ply_bytes(structure.vertices_m, structure.faces))
    read = trimesh.load(tmp_path / "structure.ply", process=False)
    np.testing.assert_array_equal(np.asarray(read.vertices), structure.vertices_m)
    again, same = load_structure(StructureSource.model_validate(recorded), tmp_path)
    np.testing.assert_array_equal(again.vertices_m, structure.vertices_m)
    assert again.placement_error_m == 0  # the recorded budget holds it already
    assert same == source


def refused(load, *args, **kwargs):
    with pytest.raises(InputError) as caught:
        load(*args, **kwargs)
    assert caught.value.field == "structure.meshes.0.align.points"
    assert "\n" not in caught.value.message
    return caught.value.message


def test_points_on_a_line_are_refused(load):
    line = np.outer([0, 1, 2, 3], [1, 0, 0.0])
    assert "on one line" in refused(load, line, line @ TURN.T)
    assert "`world_m`" in refused(load, PICKED[:3], np.zeros((3, 3)))


def test_a_point_that_is_wrong_is_named(load):
    world = PICKED @ TURN.T + SHIFT
    world[2] += [5, 0, 0]
    assert "the others fit without point 3" in refused(load, world=world)


def test_a_forgotten_scale_is_named(load, box):
    small = box.copy()
    small.vertices = small.vertices * 1000
    assert "with `scale: 0.001` they would" in refused(load, PICKED * 1000, mesh=small)
    feet = box.copy()
    feet.vertices = feet.vertices / 0.3048
    assert "with `scale: 0.3048` they would" in refused(load, PICKED / 0.3048, mesh=feet)


def test_a_mirrored_frame_is_named(load):
    assert "mirror image" in refused(load, world=PICKED * [1, -1, 1])


def test_points_that_do_not_fit_at_all(load):
    rng = np.random.default_rng(0)
    assert "look at their order" in refused(load, world=rng.uniform(-10, 10, (5, 3)))


def test_map_coordinates_of_the_world_are_refused(load):
    message = refused(load, world=PICKED + np.array([500000, 4649776, 0]))
    assert "not in map coordinates" in message


def scenario(scenario_data, **mesh):
    scenario_data["structure"]["meshes"][0] |= mesh
    return parse_scenario(scenario_data)


POINTS = [{"mesh": m, "world_m": m} for m in PICKED.tolist()]


@pytest.mark.parametrize(
    ("by_hand", "named"),
    [
        ({"position_m": [0, 0, 1]}, "position_m"),
        ({"rotation_deg": 10}, "rotation_deg"),
        ({"up": "y"}, "up"),
    ],
)
def test_by_hand_and_by_points_at_once_is_refused(scenario_data, by_hand, named):
    with pytest.raises(InputError, match=rf"structure\.meshes\.0: align already says.*{named}"):
        scenario(scenario_data, align={"points": POINTS}, **by_hand)


def test_a_scale_given_and_found_is_refused(scenario_data):
    with pytest.raises(InputError, match=r"align already says.*scale"):
        scenario(scenario_data, align={"points": POINTS, "find_scale": True}, scale=0.01)
    scenario(scenario_data, align={"points": POINTS}, scale=0.01)


def test_two_points_are_refused(scenario_data):
    with pytest.raises(InputError, match=r"structure\.meshes\.0\.align\.points"):
        scenario(scenario_data, align={"points": POINTS[:2]})


def test_a_scenario_with_an_alignment_survives_its_record(scenario_data):
    parsed = scenario(scenario_data, align={"points": POINTS})
    assert parse_scenario(parsed.model_dump(mode="json", exclude_none=True)) == parsed
