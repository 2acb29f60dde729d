"""Prices of targets: what proves that a cover needs many sets, found by a first-order method.

Give every target a price so that no set's targets cost more than 1 together. Whoever covers targets of weight W with n
sets has bought, at no more than 1 a set, targets that cost at least as much as the cheapest ones of weight W: so n is
at least that.
Any prices will do; the best ones are the dual solution of the linear relaxation

    min sum x_c   such that   sum of x_c over the sets of t >= y_t,   sum w_t y_t >= W,   x >= 0,   0 <= y <= 1

and are approached by the primal-dual hybrid gradient method (Chambolle and Pock 2011, with the diagonal step sizes of
Pock and Chambolle 2011, restarts from the average and the balance of step sizes of Applegate et al. 2021).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from gcs.planning.numerics.compiled import compiled

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

NEAR = 0.8
"""Sets whose targets cost less than this are left out of the iterations until the next round."""

SLOW, SLOW_ROUNDS = 0.7, 3
"""It hardly gets any further when so many rounds leave more than this of the gap."""

FIRST_BALANCE = 4.0
ROUNDING = 1e-12
HAIR = 1e-9
BISECTIONS = 50
MOST_SCALE = 1e6
RAISED = 1.5
"""Prices are raised up to this many times the dearest that counts."""


@dataclass(frozen=True, eq=False)
class Incidence:
    """Which set holds which target, in both directions, and how much each target counts.

    Attributes:
        starts: where each set's targets begin in `members`, shape (C + 1,).
        members: targets of each set, shape (Z,).
        set_starts: where each target's sets begin in `sets`, shape (T + 1,).
        sets: sets of each target, shape (Z,).
        weights: of the targets, positive, shape (T,).
    """

    starts: NDArray[np.int64]
    members: NDArray[np.int32]
    set_starts: NDArray[np.int64]
    sets: NDArray[np.int32]
    weights: NDArray[np.float64]

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


def incidence(starts: NDArray[np.int64], members: NDArray[np.int32], weights: NDArray[np.float64]) -> Incidence:
    """Both directions of a membership that is given by its sets."""
    counts = np.bincount(members, minlength=len(weights))
    set_starts = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    sets = np.empty(len(members), dtype=np.int32)
    _transpose(starts, members, set_starts[:-1].copy(), sets)
    return Incidence(starts, members, set_starts, sets, weights)


def proven_bound(problem: Incidence, prices: NDArray[np.float64], wanted: float) -> float:
    """What feasible prices prove: the cost of the cheapest weight that is wanted, less what rounding may have added."""
    if wanted <= 0:
        return 0.0
    order, last = _cheapest(problem, prices, wanted)
    whole, part = order[:last], order[last]
    rest = wanted - float(problem.weights[whole].sum())
    return (float(prices[whole].sum()) + rest * float(prices[part] / problem.weights[part])) * (1 - ROUNDING)


def _cheapest(problem: Incidence, prices: NDArray[np.float64], wanted: float) -> tuple[NDArray[np.int64], int]:
    """Targets by their price for a unit of weight, and which of these completes the weight that is wanted."""
    order = np.argsort(prices / problem.weights, kind="stable")
    reached = np.cumsum(problem.weights[order])
    return order, min(int(np.searchsorted(reached, wanted - HAIR)), len(order) - 1)


def feasible_prices(problem: Incidence, prices: NDArray[np.float64], wanted: float) -> NDArray[np.float64]:
    """Prices near the given ones that no set's targets exceed 1 with.

    A target's price is divided by the largest cost over 1 of its sets: that is enough for each of them. Then prices
    that are too low to matter are raised where all sets of the target have room left.

    Args:
        problem: the membership.
        prices: any, shape (T,), not negative.
        wanted: weight that has to be covered.
    """
    costs = problem.costs(prices)
    result = prices.copy()
    _lower(problem.set_starts, problem.sets, costs, result)
    costs = problem.costs(result)
    order, last = _cheapest(problem, result, wanted)
    highest = RAISED * float(result[order[last]] / problem.weights[order[last]])
    _raise(problem.set_starts, problem.sets, order, highest * problem.weights, costs, result)
    return result / max(1.0, float(problem.costs(result).max(initial=0.0)))


def relaxed_views(problem: Incidence, x: NDArray[np.float64], wanted: float) -> float:
    """Views of the solution of the relaxation that some parts of views are a multiple of: an upper bound of its value.

    Args:
        problem: the membership.
        x: parts of views, not negative, shape (C,).
        wanted: weight that has to be covered.
    """
    covered = np.zeros(problem.targets)
    _cover(problem.starts, problem.members, x, covered)
    return _scale(covered, problem.weights, wanted - HAIR) * float(x.sum())


@dataclass(frozen=True, eq=False)
class PricedCover:
    """Near-optimal prices and parts of views.

    Attributes:
        prices: feasible, shape (T,).
        x: parts of views that go with them, shape (C,).
        bound: what the prices prove.
        relaxation: value of a solution of the relaxation; never below the bound.
    """

    prices: NDArray[np.float64]
    x: NDArray[np.float64]
    bound: float
    relaxation: float

    @property
    def gap(self) -> float:
        """Share of the relaxation's value that is not proven."""
        return 1 - self.bound / self.relaxation


def approach_prices(
    problem: Incidence,
    wanted: float,
    first: NDArray[np.int64],
    keep_on: Callable[[], bool],
    *,
    gap: float,
    patient: Callable[[PricedCover], bool],
) -> PricedCover:
    """Approach the best prices.

    Args:
        problem: the membership; every target is in a set.
        wanted: weight that has to be covered, over 0.
        first: sets of a known cover.
        keep_on: asked every few iterations; False ends the search.
        gap: it also ends when what is not proven is at most this share.
        patient: asked with what is known, when it hardly gets any further, whether to go on all the same.
    """
    degree = np.diff(problem.set_starts).astype(np.float64)
    sizes = np.diff(problem.starts).astype(np.float64)
    start = 1.0 / np.maximum(degree, 1.0)
    prices = feasible_prices(problem, start / float(problem.costs(start).max(initial=1e-300)), wanted)
    x = np.zeros(problem.set_count)
    x[first] = 1.0
    best = PricedCover(prices, x, proven_bound(problem, prices, wanted), relaxed_views(problem, x, wanted))
    y = np.full(problem.targets, wanted / float(problem.weights.sum()))
    costs, balance, length = problem.costs(prices), FIRST_BALANCE, float(FIRST_ROUND)
    gaps = [best.gap]
    while best.gap > gap:
        slow = len(gaps) > SLOW_ROUNDS and gaps[-1] > SLOW * gaps[-1 - SLOW_ROUNDS]
        if slow and not patient(best):
            return best
        threshold = NEAR * min(1.0, float(costs.max()))
        active = np.flatnonzero((costs > threshold) | (x > 0)) if len(gaps) > 1 else np.arange(problem.set_count)
        starts, members = problem.only(active)
        active_degree = np.bincount(members, minlength=problem.targets).astype(np.float64)
        last = _State(x[active], y.copy(), prices.copy())
        mean = _State(np.zeros(len(active)), np.zeros(len(y)), np.zeros(len(y)))
        x_step, price_step = balance / np.maximum(sizes[active], 1.0), 1.0 / (balance * (active_degree + 1.0))
        steps = math.ceil(length)
        for done in range(0, steps, CHUNK):
            if not keep_on():
                return best
            count = min(CHUNK, steps - done)
            _iterate(starts, members, problem.weights, x_step, balance, price_step, float(wanted), count, *last, *mean)
        mean = _State(mean.x / steps, mean.y / steps, mean.prices / steps)
        balance = _balanced(balance, mean, _State(x[active], y, prices), sizes[active], active_degree)
        x = np.zeros(problem.set_count)
        x[active], y, prices = mean
        costs = problem.costs(prices)
        best = _better(best, problem, prices, x, wanted)
        latest = np.zeros(problem.set_count)
        latest[active] = last.x
        best = _better(best, problem, last.prices, latest, wanted)
        gaps.append(best.gap)
        length = min(length * ROUND_GROWTH, MOST_ROUND)
    return best


def _better(
    best: PricedCover, problem: Incidence, prices: NDArray[np.float64], x: NDArray[np.float64], wanted: float
) -> PricedCover:
    """The better prices and the better parts of views of what is known and what was found."""
    repaired = feasible_prices(problem, prices, wanted)
    bound, relaxation = proven_bound(problem, repaired, wanted), relaxed_views(problem, x, wanted)
    if bound > best.bound:
        best = replace(best, prices=repaired, bound=bound)
    if relaxation < best.relaxation:
        best = replace(best, x=x, relaxation=relaxation)
    return best


def _balanced(
    balance: float, new: _State, old: _State, sizes: NDArray[np.float64], degree: NDArray[np.float64]
) -> float:
    """Steps of both sides in the ratio in which both sides moved, half way there."""
    moved = math.sqrt(float((sizes * (new.x - old.x) ** 2).sum() + ((new.y - old.y) ** 2).sum()))
    priced = math.sqrt(float(((degree + 1.0) * (new.prices - old.prices) ** 2).sum()))
    return math.sqrt(balance * moved / priced) if moved > 0 and priced > 0 else balance


class _State(NamedTuple):
    x: NDArray[np.float64]
    y: NDArray[np.float64]
    prices: NDArray[np.float64]


@compiled
def _costs(starts: Longs, members: Ints, prices: Floats, result: Floats) -> None:
    for c in range(len(starts) - 1):
        total = 0.0
        for k in range(starts[c], starts[c + 1]):
            total += prices[members[k]]
        result[c] = total


@compiled
def _cover(starts: Longs, members: Ints, x: Floats, covered: Floats) -> None:
    for c in range(len(starts) - 1):
        if x[c] > 0.0:
            for k in range(starts[c], starts[c + 1]):
                covered[members[k]] += x[c]


@compiled
def _scale(covered: Floats, weights: Floats, wanted: float) -> float:
    """The least factor on how much is covered, none counted over 1, that covers the weight; infinite without one."""
    low, high = 0.0, 1.0
    while _weight(covered, weights, high) < wanted:
        low, high = high, 2.0 * high
        if high > MOST_SCALE:
            return math.inf
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        if _weight(covered, weights, middle) < wanted:
            low = middle
        else:
            high = middle
    return high


@compiled
def _weight(covered: Floats, weights: Floats, factor: float) -> float:
    total = 0.0
    for t in range(len(covered)):
        total += weights[t] * min(factor * covered[t], 1.0)
    return total


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
def _raise(set_starts: Longs, sets: Ints, order: Longs, highest: Floats, costs: Floats, prices: Floats) -> None:
    for i in range(len(order)):
        t = order[i]
        room = highest[t] - prices[t]
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
    weights: Floats,
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
        lift = _lift(ahead, weights, wanted, lift)
        for t in range(targets):
            new = min(max(ahead[t] + lift * weights[t], 0.0), 1.0)
            prices[t] = max(prices[t] + price_step[t] * (2.0 * new - y[t] - covered[t]), 0.0)
            y[t] = new
            y_sum[t] += new
            price_sum[t] += prices[t]


@compiled
def _lift(values: Floats, weights: Floats, wanted: float, guess: float) -> float:
    """How much to add for a unit of weight, not less than 0, so that values clipped to 0..1 weigh `wanted` in sum."""
    low, high = 0.0, 0.0
    for t in range(len(values)):
        high = max(high, (1.0 - values[t]) / weights[t])
    lift = min(guess, high)
    for _ in range(60):
        total, slope = 0.0, 0.0
        for t in range(len(values)):
            v = values[t] + lift * weights[t]
            if v >= 1.0:
                total += weights[t]
            elif v > 0.0:
                total += weights[t] * v
                slope += weights[t] * weights[t]
        missing = wanted - total
        if abs(missing) <= 1e-9 * wanted or (lift == 0.0 and missing <= 0.0):
            break
        if missing > 0.0:
            low = lift
        else:
            high = lift
        lift = lift + missing / slope if slope > 0.0 else (low + high) / 2
        if not low < lift < high:
            lift = (low + high) / 2
        if high - low < 1e-14:
            break
    return lift
