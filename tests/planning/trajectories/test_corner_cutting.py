"""Corners of polylines: one cut, and four equal turns, against the papers' closed forms."""

import math
from itertools import pairwise

import numpy as np
import pytest

from gcs.core.errors import InputError
from gcs.planning.trajectories.corner_cutting import RESOLUTION_M, cut_corners, interior_angle
from gcs.planning.trajectories.geometric_corner import four_turn_corners, four_turns

RIGHT_ANGLE = np.array([[10.0, 0.0, 2.0], [0.0, 0.0, 2.0], [0.0, 10.0, 2.0]])
NONE = np.zeros(3, bool)
TREATMENTS = [cut_corners, four_turn_corners]


def anywhere(a, b):
    return True


def turns(points):
    legs = np.diff(points, axis=0)
    legs /= np.linalg.norm(legs, axis=1)[:, None]
    return np.array([math.pi - interior_angle(-a, b) for a, b in pairwise(legs)])


def corner(angle, legs=(10.0, 10.0), rng=None):
    """A corner with an interior angle, turned at random in space."""
    path = np.array([[legs[0], 0.0, 0.0], [0.0, 0.0, 0.0], [legs[1] * math.cos(angle), legs[1] * math.sin(angle), 0.0]])
    if rng is None:
        return path
    rotation, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return path @ rotation + rng.normal(size=3) * 100


def along(points, spacing=0.005):
    shares = [np.linspace(0, 1, max(2, int(np.linalg.norm(b - a) / spacing)))[:, None] for a, b in pairwise(points)]
    return np.concatenate([a + share * (b - a) for share, (a, b) in zip(shares, pairwise(points), strict=True)])


def distance_to_path(spots, points):
    nearest = np.full(len(spots), np.inf)
    for a, b in pairwise(points):
        share = np.clip((spots - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
        nearest = np.minimum(nearest, np.linalg.norm(spots - a - share[:, None] * (b - a), axis=1))
    return nearest


def apart(one, other):
    """Hausdorff distance of two polylines, sampled."""
    return max(distance_to_path(along(one), other).max(), distance_to_path(along(other), one).max())


def test_a_cut_has_equal_arms_and_its_ends_on_the_legs():
    cut = cut_corners(RIGHT_ANGLE, NONE, math.inf, anywhere)
    assert cut.points_m == pytest.approx(np.array([[10, 0, 2], [5, 0, 2], [0, 5, 2], [0, 10, 2]]))
    assert not cut.must_visit.any()


def test_a_right_angle_with_l_of_5_m_gives_up_2_4_m():
    rounded = four_turn_corners(RIGHT_ANGLE, NONE, math.inf, anywhere).points_m
    assert len(rounded) == 6
    assert np.linalg.norm(rounded[1] - RIGHT_ANGLE[1]) == pytest.approx(5.0)
    s = math.sin(math.pi / 4)
    given_up = float(distance_to_path(RIGHT_ANGLE[1:2], rounded)[0])
    assert given_up == pytest.approx(2.40, abs=0.005)
    assert given_up == pytest.approx((5 - 10 * s / (3 + 2 * s)) * s, abs=1e-12)


@pytest.mark.parametrize("degrees", [2.0, 30.0, 60.0, 90.0, 135.0, 179.0])
def test_four_equal_turns_and_the_papers_lengths(degrees):
    alpha = math.radians(degrees)
    path = corner(alpha, (20.0, 8.0), np.random.default_rng(3))
    rounded = four_turn_corners(path, NONE, math.inf, anywhere).points_m
    assert turns(rounded) == pytest.approx(np.full(4, (math.pi - alpha) / 4), abs=1e-9)
    # Equations 11-13 and the form solved for BC.
    arm, s = 4.0, math.sin(alpha / 2)
    bc = 2 * arm * s / (3 + 2 * s)
    assert bc == pytest.approx(2 * (arm - bc) * s / 3)
    d, (b, h, i, f) = path[1], rounded[1:5]
    c, e = b + bc * (d - b) / arm, f + bc * (d - f) / arm
    for start, end in ((b, c), (c, h), (h, i), (i, e), (e, f)):
        assert np.linalg.norm(end - start) == pytest.approx(bc, rel=1e-9)


@pytest.mark.parametrize("degrees", [20.0, 90.0, 150.0])
@pytest.mark.parametrize("treat", TREATMENTS)
def test_the_deviation_is_used_up_and_kept(treat, degrees):
    path = corner(math.radians(degrees), (12.0, 9.0), np.random.default_rng(5))
    free = treat(path, NONE, math.inf, anywhere).points_m
    limit = 0.4 * apart(path, free)
    capped = treat(path, NONE, limit, anywhere).points_m
    assert apart(path, capped) == pytest.approx(limit, rel=1e-3)
    assert float(distance_to_path(path[1:2], capped)[0]) == pytest.approx(limit, rel=1e-12)


@pytest.mark.parametrize("treat", TREATMENTS)
def test_must_visit_points_and_ends_stay(treat):
    rng = np.random.default_rng(0)
    path = np.cumsum(rng.normal(size=(30, 3)) * 10, axis=0)
    must = rng.random(30) < 0.4
    treated = treat(path, must, 2.0, anywhere)
    assert treated.points_m[treated.must_visit] == pytest.approx(path[must], abs=0)
    assert (treated.points_m[[0, -1]] == path[[0, -1]]).all()
    assert turns(treated.points_m)[~treated.must_visit[1:-1]].max() < turns(path)[~must[1:-1]].max()
    assert apart(path, treated.points_m) <= 2.0 + 1e-9
    everything = treat(path, np.ones(30, bool), 2.0, anywhere)
    assert (everything.points_m == path).all()
    assert everything.must_visit.all()


def disc(centre, radius):
    def free(a, b):
        return distance_to_path(np.array([centre]), np.array([a, b]))[0] > radius

    return free


@pytest.mark.parametrize("treat", TREATMENTS)
def test_the_largest_cut_that_keeps_clear_of_an_obstacle_inside_the_corner(treat):
    path = corner(math.pi / 2)
    free = disc(np.array([4.0, 4.0, 0.0]), 3.5)
    points = treat(path, NONE, math.inf, free).points_m
    assert all(free(a, b) for a, b in pairwise(points))
    cut = 10 - np.linalg.norm(points[1] - path[0])
    # The closed form: the middle straight runs at 45 degrees and touches the disc.
    s = math.sin(math.pi / 4)
    nearest = 4 * math.sqrt(2) - 3.5
    largest = nearest / s if treat is cut_corners else nearest * (3 + 2 * s) / (3 * s)
    assert 0 <= largest - cut <= RESOLUTION_M


def test_the_four_turn_path_itself_keeps_the_clearance():
    """A pole between BF and B-H-I-F: the chord is clear, the path is not."""
    path = corner(math.pi / 2)
    b, h, _, f = 5 * four_turns(np.array([1.0, 0, 0]), np.array([0.0, 1, 0]))
    pole = (b + h) / 2
    free = disc(pole, 0.05)
    assert free(b, f)
    points = four_turn_corners(path, NONE, math.inf, free).points_m
    assert all(free(x, y) for x, y in pairwise(points))
    assert np.linalg.norm(points[1] - path[1]) < 5.0


@pytest.mark.parametrize("treat", TREATMENTS)
def test_corners_without_room_stay(treat):
    path = np.array([[0.0, 0, 0], [10, 0, 0], [10, 10, 0], [20, 10, 0]])
    assert (treat(path, np.zeros(4, bool), math.inf, lambda a, b: False).points_m == path).all()
    assert (treat(path, np.zeros(4, bool), 1e-4, anywhere).points_m == path).all()


@pytest.mark.parametrize("treat", TREATMENTS)
def test_straight_points_and_points_where_the_path_doubles_back_stay(treat):
    path = np.array([[0.0, 0, 0], [10, 0, 0], [20, 0, 0], [5, 0, 0]])
    assert (treat(path, np.zeros(4, bool), math.inf, anywhere).points_m == path).all()


@pytest.mark.parametrize("treat", TREATMENTS)
def test_cuts_that_meet_in_the_middle_of_a_leg_share_the_point(treat):
    path = np.array([[0.0, 0, 0], [0, 6, 0], [6, 6, 0], [6, 0, 0], [0.3, -5, 1]])
    points = treat(path, np.zeros(5, bool), math.inf, anywhere).points_m
    assert np.linalg.norm(np.diff(points, axis=0), axis=1).min() > 0.1
    assert (np.linalg.norm(points - [3.0, 6.0, 0.0], axis=1) < 1e-9).sum() == 1


def test_paths_in_the_plane_and_of_one_leg():
    assert len(cut_corners([[0, 0], [4, 0], [4, 4]], NONE, 1.0, anywhere).points_m) == 4
    assert len(four_turn_corners([[0, 0], [4, 0]], [True, True], 1.0, anywhere).points_m) == 2


@pytest.mark.parametrize(
    ("path", "must", "deviation", "field", "message"),
    [
        ([[0.0, 0, 0]], [False], 1.0, "path_m", "at least two points"),
        (np.zeros(3), [False], 1.0, "path_m", "at least two points"),
        ([[0.0, 0, 0], [1, 0, 0], [1, 0, 0]], NONE, 1.0, "path_m", "leg 1 has no length"),
        ([[0.0, 0, 0], [1, math.nan, 0], [1, 0, 0]], NONE, 1.0, "path_m", "leg 0: point 1 is not a finite"),
        (RIGHT_ANGLE, [False], 1.0, "must_visit", "3 points"),
        (RIGHT_ANGLE, NONE, 0.0, "max_deviation_m", "positive"),
        (RIGHT_ANGLE, NONE, math.nan, "max_deviation_m", "positive"),
    ],
)
@pytest.mark.parametrize("treat", TREATMENTS)
def test_bad_input_is_named(treat, path, must, deviation, field, message):
    with pytest.raises(InputError, match=message) as caught:
        treat(path, must, deviation, anywhere)
    assert caught.value.field == field
