import itertools
import math

import numpy as np
import pytest
import trimesh

from gcs.core.errors import InfeasibleError
from gcs.core.structure import Structure
from gcs.planning.paths.path_search import find_path
from gcs.planning.paths.string_pulling import path_length, pull_string
from gcs.planning.scene.distance_field import build_distance_field
from gcs.planning.scene.free_space import FreeSpace

CLEARANCE = 1.5
LOW, HIGH = np.array([-20.0, -20.0, -1.0]), np.array([20.0, 20.0, 40.0])
HOME = np.array([-15.0, -15.0, 0.0])


def space_about(*corners, high=HIGH):
    mesh = trimesh.util.concatenate([trimesh.creation.box(bounds=np.array(c, dtype=float)) for c in corners])
    structure = Structure(np.array(mesh.vertices, float), np.array(mesh.faces, np.int64))
    return FreeSpace(build_distance_field(structure, LOW, high, 0.5), CLEARANCE, 0.0, HOME)


@pytest.fixture(scope="module")
def tower():
    return space_about([(-3, -5, 0), (3, 5, 35)])


@pytest.fixture(scope="module")
def roof():
    """A table: open on all sides, with a roof that can be flown over and under."""
    return space_about([(-10, -10, 14), (10, 10, 15)], [(-0.5, -0.5, 0), (0.5, 0.5, 14)])


def check(space, path, start, goal):
    assert path[0].tolist() == list(start)
    assert path[-1].tolist() == list(goal)
    assert space.segments_free(path[:-1], path[1:]).all()
    assert space.segments_free(path[1:], path[:-1]).all()


def test_a_clear_line_is_the_path(tower):
    path = find_path(tower, (-15.0, 0.0, 10.0), (-15.0, 15.0, 30.0))
    assert path.tolist() == [[-15, 0, 10], [-15, 15, 30]]


@pytest.mark.parametrize("shift", [0.0, 0.13, 0.37])
def test_round_a_tower_it_is_close_to_the_closed_form(tower, shift):
    start, goal = np.array([-12.0 - shift, 0.0, 10.0]), np.array([12.0 + shift, 0.0, 10.0])
    path = find_path(tower, start, goal, prefer_open_sky=False)
    check(tower, path, start, goal)
    aside, along = 5.0, 9.0 + shift
    heading = math.atan2(aside, along) + math.asin(CLEARANCE / math.hypot(aside, along))
    shortest = 2 * (math.sqrt(aside**2 + along**2 - CLEARANCE**2) + CLEARANCE * heading + 3.0)
    assert shortest <= path_length(path) <= 1.01 * shortest
    assert len(path) <= 7


@pytest.mark.parametrize("rise", [0.0, 4.0, 9.0])
@pytest.mark.parametrize("turn", [0.0, 0.4, 0.9])
def test_round_a_turned_tower_and_up_it_is_close_to_the_closed_form(rise, turn):
    tower = trimesh.creation.box(extents=(6.0, 10.0, 60.0))
    tower.apply_transform(trimesh.transformations.rotation_matrix(turn, (0, 0, 1)))
    structure = Structure(np.array(tower.vertices, float), np.array(tower.faces, np.int64))
    low, high = np.array([-20.0, -20.0, -32.0]), np.array([20.0, 20.0, 32.0])
    space = FreeSpace(build_distance_field(structure, low, high, 0.5), CLEARANCE, None, (-15.0, -15.0, 0.0))
    along = np.array([12.0 * math.cos(turn), 12.0 * math.sin(turn), rise / 2])
    path = find_path(space, -along, along, prefer_open_sky=False)
    check(space, path, -along, along)
    heading = math.atan2(5.0, 9.0) + math.asin(CLEARANCE / math.hypot(5.0, 9.0))
    level = 2 * (math.sqrt(5.0**2 + 9.0**2 - CLEARANCE**2) + CLEARANCE * heading + 3.0)
    shortest = math.hypot(level, rise)  # the way round an upright body unrolls into a plane
    assert shortest <= path_length(path) <= 1.01 * shortest


def test_ends_need_not_be_centres(tower):
    rng = np.random.default_rng(0)
    points = rng.uniform(LOW, HIGH, (400, 3))
    points = points[tower.is_reachable(points)][:60]
    for start, goal in zip(points[::2], points[1::2], strict=True):
        path = find_path(tower, start, goal)
        check(tower, path, start, goal)
        assert path_length(path) >= np.linalg.norm(goal - start) - 1e-9


def test_a_path_between_open_places_stays_under_the_open_sky(roof):
    start, goal = np.array([-15.0, 5.0, 8.0]), np.array([15.0, 6.0, 8.0])
    under = find_path(roof, start, goal, prefer_open_sky=False)
    assert under.shape == (2, 3)
    assert roof.covered_length(under) > 15
    around = find_path(roof, start, goal)
    check(roof, around, start, goal)
    assert roof.covered_length(around) == 0.0
    inner = np.concatenate([a + np.linspace(0, 1, 200)[:, None] * (b - a) for a, b in itertools.pairwise(around)])
    assert roof.is_open_sky(inner).all()


def test_from_under_a_roof_the_way_out_is_short(roof):
    start, goal = np.array([-8.0, 0.0, 8.0]), np.array([15.0, 0.0, 8.0])
    path = find_path(roof, start, goal)
    check(roof, path, start, goal)
    edge = 10 + CLEARANCE + 0.5
    assert roof.covered_length(path) <= (edge - 8.0) + 1.5


def test_between_two_places_under_a_roof_it_stays_there(roof):
    start, goal = np.array([-4.0, -4.0, 8.0]), np.array([-4.0, 4.0, 8.0])
    path = find_path(roof, start, goal)
    check(roof, path, start, goal)
    assert path_length(path) == pytest.approx(8.0, abs=0.1)


def test_home_is_left_and_reached_vertically(tower):
    goal = np.array([10.0, 10.0, 20.0])
    for path in (find_path(tower, HOME, goal), find_path(tower, goal, HOME)[::-1]):
        check(tower, path, HOME, goal)
        assert path[1].tolist() == tower.take_off_m.tolist()
        assert path[1][:2].tolist() == HOME[:2].tolist()


@pytest.mark.parametrize("goal", [(0.0, 0.0, 10.0), (-4.0, 0.0, 10.0), (50.0, 0.0, 10.0), (-10.0, -10.0, 0.5)])
def test_what_cannot_be_reached_is_said(tower, goal):
    with pytest.raises(InfeasibleError, match="no way leads from home"):
        find_path(tower, HOME, goal)


def test_pulling_never_lengthens_and_keeps_the_ends(tower):
    raw = np.array([[-12, 0, 10], [-12, 10, 10], [-6, 12, 14], [0, 10, 12], [6, 12, 10], [12, 10, 10], [12, 0, 10.0]])
    assert tower.segments_free(raw[:-1], raw[1:], strict=True).all()
    pulled = pull_string(tower, raw, keep_open_sky=False)
    check(tower, pulled, raw[0], raw[-1])
    assert path_length(pulled) < 0.9 * path_length(raw)


def test_a_path_of_two_points_is_left_alone(tower):
    path = np.array([[-12.0, 0, 10], [-12, 10, 10]])
    assert pull_string(tower, path).tolist() == path.tolist()
