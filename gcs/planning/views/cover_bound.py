"""A lower bound on the number of views: the linear relaxation of the cover that they were chosen for.

The first-order method of `cover_prices` comes close. What is missing is done by column generation: HiGHS (Huangfu and
Hall 2018) solves the relaxation over the candidates that matter, the prices of that solution say which others would
help, and those are added. The bound that is told is never the solver's word but computed from prices, which prove it
whatever tolerance they were found with, and also when the time ran out.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy import sparse
from scipy.optimize import linprog

from gcs.planning.views.cover_prices import (
    Incidence,
    PricedCover,
    approach_prices,
    feasible_prices,
    incidence,
    proven_bound,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from gcs.planning.views.cover_problem import CoverProblem

CLOSE_ENOUGH = 2e-3
"""The relaxation counts as solved when this share of it is not yet proven at most."""

MOST_MEMBERS = 400_000
"""Of the candidates that the solver begins with; with more it takes longer than the first-order method."""

FIRST_COLUMNS, KEPT_COLUMNS = 0.98, 0.8
"""Candidates whose targets cost at least this at the prices so far are what the solver begins with, and keeps."""

LEAST_PART = 1e-4
ADDED_COLUMNS = 500
HELPFUL = 1e-7
WORTH_MERGING = 0.9


@dataclass(frozen=True)
class CoverBound:
    """How many views a cover needs at least.

    Attributes:
        views: proven lower bound; a fraction, because the relaxation allows parts of views.
        relaxation: value of a solution of the relaxation, which no bound by it can exceed.
        solved: whether the two are the same to 0.2 %; otherwise time ran out, and `views` is a valid bound that a
            longer search might raise.
        seconds: time it took.
    """

    views: float
    relaxation: float
    solved: bool
    seconds: float


def cover_bound(problem: CoverProblem, time_limit_s: float, poll: Callable[[], None] | None = None) -> CoverBound:
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
    wanted, sets = _reduced(problem)
    if wanted <= 0:
        return CoverBound(0.0, 0.0, True, time.perf_counter() - began)

    def keep_on() -> bool:
        if poll is not None:
            poll()
        return time.perf_counter() < until

    def too_large(found: PricedCover) -> bool:
        return int(np.diff(sets.starts)[_promising(sets, found)].sum()) > MOST_MEMBERS

    found = approach_prices(sets, wanted, problem.chosen, keep_on, gap=CLOSE_ENOUGH, patient=too_large)
    bound, relaxation, columns = found.bound, found.relaxation, _promising(sets, found)
    while relaxation - bound > CLOSE_ENOUGH * relaxation and keep_on():
        solution = _solve(sets, columns, wanted, until - time.perf_counter())
        if solution is None:
            break
        relaxation = min(relaxation, solution.value)
        costs = sets.costs(solution.prices)
        bound = max(bound, proven_bound(sets, feasible_prices(sets, solution.prices, wanted), wanted))
        helpful = np.flatnonzero(costs > 1 + HELPFUL)
        helpful = helpful[np.argsort(-costs[helpful], kind="stable")[:ADDED_COLUMNS]]
        if np.isin(helpful, columns).all():
            break
        columns = np.union1d(columns[costs[columns] > KEPT_COLUMNS], helpful)
    solved = relaxation - bound <= CLOSE_ENOUGH * relaxation
    return CoverBound(bound, relaxation, solved, time.perf_counter() - began)


def _promising(sets: Incidence, found: PricedCover) -> NDArray[np.int64]:
    """Candidates that an optimal solution of the relaxation is likely to use."""
    return np.flatnonzero((sets.costs(found.prices) > FIRST_COLUMNS) | (found.x > LEAST_PART))


def _reduced(problem: CoverProblem) -> tuple[float, Incidence]:
    """What is left to be covered when `covered` is taken away: what weight, and by which sets.

    Targets that the same sets hold are merged to one of their weight, if that makes it much smaller.
    """
    possible = np.zeros(problem.targets, dtype=np.bool_)
    possible[problem.members] = True
    possible &= ~problem.covered
    sets = _among(problem.starts, problem.members, np.cumsum(possible) - 1, possible, np.ones(int(possible.sum())))
    group = _same_rows(sets.set_starts, sets.sets, sets.set_count)
    first = np.zeros(sets.targets, dtype=np.bool_)
    first[np.unique(group, return_index=True)[1]] = True
    wanted = min(float(problem.wanted - problem.covered.sum()), float(possible.sum()))
    if first.sum() > WORTH_MERGING * len(first):
        return wanted, sets
    return wanted, _among(sets.starts, sets.members, group, first, np.bincount(group).astype(np.float64))


def _among(
    starts: NDArray[np.int64],
    members: NDArray[np.int32],
    number: NDArray[np.int64],
    kept: NDArray[np.bool_],
    weights: NDArray[np.float64],
) -> Incidence:
    """The membership among the targets that are kept, by their new numbers."""
    inside = kept[members]
    running = np.concatenate([[0], np.cumsum(inside, dtype=np.int64)])
    return incidence(running[starts], number[members[inside]].astype(np.int32), weights)


@dataclass(frozen=True, eq=False)
class _Solution:
    value: float
    prices: NDArray[np.float64]


def _solve(sets: Incidence, columns: NDArray[np.int64], wanted: float, time_limit_s: float) -> _Solution | None:
    """The relaxation over some of the sets, by HiGHS; None when the time is up first.

    Targets that the same sets hold are merged to one of their weight.
    """
    if time_limit_s <= 0:
        return None
    starts, members = sets.only(columns)
    matrix = sparse.csr_array((np.ones(len(members)), members, starts), shape=(len(columns), sets.targets)).T.tocsr()
    group = _same_rows(matrix.indptr.astype(np.int64), matrix.indices, len(columns))
    first = np.unique(group, return_index=True)[1]
    weight = np.bincount(group, weights=sets.weights)
    merged = matrix[first]
    n, m = merged.shape
    rows = sparse.vstack(
        [sparse.hstack([-merged, sparse.eye_array(n)]), sparse.csr_array(np.concatenate([np.zeros(m), -weight])[None])],
        format="csr",
    )
    result = linprog(
        np.concatenate([np.ones(m), np.zeros(n)]),
        A_ub=rows,
        b_ub=np.concatenate([np.zeros(n), [-float(wanted)]]),
        bounds=[(0.0, None)] * m + [(0.0, 1.0)] * n,
        method="highs-ipm",
        options={"time_limit": time_limit_s},
    )
    if result.status != 0 or result.fun is None:
        return None
    prices = np.maximum(-result.ineqlin.marginals[:n], 0.0) / weight
    return _Solution(float(result.fun), prices[group] * sets.weights)


def _same_rows(starts: NDArray[np.int64], columns: NDArray[np.int32], width: int) -> NDArray[np.int64]:
    """A number for each row, the same for rows with the same columns (by a 64-bit sum of random numbers)."""
    key = np.random.default_rng(0).integers(1, 2**63, size=width).astype(np.uint64)
    running = np.concatenate([[np.uint64(0)], np.cumsum(key[columns], dtype=np.uint64)])
    return np.unique(running[starts[1:]] - running[starts[:-1]], return_inverse=True)[1]
