"""Boxes against sampled points of theirs: what is called free is, and what is free by some centimetres is called so."""

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from gcs.core.scenario import Fence, Safety, VehicleSpec
from gcs.core.structure import Structure
from gcs.core.structure_source import Cable
from gcs.planning.scene.distance_field import build_distance_field
from gcs.planning.scene.fence import fence_volume, room_in_fence
from gcs.planning.scene.free_space import FreeSpace
from gcs.planning.scene.point_distance import SceneDistance

CLEARANCE = 1.6
LOW, HIGH = np.array([-20.0, -20.0, -1.0]), np.array([20.0, 20.0, 30.0])
FENCE = Fence(
    include=[[(-19, -19), (19, -19), (19, 19), (-19, 19)]], exclude=[[(8, -12), (14, -10), (9, -7)]], max_height_m=25
)


@pytest.fixture(scope="module")
def scene():
    """Two slanting beams, a plate, a cable, a fence with a hole."""
    beams = [trimesh.creation.box(extents=e) for e in ((12, 0.6, 0.6), (1, 9, 1), (5, 5, 0.1))]
    turned = Rotation.random(3, random_state=5).as_matrix()
    vertices = [
        b.vertices @ r.T + c for b, r, c in zip(beams, turned, [(-6, 5, 9), (5, 6, 14), (0, -8, 8)], strict=True)
    ]
    faces = [np.asarray(b.faces) + 8 * k for k, b in enumerate(beams)]
    cable = Cable(from_m=(-12, -12, 2), to_m=(10, 12, 20), radius_m=0.2)
    structure = Structure(np.concatenate(vertices), np.concatenate(faces).astype(np.int64), (cable,))
    fence = fence_volume(FENCE, VehicleSpec(), Safety())
    space = FreeSpace(build_distance_field(structure, LOW, HIGH, 0.5), CLEARANCE, 0.0, (-16.0, 15.0, 0.0), fence)
    return space, SceneDistance(structure, 0.0), fence


def least_room(scene, low, high, count=12):
    """Least room of a box's lattice of points, faces and corners included."""
    _, distance, fence = scene
    axes = [np.linspace(low[k], high[k], count) for k in range(3)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    return min(distance.distance(points).min() - CLEARANCE, room_in_fence(points, fence).min())


def random_boxes(count, seed):
    rng = np.random.default_rng(seed)
    low = rng.uniform((-19, -19, 1), (18, 18, 24), (count, 3))
    return low, low + rng.uniform(0.02, 2.0, (count, 3))


def test_free_boxes_keep_the_clearance_everywhere(scene):
    space = scene[0]
    free = 0
    for low, high in zip(*random_boxes(800, 0), strict=True):
        room = least_room(scene, low, high)
        if space.box_free(low, high):
            free += 1
            assert room >= -1e-9
        else:
            # between the lattice's points room may be smaller by their half spacing
            assert room < 0.05 + np.linalg.norm(high - low) / 22
    assert 150 < free < 650


def test_small_boxes_are_judged_like_points(scene):
    space = scene[0]
    points = np.random.default_rng(1).uniform((-19, -19, 1), (19, 19, 25), (3000, 3))
    free = np.array([space.box_free(p - 1e-6, p + 1e-6) for p in points])
    room = np.array([least_room(scene, p, p, 1) for p in points])
    assert (room[free] >= -1e-9).all()
    assert free[room > 1e-4].all()


def test_a_box_grows_as_far_as_it_stays_free(scene):
    space = scene[0]
    rng = np.random.default_rng(2)
    points = rng.uniform((-15, -15, 2), (15, 15, 24), (3000, 3))
    points = points[space.is_free(points)]
    close = points[[least_room(scene, p, p, 1) < 0.4 for p in points]][:120]
    for p in close:
        low, high = space.grown_box(p - 0.003, p + 0.003, p - 0.5, p + 0.5)
        assert space.box_free(low, high)
        assert (low <= p - 0.003 + 1e-12).all()
        assert (high >= p + 0.003 - 1e-12).all()
        assert (low >= p - 0.5 - 1e-12).all()
        assert (high <= p + 0.5 + 1e-12).all()
        for side in range(6):
            wider_low, wider_high = low.copy(), high.copy()
            if side < 3:
                wider_low[side] = max(low[side] - 0.05, p[side] - 0.5)
            else:
                wider_high[side - 3] = min(high[side - 3] + 0.05, p[side - 3] + 0.5)
            at_most = wider_low[side] >= low[side] - 1e-9 if side < 3 else wider_high[side - 3] <= high[side - 3] + 1e-9
            assert at_most or not space.box_free(wider_low, wider_high)


def test_in_the_open_the_whole_box_is_had(scene):
    p = np.array([-14.0, 12.0, 22.0])
    np.testing.assert_allclose(scene[0].grown_box(p, p, p - 0.5, p + 0.5), [p - 0.5, p + 0.5])
