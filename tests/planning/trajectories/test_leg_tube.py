"""Tubes against their definition at sampled points, and against the vertices that another library finds."""

import numpy as np
import pytest
from scipy.spatial import HalfspaceIntersection

from gcs.planning.trajectories.convex_set import box_planes, inner_ball, outside_m, room_m
from gcs.planning.trajectories.leg_tube import tube_reach, tubes

DELTA = 0.3
DIRECTIONS = [
    *np.eye(3),
    -np.eye(3)[2],
    np.array([1.0, 1, 0]),
    np.array([1.0, -1, 1]),
    np.array([1.0, 1, 2]),
    np.array([3.0, 1e-9, 0]),
    *np.random.default_rng(3).normal(size=(8, 3)),
]


def one_tube(direction):
    a = np.array([4.0, -2, 7])
    b = a + 2.5 * direction / np.linalg.norm(direction)
    planes, boxes = tubes(np.stack([a, b]), np.array([DELTA]))
    return a, b, planes[0], boxes[0]


def along_and_aside(points, a, b):
    unit = (b - a) / np.linalg.norm(b - a)
    along = (points - a) @ unit
    return along, points - a - along[:, None] * unit


@pytest.mark.parametrize("direction", DIRECTIONS)
def test_points_are_in_a_tube_if_and_only_if_no_component_of_the_deviation_exceeds_delta(direction):
    a, b, planes, box = one_tube(direction)
    points = np.random.default_rng(0).uniform(box[0] - 0.1, box[1] + 0.1, (4000, 3))
    along, aside = along_and_aside(points, a, b)
    wanted = (np.abs(aside).max(axis=1) <= DELTA) & (along >= -DELTA) & (along <= 2.5 + DELTA)
    inside = (points @ planes[:, :3].T <= planes[:, 3]).all(axis=1)
    assert 0 < wanted.sum() < len(points)
    np.testing.assert_array_equal(inside, wanted)
    np.testing.assert_allclose(np.linalg.norm(planes[:, :3], axis=1), 1.0, atol=1e-12)


@pytest.mark.parametrize("direction", DIRECTIONS)
def test_box_and_reach_are_those_of_the_vertices(direction):
    a, b, planes, box = one_tube(direction)
    vertices = HalfspaceIntersection(np.column_stack([planes[:, :3], -planes[:, 3]]), (a + b) / 2).intersections
    np.testing.assert_allclose([vertices.min(axis=0), vertices.max(axis=0)], box, atol=1e-8)
    along, aside = along_and_aside(vertices, a, b)
    past = along - np.clip(along, 0, 2.5)
    assert np.hypot(past, np.linalg.norm(aside, axis=1)).max() == pytest.approx(DELTA * tube_reach(direction), rel=1e-7)


def test_about_a_straight_along_an_axis_the_tube_is_the_box_grown_by_delta():
    a, b, planes, box = one_tube(np.array([0.0, -1, 0]))
    np.testing.assert_allclose(box, [np.minimum(a, b) - DELTA, np.maximum(a, b) + DELTA], atol=1e-12)
    assert len(planes) == 6
    points = np.random.default_rng(1).uniform(box[0] - 0.2, box[1] + 0.2, (2000, 3))
    faces = box_planes(box)
    np.testing.assert_array_equal(
        (points @ planes[:, :3].T <= planes[:, 3]).all(axis=1), (points @ faces[:, :3].T <= faces[:, 3]).all(axis=1)
    )


def test_parts_of_one_straight_have_tubes_of_their_own_thickness():
    ends = np.array([[0.0, 0, 0], [1, 2, 2], [2, 4, 4]])
    planes, boxes = tubes(ends, np.array([0.1, 0.4]))
    for part, delta in enumerate((0.1, 0.4)):
        alone, box = tubes(ends[part : part + 2], np.array([delta]))
        np.testing.assert_allclose(planes[part], alone[0])
        np.testing.assert_allclose(boxes[part], box[0])


def test_room_and_the_largest_ball_of_a_box():
    faces = box_planes(np.array([[0.0, 0, 0], [4, 2, 6]]))
    assert room_m(faces, np.array([1.0, 1.5, 3])) == pytest.approx(0.5)
    assert room_m(faces, np.array([1.0, 2.5, 3])) == pytest.approx(-0.5)
    centre, radius = inner_ball(faces)
    assert radius == pytest.approx(1.0)
    assert room_m(faces, centre) == pytest.approx(1.0)
    assert inner_ball(np.concatenate([faces, box_planes(np.array([[0.0, 2.25, 0], [4, 4, 6]]))]))[1] < 0


def test_outside_is_the_furthest_control_point_beyond_its_own_pieces_set():
    sets = [box_planes(np.array([[0.0, 0, 0], [1, 1, 1]])), box_planes(np.array([[1.0, 0, 0], [2, 1, 1]]))]
    control = np.full((2, 8, 3), 0.5)
    control[1, :, 0] = 1.5
    assert outside_m(control, sets) == 0.0
    control[1, 3] = [1.2, -0.25, 1.1]
    assert outside_m(control, sets) == pytest.approx(0.25)
