"""Pictures find their viewpoints when some are missing, extra, or taken from one place in several directions."""

import itertools

import numpy as np
import pytest

from gcs.planning.views.image_matching import MAX_DISTANCE_M, match_images

NORTH, EAST = np.pi / 2, 0.0


@pytest.fixture
def scene():
    positions = np.array([[0.0, 0, 10], [0, 0, 10], [5, 0, 10], [5, 0, 15], [0, 0, 10]])
    directions = np.array([NORTH, EAST, NORTH, NORTH, NORTH])
    return positions, directions


def test_all_there_in_order(scene):
    positions, directions = scene
    noisy = positions + np.random.default_rng(0).normal(0, 0.2, positions.shape)
    assert match_images(noisy, directions, positions, directions) == [0, 1, 2, 3, 4]


@pytest.mark.parametrize("missing", range(5))
def test_a_missing_picture_leaves_the_others_where_they_belong(scene, missing):
    positions, directions = scene
    keep = [i for i in range(5) if i != missing]
    assert match_images(positions[keep], directions[keep], positions, directions) == keep


def test_a_test_shot_on_the_ground_belongs_to_none(scene):
    positions, directions = scene
    extra = np.vstack([[[-20.0, -20, 0]], positions])
    assert match_images(extra, np.concatenate([[NORTH], directions]), positions, directions) == [None, 0, 1, 2, 3, 4]


def test_a_picture_in_the_wrong_direction_is_not_taken_for_the_right_one(scene):
    positions, directions = scene
    wrong = directions.copy()
    wrong[2] = EAST
    assert match_images(positions, wrong, positions, directions) == [0, 1, None, 3, 4]


def test_a_doubled_picture_is_matched_once(scene):
    positions, directions = scene
    matched = match_images(positions[[0, 1, 2, 2, 3, 4]], directions[[0, 1, 2, 2, 3, 4]], positions, directions)
    assert sorted(m for m in matched if m is not None) == [0, 1, 2, 3, 4]


def test_without_positions_only_complete_sets_are_matched(scene):
    positions, directions = scene
    nowhere, anyhow = np.full_like(positions, np.nan), np.full(5, np.nan)
    assert match_images(nowhere, anyhow, positions, directions) == [0, 1, 2, 3, 4]
    assert match_images(nowhere[:4], anyhow[:4], positions, directions) == [None] * 4


def test_headings_are_compared_around_the_circle(scene):
    positions, _ = scene
    west, nearly = np.full(5, np.pi), np.full(5, -np.pi + 0.1)
    assert match_images(positions, nearly, positions, west) == [0, 1, 2, 3, 4]


def test_against_all_alignments_of_small_cases():
    rng = np.random.default_rng(5)
    for _ in range(30):
        n, m = rng.integers(1, 5, 2)
        p, q = rng.uniform(0, 2.5, (n, 3)), rng.uniform(0, 2.5, (m, 3))
        d = np.full(5, NORTH)
        distance = np.linalg.norm(p[:, None] - q[None], axis=2)
        most = 0
        for k in range(min(n, m), 0, -1):
            pairs = itertools.product(itertools.combinations(range(n), k), itertools.combinations(range(m), k))
            if any((distance[list(a), list(b)] <= MAX_DISTANCE_M).all() for a, b in pairs):
                most = k
                break
        matched = [j for j in match_images(p, d[:n], q, d[:m]) if j is not None]
        assert matched == sorted(matched)
        assert len(matched) == most


def test_nothing_to_match():
    none = np.zeros((0, 3))
    assert match_images(none, np.zeros(0), np.zeros((2, 3)), np.zeros(2)) == []
