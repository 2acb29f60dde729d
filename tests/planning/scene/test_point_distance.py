"""Exact distances against an oracle: dense brute force, closed forms and trimesh's own closest point."""

import numpy as np
import pytest
import trimesh

from gcs.core.structure import Structure
from gcs.core.structure_source import Cable
from gcs.planning.scene.point_distance import SceneDistance, TriangleDistance


def oracle(points, triangles):
    best = np.full(len(points), np.inf)
    for t in triangles:
        closest = trimesh.triangles.closest_point(np.repeat(t[None], len(points), 0), points)
        np.minimum(best, np.linalg.norm(closest - points, axis=1), out=best)
    return best


def test_agrees_with_brute_force_on_random_triangles():
    rng = np.random.default_rng(1)
    triangles = rng.normal(size=(300, 1, 3)) * 10 + rng.normal(size=(300, 3, 3)) * rng.uniform(0.01, 6, (300, 1, 1))
    points = rng.normal(size=(400, 3)) * 15
    got = TriangleDistance(triangles).distance(points)
    np.testing.assert_allclose(got, oracle(points, triangles), atol=1e-9)


def test_long_slivers_and_points_on_the_surface():
    triangles = np.array(
        [[[0, 0, 0], [100, 0, 0], [50, 1e-6, 0]], [[0, 0, 5], [0, 0, 5 + 1e-9], [0, 40, 5]]], dtype=float
    )
    points = np.array([[50, 3, 4], [-3, 0, 4], [30, 0, 0], [0, 20, 5], [7, 20, 5]], dtype=float)
    np.testing.assert_allclose(
        TriangleDistance(triangles).distance(points),
        [min(5, np.hypot(50, 1)), np.sqrt(10), 0, 0, 7],
        atol=2e-6,
    )


@pytest.mark.parametrize("count", [1, 4, 5, 17])
def test_small_trees(count):
    rng = np.random.default_rng(count)
    triangles = rng.normal(size=(count, 3, 3))
    points = rng.normal(size=(50, 3)) * 3
    np.testing.assert_allclose(TriangleDistance(triangles).distance(points), oracle(points, triangles), atol=1e-12)


def test_identical_centroids_still_build_a_tree():
    triangles = np.repeat(np.eye(3)[None], 40, axis=0)
    assert TriangleDistance(triangles).distance([[0, 0, 0]]) == pytest.approx(1 / np.sqrt(3))


def test_what_is_beyond_the_limit_is_the_limit_and_nearer_is_exact():
    triangles = np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0]]], dtype=float)
    points = np.array([[0, 0, 3.0], [0, 0, 1.5], [0.2, 0.2, 9.0]])
    np.testing.assert_allclose(TriangleDistance(triangles).distance(points, limit=2.0), [2, 1.5, 2])
    np.testing.assert_allclose(TriangleDistance(triangles).distance(points, limit=[5, 1, 8]), [3, 1, 8])


def scene(ground):
    structure = Structure(
        vertices_m=np.array([[0, 0, 10], [4, 0, 10], [0, 4, 10]], dtype=float),
        faces=np.array([[0, 1, 2]]),
        cables=(Cable(from_m=(10, 0, 0), to_m=(10, 0, 20), radius_m=0.5),),
    )
    return SceneDistance(structure, ground)


def test_cables_and_ground_count():
    points = [[1, 1, 12], [8, 0, 10], [10, 0, 24], [10.2, 0, 5], [1, 1, 3]]
    np.testing.assert_allclose(scene(0.0).distance(points), [2, 1.5, 3.5, 0, 3])
    np.testing.assert_allclose(scene(None).distance(points)[-1], 7)


def test_the_ground_can_be_left_out_point_by_point():
    points = [[1, 1, 3], [1, 1, 3], [1, 1, -1]]
    got = scene(0.0).distance(points, ground=np.array([True, False, True]))
    np.testing.assert_allclose(got, [3, 7, -1])
    np.testing.assert_allclose(scene(0.0).distance(points, ground=False), [7, 7, np.sqrt(83) - 0.5])
