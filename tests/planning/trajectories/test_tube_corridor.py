"""Tubes and polytopes where the space is tight: sampled points of the sets against the exact distance to the scene."""

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from gcs.core.progress import SilentProgress
from gcs.core.structure import Structure
from gcs.planning.numerics.qp_solver import default_solvers
from gcs.planning.scene.distance_field import build_distance_field
from gcs.planning.scene.free_space import FreeSpace
from gcs.planning.scene.point_distance import SceneDistance
from gcs.planning.trajectories.convex_set import outside_m
from gcs.planning.trajectories.deviation import PolylineDistance
from gcs.planning.trajectories.safe_corridor import build_corridor, corridor_reach
from gcs.planning.trajectories.time_allocation import FlightLimits, time_legs

CLEARANCE, HALF_WIDTH = 1.6, 0.5
REACH = corridor_reach(HALF_WIDTH)
LIMITS = FlightLimits(5.0, 2.5, None)
ALONG_THE_WALL = np.array([[-6.0, -4, 6], [0.0, -4, 6], [2.2, 0, 7], [2.2, 5, 8], [-3, 6.4, 8]])
"""Its third and fourth corner are 0.2 m further from the face at x = 4 than the clearance."""


@pytest.fixture(scope="module")
def scene():
    """A wall whose face is at x = 4, and a slanting post that leans over the open side."""
    wall = trimesh.creation.box(bounds=np.array([[4.0, -15, 0], [6, 15, 15]]))
    post = trimesh.creation.box((0.4, 0.4, 14))
    post.apply_transform(
        np.block(
            [
                [Rotation.from_euler("x", 35, degrees=True).as_matrix(), np.array([[0.5], [8.6], [8]])],
                [np.zeros((1, 3)), 1.0],
            ]
        )
    )
    mesh = trimesh.util.concatenate([wall, post])
    structure = Structure(np.array(mesh.vertices), np.array(mesh.faces, np.int64))
    field = build_distance_field(structure, np.array([-12.0, -17, -1]), np.array([12.0, 17, 22]), 0.25)
    space = FreeSpace(field, CLEARANCE, 0.0, np.array([-10.3, -14.8, 0.0]), reach_m=REACH, climb_clearance_m=0.8)
    return space, SceneDistance(structure, 0.0)


def inside(box, planes, count=3000):
    points = np.random.default_rng(0).uniform(*box, (count, 3))
    return points[(points @ planes[:, :3].T <= planes[:, 3]).all(axis=1)]


@pytest.mark.parametrize("kind", ["tubes", "polytopes"])
def test_no_point_of_a_set_is_too_near_to_the_scene_or_too_far_from_the_leg(scene, kind):
    space, distance = scene
    assert space.segments_free(ALONG_THE_WALL[:-1], ALONG_THE_WALL[1:]).all()
    leg = build_corridor(ALONG_THE_WALL, HALF_WIDTH, 2.5, space=space, kind=kind)
    path = PolylineDistance(ALONG_THE_WALL)
    for box, planes in zip(leg.boxes_m, leg.planes, strict=True):
        points = inside(box, planes)
        assert len(points) > 100
        assert distance.distance(points).min() >= CLEARANCE
        assert path.distance(points).max() <= REACH + 1e-9
    assert leg.joint_room_m.min() > 1e-3
    (timed,) = time_legs([leg], LIMITS, default_solvers(), SilentProgress())
    assert outside_m(timed.control, leg.planes) == 0.0
    powers = np.linspace(0, 1, 40)
    bernstein = np.array([[_bernstein(k, u) for k in range(8)] for u in powers])
    assert distance.distance((bernstein @ timed.control).reshape(-1, 3)).min() >= CLEARANCE


def _bernstein(k, u):
    from math import comb

    return comb(7, k) * u**k * (1 - u) ** (7 - k)


def test_beside_a_wall_a_polytope_keeps_the_width_that_a_tube_gives_up(scene):
    space, _ = scene
    tubes, polytopes = (
        build_corridor(ALONG_THE_WALL[2:4], HALF_WIDTH, 2.5, space=space, kind=kind) for kind in ("tubes", "polytopes")
    )
    thin = min(np.ptp(inside(b, p)[:, 0]) for b, p in zip(tubes.boxes_m, tubes.planes, strict=True))
    wide = min(np.ptp(inside(b, p)[:, 0]) for b, p in zip(polytopes.boxes_m, polytopes.planes, strict=True))
    assert thin < 0.35
    assert wide > 0.6


def test_a_tube_grows_again_where_there_is_room(scene):
    space, _ = scene
    leg = build_corridor(np.array([[2.3, 0.0, 7], [-7.7, 0, 7]]), HALF_WIDTH, 10.0, space=space, kind="tubes")
    widths = np.ptp(leg.boxes_m[:, :, 1], axis=1)
    assert len(widths) > 2
    assert widths[0] < 0.3
    assert widths[-1] == pytest.approx(2 * HALF_WIDTH)
    np.testing.assert_allclose(leg.joints_m[[0, -1]], [[2.3, 0.0, 7], [-7.7, 0, 7]], atol=1e-12)


@pytest.mark.parametrize("kind", ["tubes", "polytopes"])
def test_columns_over_home_are_slim_boxes(kind):
    leg = np.array([[3.0, 4, 0], [3, 4, 6], [10, 4, 9]])
    corridor = build_corridor(leg, HALF_WIDTH, column_at_start=True, kind=kind)
    np.testing.assert_allclose(corridor.boxes_m[0], [[2.9, 3.9, 0.0], [3.1, 4.1, 6.5]])
    assert outside_m(np.full((1, 8, 3), [3.0, 4.0, -1e-3]), corridor.planes[:1]) == pytest.approx(1e-3)
