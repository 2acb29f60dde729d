"""Few straight legs for a curve: the chord error is checked by brute force, straights stay one leg."""

from __future__ import annotations

from itertools import combinations, pairwise

import numpy as np
import pytest

from gcs.core.errors import InputError
from gcs.core.trajectory import PiecewisePolynomial
from gcs.planning.trajectories.mission_sampling import (
    chord_error,
    farthest_chords,
    fewest_chords,
    sample_mission_path,
)

SMOOTH = np.array([0, 0, 0, 0, 35, -84, 70, -20], dtype=float)
"""7th-order step from rest to rest."""


def straight(a, b):
    a, b = np.asarray(a, float), np.asarray(b, float)
    piece = SMOOTH[:, None] * (b - a)
    piece[0] += a
    return piece


def fitted(curve):
    u = np.linspace(0, 1, 40)
    return np.linalg.lstsq(np.vander(u, 8, increasing=True), np.array([curve(x) for x in u]), rcond=None)[0]


def circle(angle_from, angle_to, radius, centre):
    def at(u):
        angle = angle_from + (angle_to - angle_from) * u
        return np.add(centre, (radius * np.cos(angle), radius * np.sin(angle), 0))

    return fitted(at)


def curve_of(pieces, seconds=8.0):
    return PiecewisePolynomial(np.array(pieces), np.broadcast_to(np.asarray(seconds, float), len(pieces)).copy())


def brute_error(trajectory, start_s, end_s, polyline):
    points = trajectory.value(np.linspace(start_s, end_s, 801))
    legs = [a + (b - a) * np.linspace(0, 1, 2001)[:, None] for a, b in pairwise(polyline)]
    return max(min(np.linalg.norm(leg - p, axis=1).min() for leg in legs) for p in points)


def box_flight():
    """Up, a straight, half a circle between two viewpoints (16 s and 24 s), straight back, down."""
    top = (0, 0, 20)
    return curve_of(
        [
            straight((0, 0, 0), top),
            straight(top, (30, 0, 20)),
            *(circle(k * np.pi / 4, (k + 1) * np.pi / 4, 30.0, top) for k in range(4)),
            straight((-30, 0, 20), top),
            straight(top, (0, 0, 0)),
        ],
        [8, 8, 2, 2, 2, 2, 8, 8],
    )


@pytest.mark.parametrize("tolerance", [0.1, 0.3, 1.0])
def test_chord_error_is_kept_and_points_are_few(tolerance):
    trajectory = box_flight()
    path = sample_mission_path(trajectory, [16.0, 24.0], tolerance)
    arc = np.vstack([path.legs_m[0][-1], path.legs_m[1]])
    assert brute_error(trajectory, 16.0, 24.0, arc) <= tolerance * 1.001 + 1e-3
    assert path.chord_error_m <= tolerance
    best = np.pi * 30 / np.sqrt(8 * 30 * tolerance)
    assert len(path.legs_m[1]) <= 2 * best + 1


def test_straights_stay_one_leg_and_the_column_is_not_flown_through():
    path = sample_mission_path(box_flight(), [16.0, 24.0])
    np.testing.assert_allclose(path.takeoff_m, (0, 0, 20), atol=0.06)
    assert [len(leg) for leg in (path.legs_m[0], path.legs_m[2])] == [1, 1]
    np.testing.assert_allclose(path.legs_m[0][-1], (30, 0, 20), atol=1e-6)
    np.testing.assert_allclose(path.legs_m[1][-1], (-30, 0, 20), atol=1e-6)
    np.testing.assert_allclose(path.legs_m[2][-1], (0, 0, 20), atol=0.06)


def test_corners_between_straights_are_kept():
    trajectory = curve_of(
        [
            straight((0, 0, 0), (0, 0, 10)),
            straight((0, 0, 10), (20, 0, 10)),
            straight((20, 0, 10), (20, 20, 10)),
            straight((20, 20, 10), (20, 20, 30)),
            straight((20, 20, 30), (0, 0, 30)),
            straight((0, 0, 30), (0, 0, 0)),
        ]
    )
    path = sample_mission_path(trajectory, [32.0])
    # The straight before a corner ends within the chord error of it.
    np.testing.assert_allclose(path.legs_m[0], [(20, 0, 10), (20, 20, 10), (20, 20, 30)], atol=0.06)
    assert len(path.legs_m[1]) == 1


def test_standing_at_a_viewpoint_adds_no_points():
    still = straight((10, 0, 10), (10, 0, 10))
    trajectory = curve_of(
        [
            straight((0, 0, 0), (0, 0, 10)),
            straight((0, 0, 10), (10, 0, 10)),
            still,
            still,
            straight((10, 0, 10), (0, 0, 10)),
            straight((0, 0, 10), (0, 0, 0)),
        ]
    )
    path = sample_mission_path(trajectory, [20.0, 28.0])
    assert [leg.shape for leg in path.legs_m] == [(1, 3)] * 3
    np.testing.assert_allclose(path.legs_m[1][0], (10, 0, 10))


def test_viewpoint_over_home():
    trajectory = curve_of([straight((0, 0, 0), (0, 0, 10)), straight((0, 0, 10), (0, 0, 0))])
    path = sample_mission_path(trajectory, [8.0])
    np.testing.assert_allclose(path.takeoff_m, (0, 0, 10))
    np.testing.assert_allclose(path.legs_m[0], [(0, 0, 10)])
    np.testing.assert_allclose(path.legs_m[1], [(0, 0, 10)])


def test_random_curves_against_brute_force():
    rng = np.random.default_rng(4)
    for _ in range(8):
        ends = np.add(rng.uniform(-20, 20, (5, 3)), (0, 0, 30))
        pieces = [straight((0, 0, 0), (0, 0, 25))]
        at = np.array([0.0, 0.0, 25.0])
        for end in ends:
            bend = straight(at, end)
            bend[4:] += rng.normal(0, 3, (4, 3)) - rng.normal(0, 3, (4, 3)).mean(axis=0)
            bend[7] += end - bend.sum(axis=0)
            pieces.append(bend)
            at = end
        pieces += [straight(at, (0, 0, 25)), straight((0, 0, 25), (0, 0, 0))]
        trajectory = curve_of(pieces)
        path = sample_mission_path(trajectory, [24.0, 48.0], 0.3)
        middle = np.vstack([path.legs_m[0][-1], path.legs_m[1]])
        assert brute_error(trajectory, 24.0, 48.0, middle) <= 0.3 + 0.005


@pytest.mark.parametrize("bad", [0.0, -1.0, float("nan")])
def test_bad_tolerance(bad):
    with pytest.raises(InputError, match="chord_error_m"):
        sample_mission_path(box_flight(), [16.0], bad)


@pytest.mark.parametrize("times", [[20.0, 10.0], [-1.0], [1000.0]])
def test_bad_times(times):
    with pytest.raises(InputError, match="stop_times_s"):
        sample_mission_path(box_flight(), times)


def test_chord_error_of_a_single_point():
    assert chord_error([[0, 0, 0], [3, 4, 0]], [[0, 0, 0]]) == 5.0


def fewest_by_trying_all(curve, tolerance):
    """Of all choices of points that keep the chord error, the size of the smallest."""
    inner = range(1, len(curve) - 1)
    for count in range(len(curve)):
        for chosen in combinations(inner, count):
            kept = [0, *chosen, len(curve) - 1]
            pairs = ((curve[a : b + 1], curve[[a, b]]) for a, b in pairwise(kept))
            if all(chord_error(part, chord) <= tolerance for part, chord in pairs):
                return len(kept)
    return len(curve)


@pytest.mark.parametrize("seed", range(6))
def test_no_choice_of_points_is_smaller(seed):
    rng = np.random.default_rng(seed)
    curve = np.cumsum(np.add(rng.normal(size=(11, 3)), (0.6, 0, 0)), axis=0)
    for tolerance in (0.3, 0.8, 2.0):
        kept = fewest_chords(curve, tolerance)
        assert len(kept) == fewest_by_trying_all(curve, tolerance)
        assert all(chord_error(curve[a : b + 1], curve[[a, b]]) <= tolerance for a, b in pairwise(kept))


def test_chords_of_a_circle_are_as_long_as_the_error_lets_them():
    # L = sqrt(8 R e) for a chord of length L on a circle of radius R
    angle = np.linspace(0, 2.5, 2000)
    curve = 20 * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    length = np.sqrt(8 * 20 * 0.1)
    steps = np.linalg.norm(np.diff(curve[farthest_chords(curve, 0.1)], axis=0), axis=1)
    assert steps[:-1] == pytest.approx(length, rel=0.01)
    assert len(fewest_chords(curve, 0.1)) - 1 == int(np.ceil(20 * 2.5 / length))
