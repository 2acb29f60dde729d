"""The search for smaller covers against the true optimum, which mixed-integer programming proves."""

import numpy as np
import pytest
from scipy.optimize import Bounds, LinearConstraint, milp

from gcs.planning.views.cover_refinement import refine_cover
from gcs.planning.views.set_cover import greedy_cover, without_needless

WORK = 2e7


def problem(seed, sets=40, elements=120, radius=0.16):
    """Discs that cover points of a square: overlapping neighbours, as pictures are."""
    rng = np.random.default_rng(seed)
    points, middles = rng.random((elements, 2)), rng.random((sets, 2))
    inside = np.linalg.norm(points[:, None] - middles, axis=2) < radius
    inside[np.arange(elements), rng.integers(0, sets, elements)] = True
    return inside, rng.integers(1, 4, elements)


def lists(inside):
    members = [np.flatnonzero(column) for column in inside.T]
    starts = np.concatenate([[0], np.cumsum([len(m) for m in members])]).astype(np.int64)
    return starts, np.concatenate(members).astype(np.int32)


def optimum(inside, weights, wanted):
    elements, sets = inside.shape
    rows = np.block([[inside.astype(float), -np.eye(elements)], [np.zeros((1, sets)), weights[None].astype(float)]])
    least = np.concatenate([np.zeros(elements), [wanted]])
    result = milp(
        np.concatenate([np.ones(sets), np.zeros(elements)]),
        constraints=LinearConstraint(rows, least, np.inf),
        integrality=np.ones(sets + elements),
        bounds=Bounds(0, 1),
    )
    assert result.status == 0
    return round(result.fun)


def covered_weight(inside, weights, chosen):
    return int(weights[inside[:, chosen].any(axis=1)].sum())


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("share", [1.0, 0.9])
def test_finds_the_optimum_of_small_covers(seed, share):
    inside, weights = problem(seed)
    starts, members = lists(inside)
    wanted = int(np.ceil(share * weights.sum()))
    greedy = greedy_cover(starts, members, weights, wanted)
    first = without_needless(starts, members, weights, greedy, wanted)
    chosen = refine_cover(starts, members, weights, first, wanted, WORK, np.random.default_rng(seed))
    assert len(set(chosen.tolist())) == len(chosen)
    assert covered_weight(inside, weights, chosen) >= wanted
    assert len(chosen) == optimum(inside, weights, wanted)


def test_is_better_than_greedy_where_there_is_more_to_find():
    inside, weights = problem(3, sets=1500, elements=1500, radius=0.06)
    starts, members = lists(inside)
    wanted = int(0.99 * weights.sum())
    first = without_needless(starts, members, weights, greedy_cover(starts, members, weights, wanted), wanted)
    chosen = refine_cover(starts, members, weights, first, wanted, WORK, np.random.default_rng(0))
    assert covered_weight(inside, weights, chosen) >= wanted
    assert len(chosen) <= 0.96 * len(first)


def test_the_seed_decides():
    inside, weights = problem(1, sets=300, elements=600, radius=0.08)
    starts, members = lists(inside)
    wanted = int(weights.sum())
    first = greedy_cover(starts, members, weights, wanted)
    a, b = (refine_cover(starts, members, weights, first, wanted, WORK, np.random.default_rng(7)) for _ in range(2))
    np.testing.assert_array_equal(a, b)


def test_between_equals_the_preferred_one_is_taken():
    # every element is in two sets that hold the same; nothing but the preference tells them apart
    groups = np.arange(60) // 10
    inside = np.zeros((60, 12), bool)
    for g in range(6):
        inside[groups == g, 2 * g] = inside[groups == g, 2 * g + 1] = True
    starts, members = lists(inside)
    weights = np.ones(60, np.int64)
    first = np.array([0, 1, 2, 3, 4, 5, 6, 8, 10])
    chosen = refine_cover(
        starts, members, weights, first, 60, WORK, np.random.default_rng(0), preference=np.tile([0.9, 1.0], 6)
    )
    assert len(chosen) == 6


def test_a_cover_of_one_or_nothing_stays():
    starts, members = np.array([0, 3]), np.arange(3, dtype=np.int32)
    weights = np.ones(3, np.int64)
    rng = np.random.default_rng(0)
    assert refine_cover(starts, members, weights, np.array([0]), 3, WORK, rng).tolist() == [0]
    assert refine_cover(starts, members, weights, np.zeros(0, np.int64), 0, WORK, rng).tolist() == []


def test_it_can_be_stopped():
    inside, weights = problem(0)
    starts, members = lists(inside)

    def stop():
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        refine_cover(
            starts, members, weights, np.arange(40), int(weights.sum()), 1e12, np.random.default_rng(0), poll=stop
        )
