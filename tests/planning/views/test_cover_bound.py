"""The bound on the number of views against brute force, an exact solver, and the whole relaxation."""

import itertools

import numpy as np
import pytest
from scipy.optimize import LinearConstraint, linprog, milp
from scipy.sparse import csr_array, eye_array, hstack, vstack

from gcs.planning.views.cover_bound import cover_bound
from gcs.planning.views.cover_prices import feasible_prices, incidence, proven_bound
from gcs.planning.views.cover_problem import CoverProblem
from gcs.planning.views.set_cover import greedy_cover


def joined_members(sets):
    """Sets side by side, as a cover problem has them."""
    starts = np.concatenate([[0], np.cumsum([len(s) for s in sets])]).astype(np.int64)
    return starts, np.concatenate(sets).astype(np.int32)


def random_cover(seed, candidates, targets, density, share=1.0, covered_share=0.0):
    """Random sets, or intervals for odd seeds, some targets covered beforehand, and a greedy choice."""
    rng = np.random.default_rng(seed)
    if seed % 2:
        first = rng.integers(0, targets, candidates)
        length = rng.integers(1, max(2, int(2 * density * targets)), candidates)
        sets = [np.arange(a, min(a + n, targets)) for a, n in zip(first, length, strict=True)]
    else:
        sets = [np.flatnonzero(rng.random(targets) < density) for _ in range(candidates)]
    covered = rng.random(targets) < covered_share
    starts, members = joined_members(sets)
    possible = covered.copy()
    possible[members] = True
    wanted = max(int(np.ceil(share * possible.sum())), int(covered.sum()))
    order, done = [], covered.copy()
    while done.sum() < wanted:
        gains = [(~done[s]).sum() for s in sets]
        order.append(int(np.argmax(gains)))
        done[sets[order[-1]]] = True
    return CoverProblem(starts, members, targets, covered, wanted, np.array(order, dtype=np.int64))


def matrix_of(problem):
    return csr_array(
        (np.ones(len(problem.members)), problem.members, problem.starts), shape=(problem.candidates, problem.targets)
    ).T[~problem.covered]


def relaxation(problem, **solver):
    """The whole problem at once: views, then how much of each target is covered."""
    a = matrix_of(problem)
    n, c = a.shape
    rows = vstack([hstack([-a, eye_array(n)]), csr_array(np.concatenate([np.zeros(c), -np.ones(n)])[None])])
    right = np.append(np.zeros(n), -(problem.wanted - problem.covered.sum()))
    cost = np.append(np.ones(c), np.zeros(n))
    if solver:
        result = milp(cost, constraints=LinearConstraint(rows, ub=right), bounds=(0, 1), **solver)
    else:
        result = linprog(cost, A_ub=rows, b_ub=right, bounds=[(0, None)] * c + [(0, 1)] * n)
    assert result.status == 0
    return result.fun


@pytest.mark.parametrize("seed", range(12))
def test_never_over_the_best_choice_that_brute_force_finds(seed):
    problem = random_cover(seed, 11, 24, 0.22, share=0.9, covered_share=0.1)
    need = problem.wanted
    best = next(
        size
        for size in range(problem.candidates + 1)
        for choice in itertools.combinations(range(problem.candidates), size)
        if np.union1d(
            np.flatnonzero(problem.covered), np.concatenate([problem.members_of(k) for k in choice] or [[]])
        ).size
        >= need
    )
    bound = cover_bound(problem, 30.0)
    assert bound.solved
    assert bound.views <= best + 1e-9
    assert best <= len(problem.chosen)


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("share", [1.0, 0.93])
def test_equals_the_whole_relaxation(seed, share):
    problem = random_cover(seed, 60, 150, 0.06, share=share, covered_share=0.05)
    bound = cover_bound(problem, 30.0)
    exact = relaxation(problem)
    assert bound.solved
    assert exact * (1 - 2.1e-3) <= bound.views <= exact * (1 + 1e-9)
    assert bound.relaxation == pytest.approx(exact, rel=2.1e-3)
    assert bound.views <= relaxation(problem, integrality=np.append(np.ones(60), np.zeros(matrix_of(problem).shape[0])))


def test_targets_of_the_same_sets_count_each():
    # all that the two sets hold is wanted but for 10: the larger set alone will do, and nothing smaller
    sets = [np.arange(40), np.arange(40, 50)]
    starts, members = joined_members(sets)
    problem = CoverProblem(starts, members, 50, np.zeros(50, dtype=bool), 40, np.array([0]))
    assert cover_bound(problem, 5.0).views == pytest.approx(1.0)
    problem = CoverProblem(starts, members, 50, np.zeros(50, dtype=bool), 45, np.array([0, 1]))
    assert cover_bound(problem, 5.0).views == pytest.approx(1.5)


def test_column_generation_on_a_larger_cover():
    problem = random_cover(4, 900, 1500, 0.02, share=0.98)
    bound = cover_bound(problem, 60.0)
    assert bound.views == pytest.approx(relaxation(problem), rel=2.1e-3)


def test_when_the_time_is_up_the_bound_still_holds_and_says_so():
    problem = random_cover(6, 900, 1500, 0.02, share=0.98)
    exact = relaxation(problem)
    at_once = cover_bound(problem, 0.0)
    assert not at_once.solved
    assert 0.1 * exact < at_once.views <= exact


def test_more_time_never_hurts_what_is_proven():
    problem = random_cover(8, 500, 800, 0.03, share=0.98)
    assert cover_bound(problem, 0.0).views <= cover_bound(problem, 60.0).views + 1e-9


def test_any_prices_are_made_feasible_and_prove_a_bound():
    problem = random_cover(2, 60, 150, 0.06, share=0.95)
    seen = np.unique(problem.members)
    sets = incidence(problem.starts, np.searchsorted(seen, problem.members).astype(np.int32), np.ones(len(seen)))
    exact = relaxation(problem)
    rng = np.random.default_rng(0)
    for scale in (1e-3, 0.3, 100.0):
        prices = feasible_prices(sets, scale * rng.random(len(seen)), problem.wanted)
        assert (prices >= 0).all()
        costs = [prices[np.searchsorted(seen, problem.members_of(k))].sum() for k in range(problem.candidates)]
        assert max(costs) <= 1 + 1e-9
        assert proven_bound(sets, prices, problem.wanted) <= exact * (1 + 1e-9)


def test_what_is_covered_already_needs_no_views():
    problem = random_cover(1, 20, 40, 0.2)
    done = CoverProblem(problem.starts, problem.members, 40, np.ones(40, dtype=bool), 40, np.zeros(0, dtype=np.int64))
    assert cover_bound(done, 5.0).views == 0.0


def test_sets_that_share_nothing_are_all_needed():
    sets = [np.arange(5 * k, 5 * k + 5) for k in range(7)]
    starts, members = joined_members(sets)
    whole = CoverProblem(starts, members, 35, np.zeros(35, dtype=bool), 35, np.arange(7))
    assert cover_bound(whole, 5.0).views == pytest.approx(7.0, abs=1e-6)
    most = CoverProblem(starts, members, 35, np.zeros(35, dtype=bool), 30, np.arange(7))
    assert cover_bound(most, 5.0).views == pytest.approx(6.0, abs=1e-6)


def test_a_poll_that_raises_ends_it():
    class StopNow(Exception):
        pass

    def poll():
        raise StopNow

    with pytest.raises(StopNow):
        cover_bound(random_cover(6, 900, 1500, 0.02), 60.0, poll)


def test_greedy_is_within_its_factor_of_the_bound():
    problem = random_cover(10, 300, 500, 0.03)
    chosen = greedy_cover(problem.starts, problem.members, np.ones(problem.targets, dtype=np.int64), problem.wanted)
    bound = cover_bound(problem, 30.0)
    assert bound.views <= len(chosen) <= bound.views * (1 + np.log(np.diff(problem.starts).max()))
