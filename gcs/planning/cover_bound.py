"""A lower bound on the number of views: the linear relaxation of the cover that they were chosen for.

The relaxation is solved by column generation: HiGHS (Huangfu and Hall 2018) solves it over few candidates, the prices of
that solution say which others would help, and those are added. The prices of `cover_prices` say where to begin. The
bound that is told is never the solver's word but computed from prices, which prove it whatever tolerance they were
found with, or when the time ran out.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy import sparse
from scipy.optimize import linprog

from gcs.planning.cover_prices import (
    Incidence,
    approach_prices,
    feasible_prices,
    incidence,
    proven_bound,
    seconds_left,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from gcs.planning.cover_problem import CoverProblem

CLOSE_ENOUGH = 1e-3
"""The relaxation counts as solved when this share of it is not yet proven at most."""

MOST_ROUNDS = 60
WARM_UP_SHARE = 0.4
"""Of the time: for prices of the first-order method, before the solver begins."""

WARM_UP_ROUNDS = 12
FIRST_COLUMNS = 0.98
KEPT_COLUMNS = 0.8
"""Candidates whose targets cost at least this at the prices so far are what the solver begins with, and keeps."""

ADDED_COLUMNS = 500


@dataclass(frozen=True)
class CoverBound:
    """How many views a cover needs at least.

    Attributes:
        views: proven lower bound; a fraction, because the relaxation allows parts of views.
        relaxation: value of a solution of the relaxation, which no bound by it can exceed.
        solved: whether the two are the same to 0.1 %; otherwise time ran out, and `views` is a valid bound that a
            longer search might raise.
        seconds: time it took.
    """

    views: float
    relaxation: float
    solved: bool
    seconds: float


def cover_bound(
    problem: CoverProblem, time_limit_s: float, poll: Callable[[], None] | None = None
) -> CoverBound:
    """Bound the number of candidates that any choice needs which covers as much as was asked for.

    The required cover is that of the selection: `wanted` targets, those in `covered` counted in. No choice from these
    candidates that reaches it has fewer views; other candidates might.

    Args:
        problem: the cover.
        time_limit_s: when to end the search; a little later it returns what is proven by then.
        poll: called now and then, though not while the solver runs; may raise to stop the work.
    """
    began = time.perf_counter()
    until = began + time_limit_s
    wanted, sets, chosen = _reduced(problem)
    if wanted <= 0 or sets.targets < wanted:
        return CoverBound(0.0, 0.0, True, time.perf_counter() - began)
    warm_until = began + WARM_UP_SHARE * time_limit_s

    def keep_on(_: float) -> bool:
        if poll is not None:
            poll()
        return time.perf_counter() < warm_until

    prices, x = approach_prices(sets, wanted, chosen, keep_on, rounds=WARM_UP_ROUNDS)
    bound, relaxation = proven_bound(prices, wanted), float(len(chosen))
    columns = np.union1d(np.flatnonzero((sets.costs(prices) > FIRST_COLUMNS) | (x > 1e-6)), chosen)
    for _ in range(MOST_ROUNDS):
        if poll is not None:
            poll()
        solution = _solve(sets, columns, wanted, seconds_left(until))
        if solution is None:
            break
        relaxation = min(relaxation, solution.value)
        costs = sets.costs(solution.prices)
        bound = max(bound, proven_bound(feasible_prices(sets, solution.prices, wanted), wanted))
        if relaxation - bound <= CLOSE_ENOUGH * relaxation:
            break
        helpful = np.flatnonzero(costs > 1 + 1e-7)
        helpful = helpful[np.argsort(-costs[helpful], kind="stable")[:ADDED_COLUMNS]]
        columns = np.union1d(columns[costs[columns] > KEPT_COLUMNS], helpful)
    solved = relaxation - bound <= CLOSE_ENOUGH * relaxation
    return CoverBound(bound, relaxation, solved, time.perf_counter() - began)


def _reduced(problem: CoverProblem) -> tuple[int, Incidence, NDArray[np.int64]]:
    """What is left to be covered when `covered` is taken away: how much, by which sets, and the known choice."""
    possible = np.zeros(problem.targets, dtype=np.bool_)
    possible[problem.members] = True
    possible &= ~problem.covered
    number = np.cumsum(possible, dtype=np.int64) - 1
    kept = possible[problem.members]
    running = np.concatenate([[0], np.cumsum(kept, dtype=np.int64)])
    members = number[problem.members[kept]].astype(np.int32)
    sets = incidence(running[problem.starts], members, int(possible.sum()))
    return problem.wanted - int(problem.covered.sum()), sets, problem.chosen


@dataclass(frozen=True, eq=False)
class _Solution:
    value: float
    prices: NDArray[np.float64]


def _solve(sets: Incidence, columns: NDArray[np.int64], wanted: int, time_limit_s: float) -> _Solution | None:
    """The relaxation over some of the sets, by HiGHS; None when the time is up first.

    Targets that the same sets hold are merged to one of their weight.
    """
    if time_limit_s <= 0:
        return None
    starts, members = sets.only(columns)
    matrix = sparse.csr_array(
        (np.ones(len(members)), members, starts), shape=(len(columns), sets.targets)
    ).T.tocsr()
    group = _same_rows(matrix)
    first = np.unique(group, return_index=True)[1]
    weight = np.bincount(group).astype(np.float64)
    merged = matrix[first]
    n, m = merged.shape
    rows = sparse.block_array([[-merged, sparse.eye_array(n)], [None, -weight[None]]], format="csc")
    if rows.shape[1] != m + n:
        raise AssertionError("the relaxation's matrix has the wrong shape")
    result = linprog(
        np.concatenate([np.ones(m), np.zeros(n)]),
        A_ub=rows,
        b_ub=np.concatenate([np.zeros(n), [-float(wanted)]]),
        bounds=np.column_stack([np.zeros(m + n), np.concatenate([np.full(m, np.inf), np.ones(n)])]),
        method="highs-ipm",
        options={"time_limit": time_limit_s},
    )
    if result.status != 0:
        return None
    prices = np.maximum(-result.ineqlin.marginals[:n], 0.0) / weight
    return _Solution(float(result.fun), prices[group])


def _same_rows(matrix: sparse.csr_array) -> NDArray[np.int64]:
    """A number for each row, the same for rows with the same columns (by a 64-bit sum of random numbers)."""
    key = np.random.default_rng(0).integers(1, 2**63, size=matrix.shape[1]).astype(np.uint64)
    running = np.concatenate([[np.uint64(0)], np.cumsum(key[matrix.indices], dtype=np.uint64)])
    return np.unique(running[matrix.indptr[1:]] - running[matrix.indptr[:-1]], return_inverse=True)[1]
