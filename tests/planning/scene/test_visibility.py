"""Lines of sight against brute force over all triangles, and past cables against closed forms."""

import numpy as np
import pytest

from gcs.core.structure import Structure
from gcs.core.structure_source import Cable
from gcs.planning.scene.visibility import SightLines


def loose(triangles, cables=()):
    return Structure(triangles.reshape(-1, 3), np.arange(3 * len(triangles)).reshape(-1, 3), tuple(cables))


def margins(origin, target, triangles):
    """For a segment against every triangle: how far inside (positive) or outside the crossing lies, or -inf."""
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    d = target - origin
    n = np.cross(b - a, c - a)
    t = np.einsum("ij,ij->i", n, a - origin) / (n @ d)
    p = origin + t[:, None] * d
    inward = [np.einsum("ij,ij->i", np.cross(n, e), p - s) for s, e in ((a, b - a), (b, c - b), (c, a - c))]
    depth = np.min(
        [m / np.linalg.norm(np.cross(n, e), axis=1) for m, e in zip(inward, (b - a, c - b, a - c), strict=True)], axis=0
    )
    return np.minimum(depth, np.minimum(t, 1 - t) * np.linalg.norm(d))


def test_agrees_with_brute_force():
    rng = np.random.default_rng(3)
    triangles = rng.uniform(-40, 40, (60, 1, 3)) + rng.normal(size=(60, 3, 3)) * 8
    origins, targets = rng.uniform(-60, 60, (2, 3000, 3))
    inside = np.array([margins(o, t, triangles).max() for o, t in zip(origins, targets, strict=True)])
    decided = np.abs(inside) > 0.01  # single precision may see it either way at an edge
    clear = SightLines(loose(triangles)).clear(origins, targets)
    assert decided.mean() > 0.99
    assert 0.2 < (inside > 0).mean() < 0.9
    np.testing.assert_array_equal(clear[decided], inside[decided] < 0)


def test_the_last_piece_before_the_target_is_not_looked_at():
    wall = np.array([[[5, -9, -9], [5, 9, -9], [5, 0, 9]]], dtype=float)
    sight = SightLines(loose(wall))
    assert sight.clear([0, 0, 0], [[5.0, 0, 0], [5.01, 0, 0], [4.99, 0, 0]], 0.02).all()
    assert not sight.clear([0, 0, 0], [[5.1, 0, 0]], 0.02).any()


def test_far_from_the_origin_it_is_as_sharp():
    far = np.array([5000.0, -8000, 300])
    wall = np.array([[[5, -9, -9], [5, 9, -9], [5, 0, 9]]], dtype=float) + far
    got = SightLines(loose(wall)).clear(far, far + np.array([[4.998, 0, 0], [5.003, 0, 0]]))
    np.testing.assert_array_equal(got, [True, False])


@pytest.mark.parametrize(("offset", "clear"), [(0.0, False), (0.09, False), (0.12, True), (-0.12, True)])
def test_cables_block_sight_as_thick_as_they_are(offset, clear):
    triangle = np.array([[[0, 90, 0], [1, 90, 0], [0, 90, 1]]], dtype=float)
    cable = Cable(from_m=(10, -20, -20), to_m=(10, 20, 20), radius_m=0.1)
    sight = SightLines(loose(triangle, [cable]))
    across = offset * np.array([0, 1, -1]) / np.sqrt(2)
    assert sight.clear(np.array([0, 0, 0]) + across, [np.array([20, 0, 0]) + across])[0] == clear


def test_sight_ends_where_the_cable_ends():
    triangle = np.array([[[0, 90, 0], [1, 90, 0], [0, 90, 1]]], dtype=float)
    sight = SightLines(loose(triangle, [Cable(from_m=(10, 0, 0), to_m=(10, 0, 5), radius_m=0.1)]))
    np.testing.assert_array_equal(sight.clear([0, 0, 0], [[20, 0, 9.0], [20, 0, 11]]), [False, True])


def plate_with_hole():
    """A plate of 10 m x 10 m in the plane x = 5 with a square hole of 2 m x 2 m in its middle."""
    strips = [((-5, -5), (5, -1)), ((-5, 1), (5, 5)), ((-5, -1), (-1, 1)), ((1, -1), (5, 1))]
    triangles = []
    for (y0, z0), (y1, z1) in strips:
        a, b, c, d = (5, y0, z0), (5, y1, z0), (5, y1, z1), (5, y0, z1)
        triangles += [(a, b, c), (a, c, d)]
    return np.array(triangles, dtype=float)


def test_through_a_hole_as_many_lines_as_it_takes_threads_for():
    rng = np.random.default_rng(5)
    targets = np.column_stack([np.full(100_000, 10.0), rng.uniform(-9, 9, (100_000, 2))])
    crossing = np.abs(targets[:, 1:] / 2).max(axis=1)
    decided = (np.abs(crossing - 1) > 1e-4) & (crossing < 5)
    clear = SightLines(loose(plate_with_hole())).clear([0, 0, 0], targets)
    np.testing.assert_array_equal(clear[decided], crossing[decided] < 1)
    assert 0.03 < clear.mean() < 0.08


def test_no_lines_are_no_trouble():
    assert SightLines(loose(plate_with_hole())).clear(np.zeros((0, 3)), np.zeros((0, 3))).shape == (0,)
