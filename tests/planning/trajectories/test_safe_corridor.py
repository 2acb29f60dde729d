"""Corridor boxes against sampled points of the boxes and brute-force distances."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs.core.errors import InputError
from gcs.planning.trajectories.box_corridor import COLUMN_HALF_WIDTH_M
from gcs.planning.trajectories.deviation import PolylineDistance
from gcs.planning.trajectories.safe_corridor import build_corridor, corridor_reach

COORDINATE = st.one_of(st.floats(-30, 30), st.floats(-0.2, 0.2)).map(lambda x: round(x, 2))


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(COORDINATE, COORDINATE, COORDINATE), min_size=2, max_size=5, unique=True), st.floats(0.2, 2))
def test_no_corner_of_any_box_is_further_from_the_leg_than_the_reach(points, half_width):
    leg = np.array(points)
    corridor = build_corridor(leg, half_width)
    corners = np.array(
        [[box[s[k], k] for k in range(3)] for box in corridor.boxes_m for s in itertools.product((0, 1), repeat=3)]
    )
    assert PolylineDistance(leg).distance(corners).max() <= corridor_reach(half_width) + 1e-6


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(COORDINATE, COORDINATE, COORDINATE), min_size=2, max_size=5, unique=True))
def test_joints_lie_on_the_leg_and_well_inside_both_boxes(points):
    leg = np.array(points)
    corridor = build_corridor(leg, 0.5, 2.5)
    np.testing.assert_array_equal(corridor.joints_m[[0, -1]], leg[[0, -1]])
    assert PolylineDistance(leg).distance(corridor.joints_m).max() <= 0.1 + 1e-9
    assert corridor.lengths_m.max() <= 2.5 + 1e-9
    whole = np.linalg.norm(np.diff(leg, axis=0), axis=1)
    assert whole.min() < 0.1 or corridor.lengths_m.sum() == pytest.approx(whole.sum())
    for joints in (corridor.joints_m[:-1], corridor.joints_m[1:]):
        room = np.minimum(joints - corridor.boxes_m[:, 0], corridor.boxes_m[:, 1] - joints)
        assert room.min() >= 0.5 * 0.5


def test_a_straight_along_an_axis_keeps_the_whole_half_width_in_one_box():
    corridor = build_corridor(np.array([[0.0, 0, 5], [12.0, 0, 5]]), 0.5)
    np.testing.assert_allclose(corridor.boxes_m, [[[-0.5, -0.5, 4.5], [12.5, 0.5, 5.5]]])


def test_the_column_over_home_is_slim_and_never_under_the_ground():
    leg = np.array([[3.0, 4, 0], [3, 4, 6], [10, 4, 9]])
    corridor = build_corridor(leg, 0.5, column_at_start=True)
    np.testing.assert_allclose(corridor.boxes_m[0], [[2.9, 3.9, 0.0], [3.1, 4.1, 6.5]])
    back = build_corridor(leg[::-1], 0.5, column_at_end=True)
    np.testing.assert_allclose(back.boxes_m[-1], corridor.boxes_m[0])
    np.testing.assert_allclose(corridor.boxes_m[1, 0, 2], 6 - (3.0 - corridor.boxes_m[1, 0, 0]), atol=1e-6)
    assert corridor.boxes_m[1, 0, 0] < 3.0 - 2 * COLUMN_HALF_WIDTH_M


def test_a_slanted_first_straight_is_no_column():
    corridor = build_corridor(np.array([[0.0, 0, 0], [0.5, 0, 6]]), 0.5, column_at_start=True)
    assert corridor.boxes_m[0, 0, 2] < 0


def test_corners_close_together_become_one_and_the_boxes_still_reach_no_further():
    leg = np.array([[0.0, 0, 0], [7, 0, 0.2], [7, 1e-4, 0.2], [7.05, 0.04, 0.2], [7, 6, 4], [7, 6.05, 4.01]])
    corridor = build_corridor(leg, 0.5, 2.5)
    assert corridor.lengths_m.min() > 0.1
    np.testing.assert_array_equal(corridor.joints_m[[0, -1]], leg[[0, -1]])
    corners = np.array(
        [[box[s[k], k] for k in range(3)] for box in corridor.boxes_m for s in itertools.product((0, 1), repeat=3)]
    )
    assert PolylineDistance(leg).distance(corners).max() <= corridor_reach(0.5) + 1e-6


def test_the_top_of_a_column_is_never_merged_away():
    leg = np.array([[9.0, 9, 9], [0.03, 0.04, 6.02], [0, 0, 6], [0, 0, 0]])
    corridor = build_corridor(leg, 0.5, column_at_end=True)
    assert (np.abs(corridor.joints_m - [0, 0, 6]).max(axis=1) < 1e-12).any()
    np.testing.assert_allclose(corridor.boxes_m[-1, 1, :2], 0.1)


def test_repeated_points_are_passed_over_and_a_leg_without_length_refused():
    twice = build_corridor(np.array([[0.0, 0, 0], [0, 0, 0], [1, 0, 0]]), 0.5)
    assert len(twice.boxes_m) == 1
    with pytest.raises(InputError, match="two different points"):
        build_corridor(np.zeros((3, 3)), 0.5)


@pytest.mark.parametrize(
    ("leg", "half_width", "longest", "message"),
    [
        (np.zeros((1, 3)), 0.5, 2.0, "two or more points"),
        (np.zeros((4, 2)), 0.5, 2.0, "two or more points"),
        (np.array([[0, 0, 0], [1, np.nan, 0], [2, 0, 0]]), 0.5, 2.0, "point 1 of the leg is not a finite"),
        (np.array([[0.0, 0, 0], [2, 0, 0]]), 0.0, 2.0, "half-width must be positive"),
        (np.array([[0.0, 0, 0], [2, 0, 0]]), np.nan, 2.0, "half-width must be positive"),
        (np.array([[0.0, 0, 0], [2, 0, 0]]), 0.5, 0.0, "longest sub-leg must be positive"),
    ],
)
def test_legs_and_widths_that_cannot_be_used_are_refused(leg, half_width, longest, message):
    with pytest.raises(InputError, match=message):
        build_corridor(leg, half_width, longest)
