"""Polytopes about segments among triangles, cables and fences: sampled points against brute-force distances."""

import numpy as np
import pytest
from scipy.optimize import minimize

from gcs.core.structure import Structure
from gcs.core.structure_source import Cable
from gcs.planning.scene.distance_field import build_distance_field
from gcs.planning.scene.fence import FenceVolume, room_in_fence
from gcs.planning.scene.free_space import FreeSpace
from gcs.planning.scene.nearest_points import nearest_of_segment_and_triangle, nearest_of_segments, nearest_of_triangle
from gcs.planning.scene.point_distance import SceneDistance
from gcs.planning.trajectories.leg_tube import tube_reach, tubes

CLEARANCE, REACH = 0.8, 1.5
LOW, HIGH = np.array([-10.0, -10, -2]), np.array([10.0, 10, 15])
FAR_HOME = np.array([-9.0, -9, 0])


def space_among(triangles, cables=(), fence=None):
    structure = Structure(np.concatenate(triangles), np.arange(3 * len(triangles)).reshape(-1, 3), tuple(cables))
    field = build_distance_field(structure, LOW, HIGH, 0.5)
    return FreeSpace(field, CLEARANCE, 0.0, FAR_HOME, fence), SceneDistance(structure, 0.0)


def cut(space, a, b):
    """The planes that cut the tube about a segment free, and the points of it that are left of some thousands."""
    planes, boxes = tubes(np.stack([a, b]), np.array([REACH / tube_reach(b - a)]))
    found = space.cut_free(a, b, planes[0], REACH)
    points = np.random.default_rng(0).uniform(*boxes[0], (6000, 3))
    if found is None:
        return None, points[:0]
    np.testing.assert_array_equal(found[: len(planes[0])], planes[0])
    return found[len(planes[0]) :], points[(points @ found[:, :3].T <= found[:, 3]).all(axis=1)]


@pytest.mark.parametrize("seed", range(6))
def test_no_point_of_a_polytope_is_nearer_than_the_clearance(seed):
    rng = np.random.default_rng(seed)
    a, b = np.array([-1.0, 0, 6]), np.array([1.0, 0, 6]) + rng.normal(size=3) * [0.5, 1, 0.5]
    triangles = []
    while len(triangles) < 12:
        triangle = rng.uniform(-4, 4, 3) + [0, 0, 6] + rng.uniform(-1, 1, (3, 3)) * rng.choice([0.2, 3.0])
        if all(_distance(point, triangle) > CLEARANCE + 0.1 for point in np.linspace(a, b, 30)):
            triangles.append(triangle)
    cable = Cable(from_m=(-3, 1.6, 5), to_m=(3, 1.9, 7), radius_m=0.05)
    space, distance = space_among(triangles, [cable])
    planes, inside = cut(space, a, b)
    assert len(planes) > 0
    assert len(inside) > 200
    assert distance.distance(inside).min() >= CLEARANCE
    # It is not smaller than what is free all around the segment.
    room = space.least_room_m(a, b)
    around = (np.array([a, b, (a + b) / 2])[:, None] + room * _units(rng, 200)).reshape(-1, 3)
    assert (around @ planes[:, :3].T <= planes[:, 3] + 1e-9).all()


def _distance(point, triangle):
    nearest = np.empty(3)
    nearest_of_triangle(point, *triangle, nearest)
    return np.linalg.norm(point - nearest)


def _units(rng, count):
    ways = rng.normal(size=(count, 3))
    return ways / np.linalg.norm(ways, axis=1)[:, None]


def test_a_wall_beside_a_segment_cuts_one_plane_at_the_clearance():
    wall = np.array([[3.0, -8, 0], [3, 8, 0], [3, 0, 11]])
    space, _ = space_among([wall])
    a, b = np.array([1.5, -1, 4]), np.array([1.5, 1, 5])
    planes, inside = cut(space, a, b)
    np.testing.assert_allclose(planes, [[1, 0, 0, 3 - CLEARANCE]], atol=1e-9)
    assert inside[:, 0].max() == pytest.approx(3 - CLEARANCE, abs=0.05)


def test_what_is_out_of_reach_cuts_nothing_and_the_ground_is_kept():
    space, distance = space_among([np.array([[9.0, 9, 9], [9, 8, 9], [9, 9, 8]])])
    high, _ = cut(space, np.array([0.0, 0, 6]), np.array([2.0, 0, 6]))
    assert len(high) == 0
    low, inside = cut(space, np.array([0.0, 0, 1]), np.array([2.0, 0, 1]))
    np.testing.assert_allclose(low, [[0, 0, -1, -CLEARANCE]])
    assert distance.distance(inside).min() >= CLEARANCE


def test_a_segment_too_near_to_something_or_through_it_has_no_polytope():
    wall = np.array([[3.0, -8, 0], [3, 8, 0], [3, 0, 11]])
    space, _ = space_among([wall])
    assert cut(space, np.array([2.3, -1, 4]), np.array([2.3, 1, 5]))[0] is None
    assert cut(space, np.array([1.0, 0, 4]), np.array([5.0, 0, 4]))[0] is None
    assert cut(space, np.array([0.0, 0, 0.5]), np.array([1.0, 0, 3]))[0] is None


def test_a_fence_is_kept_from_inside_and_from_outside():
    square = np.array([[-9.5, -9.5], [2, -9.5], [2, 9], [-9.5, 9]])
    excluded = np.array([[-3.0, 1], [-1, 1], [-1, 3], [-3, 3]])
    fence = FenceVolume(np.concatenate([square, excluded]), np.array([0, 4, 8]), 1, 8.0, 0.3)
    space, _ = space_among([np.array([[9.0, 9, 9], [9, 8, 9], [9, 9, 8]])], fence=fence)
    for a, b in (([1.2, -2, 6.9], [1.3, 2, 7.2]), ([-4.0, 0.2, 5], [0, 0.1, 6]), ([0, 0.5, 6], [0.5, 3, 6])):
        planes, inside = cut(space, np.array(a), np.array(b))
        assert len(planes) > 0
        assert len(inside) > 200
        assert room_in_fence(inside, fence).min() >= -1e-9
    assert cut(space, np.array([1.0, 0, 5]), np.array([3.0, 0, 5]))[0] is None


@pytest.mark.parametrize("seed", range(12))
def test_nearest_points_are_those_of_a_general_minimiser(seed):
    rng = np.random.default_rng(seed)
    a, b, c, d = rng.normal(size=(4, 3)) * 2
    if seed % 4 == 0:
        d = c + 0.7 * (b - a)
    triangle, p, q = rng.normal(size=(3, 3)) * 2 + rng.normal(size=3) * 3, np.empty(3), np.empty(3)
    square = nearest_of_segments(a, b, c, d, p, q)
    assert square == pytest.approx(((p - q) ** 2).sum())
    found = minimize(
        lambda s: ((a + s[0] * (b - a) - c - s[1] * (d - c)) ** 2).sum(), [0.4, 0.6], bounds=[(0, 1)] * 2, tol=1e-14
    )
    assert square == pytest.approx(found.fun, abs=1e-6)
    square = nearest_of_segment_and_triangle(a, b, triangle, p, q)
    u, v = triangle[1] - triangle[0], triangle[2] - triangle[0]
    found = minimize(
        lambda s: ((a + s[0] * (b - a) - triangle[0] - s[1] * (u + s[2] * (v - u))) ** 2).sum(),
        [0.5, 0.5, 0.5],
        bounds=[(0, 1)] * 3,
        tol=1e-14,
    )
    if found.fun > 1e-6:  # the segment does not cross the triangle
        assert square <= found.fun + 1e-6
        assert square == pytest.approx(((p - q) ** 2).sum())
        shares = np.linalg.lstsq(np.column_stack([u, v]), q - triangle[0], rcond=None)[0]
        assert min(*shares, 1 - shares.sum()) >= -1e-9
