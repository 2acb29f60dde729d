"""Prices of targets: what proves that a cover needs many sets, found by a first-order method.

Give every target a price so that no set's targets cost more than 1 together. Whoever covers targets of weight W with n
sets has bought, at no more than 1 a set, targets that cost at least as much as the W cheapest: so n is at least that.
Any prices will do; the best ones are the dual solution of the linear relaxation

    min sum x_c   such that   sum of x_c over the sets of t >= y_t,   sum y_t >= W,   x >= 0,   0 <= y <= 1

and are approached by the primal-dual hybrid gradient method (Chambolle and Pock 2011, with the diagonal step sizes of
Pock and Chambolle 2011, restarts from the average and the balance of step sizes of Applegate et al. 2021).
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gcs.planning.compiled import compiled

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

Floats = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Longs = np.ndarray[tuple[int, ...], np.dtype[np.int64]]
Ints = np.ndarray[tuple[int, ...], np.dtype[np.int32]]

FIRST_ROUND = 60
ROUND_GROWTH = 1.3
MOST_ROUND = 400
CHUNK = 10
"""Iterations between two looks at the clock."""

NEAR = 0.6
"""Sets whose targets cost less than this are left out of the iterations until the next round."""

FIRST_BALANCE = 4.0


@dataclass(frozen=True, eq=False)
class Incidence:
    """Which set holds which target, in both directions.

    Attributes:
        starts: where each set's targets begin in `members`, shape (C + 1,).
        members: targets of each set, shape (Z,).
        set_starts: where each target's sets begin in `sets`, shape (T + 1,).
        sets: sets of each target, shape (Z,).
    """

    starts: NDArray[np.int64]
    members: NDArray[np.int32]
    set_starts: NDArray[np.int64]
    sets: NDArray[np.int32]

    @property
    def set_count(self) -> int:
        """How many sets there are."""
        return len(self.starts) - 1

    @property
    def targets(self) -> int:
        """How many targets there are."""
        return len(self.set_starts) - 1

    def costs(self, prices: NDArray[np.float64]) -> NDArray[np.float64]:
        """What the targets of each set cost together, shape (C,)."""
        result = np.empty(self.set_count)
        _costs(self.starts, self.members, prices, result)
        return result

    def only(self, chosen: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
        """`starts` and `members` of some of the sets."""
        sizes = np.diff(self.starts)[chosen]
        starts = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
        members = np.empty(int(starts[-1]), dtype=np.int32)
        _gather(self.starts, self.members, chosen, starts, members)
        return starts, members


def incidence(starts: NDArray[np.int64], members: NDArray[np.int32], targets: int) -> Incidence:
    """Both directions of a membership that is given by its sets."""
    counts = np.bincount(members, minlength=targets)
    set_starts = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    sets = np.empty(len(members), dtype=np.int32)
    _transpose(starts, members, set_starts[:-1].copy(), sets)
    return Incidence(starts, members, set_starts, sets)


def proven_bound(prices: NDArray[np.float64], wanted: int) -> float:
    """The bound that feasible prices prove: the sum of the cheapest `wanted` ones."""
    if wanted <= 0:
        return 0.0
    return float(np.partition(prices, wanted - 1)[:wanted].sum())


def feasible_prices(problem: Incidence, prices: NDArray[np.float64], wanted: int) -> NDArray[np.float64]:
    """Prices near the given ones that no set's targets exceed 1 with.

    A target's price is divided by the largest cost over 1 of its sets: that is enough for each of them. Then prices
    that are too low to matter are raised where all sets of the target have room left.

    Args:
        problem: the membership.
        prices: any, shape (T,), not negative.
        wanted: how many targets have to be covered.
    """
    costs = problem.costs(prices)
    result = prices.copy()
    _lower(problem.set_starts, problem.sets, costs, result)
    costs = problem.costs(result)
    # rounding: sums of a different order may be off by a few ulps
    highest = float(np.partition(result, wanted - 1)[wanted - 1]) if wanted > 0 else 0.0
    _raise(problem.set_starts, problem.sets, np.argsort(result, kind="stable"), 1.5 * highest, costs, result)
    return result / max(1.0, float(problem.costs(result).max(initial=0.0)))


def approach_prices(
    problem: Incidence,
    wanted: int,
    first: NDArray[np.int64],
    keep_on: Callable[[float], bool],
    *,
    rounds: int,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Approach the best prices.

    Args:
        problem: the membership; every target is in a set.
        wanted: how many targets have to be covered, over 0.
        first: sets of a known cover.
        keep_on: asked with the bound so far, at least every few iterations; False ends the search.
        rounds: how many restarts at most.

    Returns:
        Feasible prices, shape (T,), and the solution x that goes with them, shape (C,).
    """
    degree = np.diff(problem.set_starts).astype(np.float64)
    sizes = np.diff(problem.starts).astype(np.float64)
    start = 1.0 / np.maximum(degree, 1.0)
    best = feasible_prices(problem, start / float(problem.costs(start).max(initial=1e-300)), wanted)
    bound = proven_bound(best, wanted)
    x = np.zeros(problem.set_count)
    x[first] = 1.0
    y = np.full(problem.targets, wanted / problem.targets)
    prices, costs, balance = best.copy(), problem.costs(best), FIRST_BALANCE
    length = float(FIRST_ROUND)
    for round_ in range(rounds):
        active = np.flatnonzero((costs > NEAR) | (x > 0)) if round_ else np.arange(problem.set_count)
        starts, members = problem.only(active)
        active_degree = np.bincount(members, minlength=problem.targets).astype(np.float64)
        state = _State(x[active], y, prices)
        mean = _State(np.zeros(len(active)), np.zeros(len(y)), np.zeros(len(y)))
        steps = math.ceil(length)
        for done in range(0, steps, CHUNK):
            if not keep_on(bound):
                return best, x
            _iterate(
                starts,
                members,
                balance / np.maximum(sizes[active], 1.0),
                balance,
                1.0 / (balance * (active_degree + 1.0)),
                float(wanted),
                min(CHUNK, steps - done),
                state.x,
                state.y,
                state.prices,
                mean.x,
                mean.y,
                mean.prices,
            )
        for part in (mean.x, mean.y, mean.prices):
            part /= steps
        moved = math.sqrt(
            float((sizes[active] * (mean.x - x[active]) ** 2).sum() + ((mean.y - y) ** 2).sum())
        )
        priced = math.sqrt(float(((active_degree + 1.0) * (mean.prices - prices) ** 2).sum()))
        if moved > 0 and priced > 0:
            balance = math.exp(0.5 * math.log(moved / priced) + 0.5 * math.log(balance))
        x = np.zeros(problem.set_count)
        x[active], y, prices = mean.x, mean.y, mean.prices
        costs = problem.costs(prices)
        for candidate in (prices, state.prices):
            repaired = feasible_prices(problem, candidate, wanted)
            found = proven_bound(repaired, wanted)
            if found > bound:
                best, bound = repaired, found
        length = min(length * ROUND_GROWTH, MOST_ROUND)
    return best, x


@dataclass(frozen=True, eq=False)
class _State:
    x: NDArray[np.float64]
    y: NDArray[np.float64]
    prices: NDArray[np.float64]


def seconds_left(until: float) -> float:
    """Wall time (s) until a time of `time.perf_counter`, not below 0."""
    return max(until - time.perf_counter(), 0.0)


@compiled
def _costs(starts: Longs, members: Ints, prices: Floats, result: Floats) -> None:
    for c in range(len(starts) - 1):
        total = 0.0
        for k in range(starts[c], starts[c + 1]):
            total += prices[members[k]]
        result[c] = total


@compiled
def _gather(starts: Longs, members: Ints, chosen: Longs, new_starts: Longs, result: Ints) -> None:
    for i in range(len(chosen)):
        begin = starts[chosen[i]]
        for k in range(new_starts[i + 1] - new_starts[i]):
            result[new_starts[i] + k] = members[begin + k]


@compiled
def _transpose(starts: Longs, members: Ints, place: Longs, result: Ints) -> None:
    for c in range(len(starts) - 1):
        for k in range(starts[c], starts[c + 1]):
            result[place[members[k]]] = c
            place[members[k]] += 1


@compiled
def _lower(set_starts: Longs, sets: Ints, costs: Floats, prices: Floats) -> None:
    for t in range(len(prices)):
        worst = 1.0
        for k in range(set_starts[t], set_starts[t + 1]):
            worst = max(worst, costs[sets[k]])
        prices[t] /= worst


@compiled
def _raise(set_starts: Longs, sets: Ints, order: Longs, highest: float, costs: Floats, prices: Floats) -> None:
    for i in range(len(order)):
        t = order[i]
        room = highest - prices[t]
        for k in range(set_starts[t], set_starts[t + 1]):
            room = min(room, 1.0 - costs[sets[k]])
            if room <= 0.0:
                break
        if room > 0.0:
            prices[t] += room
            for k in range(set_starts[t], set_starts[t + 1]):
                costs[sets[k]] += room


@compiled
def _iterate(
    starts: Longs,
    members: Ints,
    x_step: Floats,
    y_step: float,
    price_step: Floats,
    wanted: float,
    steps: int,
    x: Floats,
    y: Floats,
    prices: Floats,
    x_sum: Floats,
    y_sum: Floats,
    price_sum: Floats,
) -> None:
    targets = len(y)
    covered = np.empty(targets)
    ahead = np.empty(targets)
    lift = 0.0
    for _ in range(steps):
        covered[:] = 0.0
        for c in range(len(starts) - 1):
            cost = 0.0
            for k in range(starts[c], starts[c + 1]):
                cost += prices[members[k]]
            new = max(x[c] + x_step[c] * (cost - 1.0), 0.0)
            reach = 2.0 * new - x[c]
            x[c] = new
            x_sum[c] += new
            if reach != 0.0:
                for k in range(starts[c], starts[c + 1]):
                    covered[members[k]] += reach
        for t in range(targets):
            ahead[t] = y[t] - y_step * prices[t]
        lift = _lift(ahead, wanted, lift)
        for t in range(targets):
            new = min(max(ahead[t] + lift, 0.0), 1.0)
            prices[t] = max(prices[t] + price_step[t] * (2.0 * new - y[t] - covered[t]), 0.0)
            y[t] = new
            y_sum[t] += new
            price_sum[t] += prices[t]


@compiled
def _lift(values: Floats, wanted: float, guess: float) -> float:
    """The smallest addition, not negative, with which values clipped to 0..1 sum up to `wanted`: Newton from a guess."""
    low, high = 0.0, 1.0 - values.min()
    lift = guess
    for _ in range(60):
        total = 0.0
        inner = 0
        for t in range(len(values)):
            v = values[t] + lift
            if v >= 1.0:
                total += 1.0
            elif v > 0.0:
                total += v
                inner += 1
        missing = wanted - total
        if abs(missing) <= 1e-9 * wanted or (lift == 0.0 and missing <= 0.0):
            break
        if missing > 0.0:
            low = lift
        else:
            high = lift
        lift = lift + missing / inner if inner > 0 else (low + high) / 2
        if not low < lift < high:
            lift = (low + high) / 2
        if high - low < 1e-14:
            break
    return lift
