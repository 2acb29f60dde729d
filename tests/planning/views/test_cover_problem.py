"""The cover as it is handed on."""

import numpy as np

from gcs.planning.views.cover_problem import CoverProblem, without_twins


def test_targets_of_the_same_sets_become_one():
    rng = np.random.default_rng(3)
    sets = [np.sort(rng.choice(40, size=size, replace=False)) for size in (0, 12, 25, 3, 40)]
    starts = np.concatenate([[0], np.cumsum([len(s) for s in sets])])
    weights = rng.integers(1, 9, 40)
    new_starts, new_members, new_weights = without_twins(starts, np.concatenate(sets).astype(np.int32), weights)
    columns = {tuple(t in s for s in sets) for t in range(40)}
    assert len(new_weights) == len(columns)
    assert new_weights.sum() == weights.sum()
    for pick in ([0], [1], [3], [1, 2], [1, 2, 3], [4]):  # any choice of sets covers the same weight
        before = weights[np.unique(np.concatenate([sets[k] for k in pick]).astype(int))].sum()
        after = np.concatenate([new_members[new_starts[k] : new_starts[k + 1]] for k in pick])
        assert new_weights[np.unique(after)].sum() == before


def test_members_of_a_candidate():
    problem = CoverProblem(
        np.array([0, 2, 3]), np.array([2, 0, 1], dtype=np.int32), 3, np.zeros(3, bool), 3, np.array([0, 1])
    )
    assert problem.candidates == 2
    assert problem.members_of(0).tolist() == [2, 0]


def test_nothing_to_cover():
    nothing = CoverProblem.empty()
    assert (nothing.candidates, nothing.targets, nothing.wanted, len(nothing.chosen)) == (0, 0, 0, 0)
