"""The cover as it is handed on."""

import numpy as np

from gcs.planning.views.cover_problem import CoverProblem, replicated


def test_a_target_is_there_as_often_as_its_weight_says():
    starts, members = np.array([0, 2, 3, 3]), np.array([2, 0, 1], dtype=np.int32)
    new_starts, new_members = replicated(starts, members, np.array([1, 3, 2]))
    # target 0 is 0; target 1 is 1, 2, 3; target 2 is 4, 5
    assert new_starts.tolist() == [0, 3, 6, 6]
    assert new_members.tolist() == [4, 5, 0, 1, 2, 3]


def test_members_of_a_candidate():
    problem = CoverProblem(
        np.array([0, 2, 3]), np.array([2, 0, 1], dtype=np.int32), 3, np.zeros(3, bool), 3, np.array([0, 1])
    )
    assert problem.candidates == 2
    assert problem.members_of(0).tolist() == [2, 0]


def test_nothing_to_cover():
    nothing = CoverProblem.empty()
    assert (nothing.candidates, nothing.targets, nothing.wanted, len(nothing.chosen)) == (0, 0, 0, 0)
