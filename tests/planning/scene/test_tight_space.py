"""Places at the bare clearance: slots, pockets and walls with known distances, and the flights to them."""

import itertools
import math

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from gcs.core.progress import SilentProgress
from gcs.core.structure import Structure
from gcs.planning.numerics.qp_solver import default_solvers
from gcs.planning.paths.path_search import find_path
from gcs.planning.paths.string_pulling import path_length
from gcs.planning.scene.distance_field import build_distance_field
from gcs.planning.scene.free_space import SPOT_RADIUS_M, FreeSpace
from gcs.planning.scene.point_distance import SceneDistance
from gcs.planning.trajectories.box_corridor import stop_box
from gcs.planning.trajectories.safe_corridor import build_corridor, corridor_reach
from gcs.planning.trajectories.time_allocation import FlightLimits, time_legs
from gcs.planning.trajectories.trajectory_builder import longest_segment_m

CLEARANCE, HALF_WIDTH = 1.6, 0.5
REACH = corridor_reach(HALF_WIDTH)
LOW, HIGH = np.array([-20.0, -20.0, -1.0]), np.array([20.0, 20.0, 24.0])
HOME = np.array([-15.3, -14.8, 0.0])
LIMITS = FlightLimits(5.0, 2.5, None)


def space_about(*corners, turn_deg=0.0, pitch=0.25):
    mesh = trimesh.util.concatenate([trimesh.creation.box(bounds=np.array(c, dtype=float)) for c in corners])
    vertices = Rotation.from_euler("z", turn_deg, degrees=True).apply(mesh.vertices)
    structure = Structure(vertices, np.array(mesh.faces, np.int64))
    field = build_distance_field(structure, LOW, HIGH, pitch)
    return FreeSpace(field, CLEARANCE, 0.0, HOME, reach_m=REACH, climb_clearance_m=0.8), SceneDistance(structure, 0.0)


def along(path, step=0.02):
    parts = [
        a + np.linspace(0, 1, max(2, math.ceil(np.linalg.norm(b - a) / step)))[:, None] * (b - a)
        for a, b in itertools.pairwise(path)
    ]
    return np.concatenate(parts)


def flown(space, distance, path):
    """The corridor and the curve of a path; both are checked here against the exact distance."""
    leg = build_corridor(path, HALF_WIDTH, longest_segment_m(LIMITS, HALF_WIDTH), space=space)
    for low, high in leg.boxes_m:
        lattice = np.stack(np.meshgrid(*np.linspace(low, high, 7).T, indexing="ij"), axis=-1).reshape(-1, 3)
        assert distance.distance(lattice).min() >= CLEARANCE - 1e-9
    for joints in (leg.joints_m[:-1], leg.joints_m[1:]):
        assert (joints >= leg.boxes_m[:, 0] + 1e-4).all()
        assert (joints <= leg.boxes_m[:, 1] - 1e-4).all()
    (timed,) = time_legs([leg], LIMITS, default_solvers(), SilentProgress())
    assert (timed.control >= leg.boxes_m[:, :1]).all()
    assert (timed.control <= leg.boxes_m[:, 1:]).all()
    np.testing.assert_allclose(timed.control[[0, -1], [0, -1]], path[[0, -1]], atol=1e-6)
    return leg, timed


@pytest.fixture(scope="module")
def wall():
    """A wall along y whose face is at x = 4."""
    return space_about([(4, -15, 0), (6, 15, 15)])


@pytest.fixture(scope="module")
def slanted_wall():
    return space_about([(4, -9, 0), (6, 9, 15)], turn_deg=33.0)


@pytest.fixture(scope="module")
def slot():
    """A wall through the whole volume, with a slot that is wide enough for the clearance but not for the corridor."""
    half = CLEARANCE + 0.45
    return space_about([(-1, -20, -1), (1, -half, 24)], [(-1, half, -1), (1, 20, 24)])


@pytest.fixture(scope="module")
def pocket():
    """A dead end between two walls, 14 m deep, open to the west, with a back wall and a roof."""
    half = CLEARANCE + 0.45
    return space_about(
        [(-6, -half - 1, 0), (8, -half, 16)],
        [(-6, half, 0), (8, half + 1, 16)],
        [(8, -half - 1, 0), (9, half + 1, 16)],
        [(-6, -half - 1, 16), (9, half + 1, 17)],
    )


def test_a_viewpoint_may_face_a_wall_at_the_clearance_and_five_centimetres(wall):
    space, _ = wall
    assert space.nearest_m == pytest.approx(CLEARANCE + 0.04)
    at = np.array([[4 - CLEARANCE - more, 0.0, 8.0] for more in (0.05, 0.03, REACH + 0.05)])
    assert space.is_free(at).tolist() == [True, False, True]
    assert space.is_reachable(at).tolist() == [True, False, True]
    assert space.is_wide(at).tolist() == [False, False, True]


def test_the_wide_space_lies_in_the_tight_one(wall):
    space, distance = wall
    assert (space.free_mask | ~space.reachable_mask).all()
    assert (space.reachable_mask | ~space.wide_mask).all()
    assert (space.wide_mask | ~space.open_sky_mask).all()
    tight = np.argwhere(space.reachable_mask & ~space.wide_mask)
    assert len(tight) > 1000
    cells = tight[np.random.default_rng(0).choice(len(tight), 800)]
    room = distance.distance(space.centre_of(cells)) - CLEARANCE
    assert room.min() >= space.pitch_m / 2
    assert room.max() < space.pitch_m / 2 + REACH + 0.05


def test_to_a_tight_viewpoint_the_path_comes_from_the_open(wall):
    space, distance = wall
    goal = np.array([4 - CLEARANCE - 0.05, 3.0, 9.0])
    path = find_path(space, np.array([-10.0, -8.0, 12.0]), goal)
    line = along(path)
    room = distance.distance(line) - CLEARANCE
    assert room.min() >= 0.02
    away = np.linalg.norm(line - goal, axis=1)
    assert (room >= np.clip(away - SPOT_RADIUS_M, 0.0, REACH)).all()
    assert path_length(path) <= 1.02 * np.linalg.norm(path[0] - goal)
    flown(space, distance, path)


def test_between_far_viewpoints_at_a_wall_the_path_keeps_off_it(wall):
    space, distance = wall
    a, b = np.array([[4 - CLEARANCE - 0.05, y, 9.0] for y in (-6.0, 6.0)])
    path = find_path(space, a, b)
    line = along(path)
    # a little less than the spots' reach: the ways out of the tight space lean towards each other
    middle = np.abs(line[:, 1]) < 6.0 - SPOT_RADIUS_M - REACH - 0.1
    assert (distance.distance(line[middle]) >= CLEARANCE + REACH).all()
    assert path_length(path) < 13.0


def test_between_near_viewpoints_at_a_wall_the_path_is_straight(wall):
    space, distance = wall
    a, b = np.array([[4 - CLEARANCE - 0.05, y, 9.0] for y in (-1.0, 1.0)])
    path = find_path(space, a, b)
    assert path.tolist() == [a.tolist(), b.tolist()]
    leg, timed = flown(space, distance, path)
    assert len(leg.boxes_m) == 1
    # boxes are narrow towards the wall only
    np.testing.assert_allclose(leg.boxes_m[0, 0], [a[0] - 0.5, -1.5, 8.5], atol=0.02)
    np.testing.assert_allclose(leg.boxes_m[0, 1, 1:], [1.5, 9.5], atol=0.02)
    assert 0 < leg.boxes_m[0, 1, 0] - a[0] <= 0.05
    assert timed.durations_s.sum() == pytest.approx(math.sqrt(7.5132 * 2.0 / 2.5), rel=2e-3)


def test_a_narrow_passage_is_taken_where_there_is_no_other(slot):
    space, distance = slot
    start, goal = np.array([-10.0, 3.0, 10.0]), np.array([10.0, -2.0, 8.0])
    assert space.is_reachable([goal])[0]
    assert not space.wide_mask[tuple(space.cell_of(goal)[0])]
    path = find_path(space, start, goal)
    line = along(path)
    assert distance.distance(line).min() >= CLEARANCE + 0.02
    # as wide as anywhere else when it is out of the slot
    outside = np.abs(line[:, 0]) > 1 + REACH + SPOT_RADIUS_M + 1.0
    assert (distance.distance(line[outside]) >= CLEARANCE + REACH).all()
    assert path_length(path) < 1.1 * np.linalg.norm(goal - start)
    _, timed = flown(space, distance, path)
    assert timed.durations_s.sum() < 2 * (path_length(path) / 5.0 + 2.0)


def test_a_passage_that_is_narrower_than_the_clearance_is_closed():
    half = CLEARANCE - 0.05
    space, _ = space_about([(-1, -20, -1), (1, -half, 24)], [(-1, half, -1), (1, 20, 24)])
    assert not space.is_reachable([[10.0, 0.0, 8.0]])[0]
    assert space.is_free([[10.0, 0.0, 8.0]])[0]


def test_two_viewpoints_in_one_pocket_are_joined_inside_it(pocket):
    space, distance = pocket
    a, b = np.array([[5.5, 0.35, 9.0], [5.0, -0.35, 5.0]])
    assert not space.is_wide(np.stack([a, b])).any()
    path = find_path(space, a, b)
    assert path_length(path) <= 1.05 * np.linalg.norm(b - a)
    flown(space, distance, path)


def test_a_pocket_is_entered_from_outside(pocket):
    space, distance = pocket
    path = find_path(space, np.array([-14.0, 4.0, 9.0]), np.array([6.0, 0.3, 6.0]))
    assert distance.distance(along(path)).min() >= CLEARANCE + 0.02
    _, timed = flown(space, distance, path)
    assert timed.durations_s.sum() < 2 * (path_length(path) / 5.0 + 2.0)


def test_beside_a_slanted_wall_everything_is_flown(slanted_wall):
    space, distance = slanted_wall
    turned = Rotation.from_euler("z", 33.0, degrees=True)
    rng = np.random.default_rng(3)
    local = np.column_stack(
        [4 - CLEARANCE - rng.uniform(0.045, 0.2, 40), rng.uniform(-8, 8, 40), rng.uniform(2, 13, 40)]
    )
    places = turned.apply(local)
    assert space.is_reachable(places).all()
    near = places[:20] + turned.apply(np.column_stack([np.zeros(20), rng.uniform(-1.2, 1.2, (20, 2))]))
    near = np.where(space.is_reachable(near)[:, None], near, places[20:])
    for a, b in [*zip(places[:10], places[10:20], strict=True), *zip(places[:20], near, strict=True)]:
        path = find_path(space, a, b)
        leg, timed = flown(space, distance, path)
        assert timed.durations_s.sum() < 2 * (path_length(path) / 5.0 + math.sqrt(path_length(path)) + 0.5)
        assert len(leg.boxes_m) < 60


def test_about_spots_only_the_clearance_is_asked(wall):
    space, distance = wall
    rng = np.random.default_rng(4)
    spots = np.array([[4 - CLEARANCE - 0.05, 0.0, 8.0], [4 - CLEARANCE - 0.1, 5.0, 9.0]])
    model = space.model_about(spots)
    a = rng.uniform((0.5, -3, 6), (2.4, 7, 11), (3000, 3))
    b = a + rng.normal(0, 0.7, a.shape)
    free = space.segments_free(a, b, model=model)
    wide = space.segments_free(a, b, model=space.wide_model)
    tight = space.segments_free(a, b)
    assert (free | ~wide).all()
    assert (tight | ~free).all()
    assert (free & ~wide).sum() > 100
    assert (tight & ~free).sum() > 100
    for p, q in zip(a[free], b[free], strict=True):
        line = along([p, q], 0.05)
        away = np.linalg.norm(line[:, None] - spots, axis=2).min(axis=1)
        kept = CLEARANCE + np.clip(away - model.spot_radius, 0.0, REACH)
        assert (distance.distance(line) >= kept - 1e-9).all()


def test_a_stop_has_the_box_that_is_clear_about_it(wall):
    space, _ = wall
    at = np.array([4 - CLEARANCE - 0.05, 0.0, 8.0])
    box = stop_box(at, HALF_WIDTH, space)
    assert space.box_free(*box)
    np.testing.assert_allclose(box[0], at - HALF_WIDTH)
    assert box[1, 0] <= 4 - CLEARANCE
    np.testing.assert_allclose(stop_box(np.array([0.0, 0, 8]), HALF_WIDTH, space), [[-0.5, -0.5, 7.5], [0.5, 0.5, 8.5]])
