"""The generalised tour: each target has several candidate viewpoints, and the tour visits one of each.

Order and choice are found in turns and together. In turns: the tour solver orders the chosen viewpoints, dynamic
programming along the order makes the best choice of all, and so on until nothing changes. Together: near targets are
taken out of the tour and put back one by one, each with the viewpoint and at the place that cost least, which is kept
when it is better, or at first not much worse (S. Smith, F. Imeson, Computers & Operations Research 87, 2017; places
are left out by chance as by J. Christiaens, G. Vanden Berghe, Transportation Science 54, 2020).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.errors import InputError
from gcs.planning.numerics.compiled import compiled
from gcs.planning.tours.tour_costs import Floats, Ints, TourCosts
from gcs.planning.tours.tour_solver import solve_tour

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import ArrayLike, NDArray

NEAR = 24
"""Targets next to which one is put back."""

MOST_OUT = 12
ROUNDS_PER_TARGET = 100
LEAST_ROUNDS = 2000
ROUNDS_AT_ONCE = 2000
WARMTH = 0.1
"""Excess that is accepted with a chance of 1/e at first, in mean costs of the tour's edges."""

LEFT_OUT = 0.02
"""Share of the places that are not looked at when a target is put back."""

MOST_TURNS = 20
BETTER = 1e-9
FEWEST = 4
"""Targets up to which order and choice are not looked for together."""

QUICK = 0.2
"""Effort of the tours that only begin."""


@dataclass(frozen=True, eq=False)
class GeneralisedTour:
    """A closed tour that visits one candidate of each target.

    Attributes:
        order: candidates in visiting order, shape (m,).
        cost: of the tour.
    """

    order: NDArray[np.int64]
    cost: float


def generalised_tour(
    points: ArrayLike,
    targets: ArrayLike,
    *,
    seed: int = 0,
    effort: float = 1.0,
    poll: Callable[[], None] | None = None,
) -> GeneralisedTour:
    """A short closed tour through one candidate of each target.

    Args:
        points: candidates in a space where distance is cost, shape (n, 3).
        targets: which target each is for, numbers 0 ... m - 1, shape (n,). A place that must be visited is a target
            with one candidate.
        seed: of the random numbers.
        effort: search in multiples of what the number of targets asks for by itself.
        poll: called now and then; may raise.

    Raises:
        InputError: a target has no candidate.
    """
    where = np.ascontiguousarray(points, dtype=np.float64).reshape(-1, 3)
    owner = np.asarray(targets, dtype=np.int64)
    m = int(owner.max(initial=-1)) + 1
    count = np.bincount(owner, minlength=m)
    if m == 0 or not count.all():
        raise InputError(f"target {int(np.argmin(count)) if m else 0} has no candidate viewpoint", field="targets")
    by_target = np.argsort(owner, kind="stable")
    start = np.concatenate([[0], np.cumsum(count)])
    sorted_points = where[by_target]
    tour = _first_choice(sorted_points, owner[by_target], start)
    tour = _in_turns(sorted_points, start, tour, seed, poll, effort=QUICK)
    if m > FEWEST:
        rounds = round(effort * max(ROUNDS_PER_TARGET * m, LEAST_ROUNDS))
        tour = _together(sorted_points, start, tour, rounds, seed, poll)
        tour = _in_turns(sorted_points, start, tour, seed, poll, effort=min(effort, 1.0), ordered=True)
    return GeneralisedTour(by_target[tour], TourCosts.of_points(sorted_points).of_tour(tour))


def target_costs(points: ArrayLike, targets: ArrayLike) -> NDArray[np.float64]:
    """Least distance between any candidates of two targets: a tour over these costs bounds every generalised one.

    Args:
        points: as in `generalised_tour`, as are the targets.
        targets: which target each candidate is for.

    Returns:
        Shape (m, m), with zeros on the diagonal.
    """
    from scipy.spatial.distance import cdist

    where, owner = np.asarray(points, dtype=np.float64).reshape(-1, 3), np.asarray(targets, dtype=np.int64)
    by_target = np.argsort(owner, kind="stable")
    start = np.searchsorted(owner[by_target], np.arange(int(owner.max()) + 1))
    least = np.minimum.reduceat(cdist(where[by_target], where[by_target]), start, axis=0)
    least = np.minimum.reduceat(least, start, axis=1)
    np.fill_diagonal(least, 0.0)
    return np.asarray(least)


def best_choice(points: NDArray[np.float64], start: NDArray[np.int64], order: NDArray[np.int64]) -> NDArray[np.int64]:
    """The cheapest choice of candidates when targets are visited in an order: exact, by dynamic programming.

    Args:
        points: candidates, those of each target together, shape (n, 3).
        start: where those of each target begin, shape (m + 1,).
        order: targets in visiting order, shape (m,).

    Returns:
        One candidate of each target in visiting order, shape (m,).
    """
    fewest = int(np.argmin(np.diff(start)[order]))
    turned = np.roll(order, -fewest)
    return np.roll(_best_choice(points, start, turned), fewest)


def _first_choice(points: NDArray[np.float64], owner: NDArray[np.int64], start: NDArray[np.int64]) -> NDArray[np.int64]:
    """Of each target the candidate that is nearest to the mean of the nearest other targets' ones."""
    m = len(start) - 1
    if m < 3:
        return start[:-1].copy()
    from scipy.spatial import KDTree

    centres = np.add.reduceat(points, start[:-1]) / np.diff(start)[:, None]
    near = np.asarray(KDTree(centres).query(centres, min(4, m))[1])
    towards = centres[near[:, 1:]].mean(axis=1)
    off = np.linalg.norm(points - towards[owner], axis=1)
    return np.array([start[t] + int(np.argmin(off[start[t] : start[t + 1]])) for t in range(m)])


def _in_turns(
    points: NDArray[np.float64],
    start: NDArray[np.int64],
    tour: NDArray[np.int64],
    seed: int,
    poll: Callable[[], None] | None,
    *,
    effort: float = 1.0,
    ordered: bool = False,
) -> NDArray[np.int64]:
    """Order and choice in turns until nothing changes; the tour given is in order already, or not."""
    owner = np.repeat(np.arange(len(start) - 1), np.diff(start))
    costs = TourCosts.of_points(points)
    best = best_choice(points, start, owner[tour]) if ordered else tour
    for turn in range(MOST_TURNS):
        begin = None if turn == 0 and not ordered else np.arange(len(best))
        order = solve_tour(TourCosts.of_points(points[best]), seed=seed, effort=effort, start=begin, poll=poll)
        found = best_choice(points, start, owner[best[order]])
        if (turn or ordered) and costs.of_tour(found) >= costs.of_tour(best) * (1 - BETTER):
            break
        best = found
    return best


def _together(
    points: NDArray[np.float64],
    start: NDArray[np.int64],
    tour: NDArray[np.int64],
    rounds: int,
    seed: int,
    poll: Callable[[], None] | None,
) -> NDArray[np.int64]:
    """Take targets out and put them back."""
    from scipy.spatial import KDTree

    m = len(tour)
    owner = np.repeat(np.arange(m), np.diff(start))
    centres = np.add.reduceat(points, start[:-1]) / np.diff(start)[:, None]
    near = np.asarray(KDTree(centres).query(centres, min(NEAR + 1, m))[1], dtype=np.int64)
    rng = np.random.default_rng(seed)
    targets = owner[tour]
    chosen, after, before = (np.empty(m, dtype=np.int64) for _ in range(3))
    chosen[targets], after[targets], before[targets] = tour, np.roll(targets, -1), np.roll(targets, 1)
    best = (chosen.copy(), after.copy(), before.copy())
    warmth = WARMTH * TourCosts.of_points(points).of_tour(tour) / m
    excess = 0.0
    for begin in range(0, rounds, ROUNDS_AT_ONCE):
        if poll:
            poll()
        end = min(begin + ROUNDS_AT_ONCE, rounds)
        excess = _put_back(points, start, near, chosen, after, before, *best, excess, warmth, rng, begin, end, rounds)
    return best[0][_walk(best[1])]


@compiled
def _walk(after: Ints) -> Ints:
    order = np.zeros(len(after), np.int64)
    for i in range(1, len(after)):
        order[i] = after[order[i - 1]]
    return order


@compiled
def _distance(points: Floats, a: int, b: int) -> float:
    dx, dy, dz = points[a, 0] - points[b, 0], points[a, 1] - points[b, 1], points[a, 2] - points[b, 2]
    return math.sqrt(dx * dx + dy * dy + dz * dz)


@compiled
def _best_choice(points: Floats, start: Ints, order: Ints) -> Ints:
    m = len(order)
    most = 0
    for t in range(m):
        most = max(most, start[t + 1] - start[t])
    cost, previous = np.empty((m, most)), np.zeros((m, most), np.int64)
    best, least = np.empty(m, np.int64), math.inf
    for first in range(start[order[0]], start[order[0] + 1]):
        cost[0, :] = math.inf
        cost[0, first - start[order[0]]] = 0.0
        for i in range(1, m):
            here, there = start[order[i - 1]], start[order[i]]
            for b in range(start[order[i] + 1] - there):
                cost[i, b] = math.inf
                for a in range(start[order[i - 1] + 1] - here):
                    c = cost[i - 1, a] + _distance(points, here + a, there + b)
                    if c < cost[i, b]:
                        cost[i, b], previous[i, b] = c, a
        there, last, total = start[order[m - 1]], 0, math.inf
        for b in range(start[order[m - 1] + 1] - there):
            c = cost[m - 1, b] + _distance(points, there + b, first)
            if c < total:
                last, total = b, c
        if total < least:
            least = total
            for i in range(m - 1, -1, -1):
                best[i] = start[order[i]] + last
                last = previous[i, last]
    return best


@compiled
def _put_back(
    points: Floats,
    start: Ints,
    near: Ints,
    chosen: Ints,
    after: Ints,
    before: Ints,
    best_chosen: Ints,
    best_after: Ints,
    best_before: Ints,
    excess: float,
    warmth: float,
    rng: np.random.Generator,
    begin: int,
    end: int,
    rounds: int,
) -> float:
    """Some rounds; `excess` is what the tour costs more than the best one, which is returned too."""
    m = len(after)
    old_chosen, old_after, old_before = chosen.copy(), after.copy(), before.copy()
    inside = np.ones(m, np.bool_)
    out = np.empty(MOST_OUT, np.int64)
    for turn in range(begin, end):
        centre = int(rng.random() * m)
        count = 1 + int(rng.random() * min(MOST_OUT, m - 3, near.shape[1]))
        change = 0.0
        for i in range(count):
            t = near[centre, i]
            out[i] = t
            inside[t] = False
            a, b = before[t], after[t]
            change += _distance(points, chosen[a], chosen[b])
            change -= _distance(points, chosen[a], chosen[t]) + _distance(points, chosen[t], chosen[b])
            after[a], before[b] = b, a
        for i in range(count - 1, -1, -1):
            j = int(rng.random() * (i + 1))
            t = out[j]
            out[j] = out[i]
            change += _insert(points, start, near, chosen, after, before, inside, t, rng)
            inside[t] = True
        allowed = -warmth * (1.0 - turn / rounds) * math.log(1.0 - rng.random())
        if change <= allowed:
            excess += change
            old_chosen[:], old_after[:], old_before[:] = chosen, after, before
            if excess < 0.0:
                excess = 0.0
                best_chosen[:], best_after[:], best_before[:] = chosen, after, before
        else:
            chosen[:], after[:], before[:] = old_chosen, old_after, old_before
    return excess


@compiled
def _insert(
    points: Floats,
    start: Ints,
    near: Ints,
    chosen: Ints,
    after: Ints,
    before: Ints,
    inside: np.ndarray[tuple[int, ...], np.dtype[np.bool_]],
    t: int,
    rng: np.random.Generator,
) -> float:
    """Put a target back at the place and with the candidate that cost least, next to a near one; returns the cost."""
    least, place, candidate = math.inf, -1, -1
    for i in range(1, near.shape[1]):
        other = near[t, i]
        if not inside[other] or (place >= 0 and rng.random() < LEFT_OUT):
            continue
        for a in (before[other], other):
            b = after[a]
            saved = _distance(points, chosen[a], chosen[b])
            for c in range(start[t], start[t + 1]):
                cost = _distance(points, chosen[a], c) + _distance(points, c, chosen[b]) - saved
                if cost < least:
                    least, place, candidate = cost, a, c
    if place < 0:
        for a in range(len(after)):
            if not inside[a]:
                continue
            b = after[a]
            saved = _distance(points, chosen[a], chosen[b])
            for c in range(start[t], start[t + 1]):
                cost = _distance(points, chosen[a], c) + _distance(points, c, chosen[b]) - saved
                if cost < least:
                    least, place, candidate = cost, a, c
    b = after[place]
    chosen[t], before[t], after[t] = candidate, place, b
    after[place] = t
    before[b] = t
    return least
