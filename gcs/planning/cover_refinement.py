"""Tabu search for smaller covers: with one set fewer, swap sets until as much is covered again.

With the number of sets fixed this is the problem of maximum coverage. Each step puts in the set that adds most and
takes out the one that is missed least; what was moved stays where it is for a while, so that the search leaves the
hollows that greedy choice and plain exchange end in. Gains and losses of all sets are kept up to date element by
element.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from gcs.planning.compiled import compiled
from gcs.planning.set_cover import set_weights
from gcs.planning.worker_threads import in_threads

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

SEARCHES = 2
"""Searches with different random numbers; the smallest cover counts."""

SHORTEST_STAY, LONGEST_STAY = 20, 60
"""For how many steps a set that was moved stays where it is: at random between these."""

WORK_BETWEEN_POLLS = 20_000_000

Ints = np.ndarray[tuple[int, ...], np.dtype[np.int64]]
ShortInts = np.ndarray[tuple[int, ...], np.dtype[np.int32]]
SingleFloats = np.ndarray[tuple[int, ...], np.dtype[np.float32]]
Marks = np.ndarray[tuple[int, ...], np.dtype[np.bool_]]


def refine_cover(
    starts: NDArray[np.int64],
    members: NDArray[np.int32],
    weights: NDArray[np.int64],
    chosen: NDArray[np.int64],
    wanted: int,
    work: float,
    rng: np.random.Generator,
    *,
    preference: NDArray[np.float64] | None = None,
    poll: Callable[[], None] | None = None,
) -> NDArray[np.int64]:
    """Look for a cover by fewer sets.

    Args:
        starts: where each set's elements begin in `members`, shape (S + 1,).
        members: element numbers, set after set, without repetition within one.
        weights: how much each element counts, positive, shape (E,).
        chosen: sets that cover at least the weight `wanted`.
        wanted: the weight that has to stay covered.
        work: how long each search goes on, in updates of a gain (some hundred million a second).
        rng: the source of randomness.
        preference: factor on what each set adds, at most 1, shape (S,); 1 when left out.
        poll: called now and then; may raise to stop the search.

    Returns:
        Sets that cover at least `wanted`, at most as many as were given.
    """
    by_element, sets = _transposed(starts, members, len(weights))
    factor = np.ones(len(starts) - 1) if preference is None else preference
    spare = int(weights.sum()) - wanted
    problem = _Problem(starts, members, weights, by_element, sets, factor.astype(np.float32), spare)
    searches = [_Search(problem, chosen, int(seed)) for seed in rng.integers(1, 2**62, SEARCHES)]
    for _ in range(math.ceil(work / WORK_BETWEEN_POLLS)):
        in_threads(_Search.go_on, searches)
        if poll is not None:
            poll()
    return min((s.best for s in searches), key=len)


class _Problem(NamedTuple):
    """Sets and elements, both ways round, the elements' weights, a factor on each set's gain, and the weight that may
    stay uncovered.
    """

    starts: NDArray[np.int64]
    members: NDArray[np.int32]
    weights: NDArray[np.int64]
    by_element: NDArray[np.int64]
    sets: NDArray[np.int32]
    factor: NDArray[np.float32]
    spare: int


class _State(NamedTuple):
    """Where a search is.

    Attributes:
        times: how many of the sets that are in hold each element, shape (E,).
        gain: what each set that is out would add, and what each that is in covers alone, shape (S,).
        inside: whether each set is in, shape (S,).
        until: the step until which each set stays where it is, shape (S,).
        current: the sets that are in, the first `numbers[0]` of them, shape (S,).
        best: those of the smallest cover, the first `numbers[1]` of them, shape (S,).
        numbers: how many sets are in; how many the best cover has; uncovered weight; the least of it with this many
            sets; steps; state of the random numbers.
    """

    times: NDArray[np.int32]
    gain: NDArray[np.int64]
    inside: NDArray[np.bool_]
    until: NDArray[np.int64]
    current: NDArray[np.int64]
    best: NDArray[np.int64]
    numbers: NDArray[np.int64]


class _Search:
    """One search, some way at a time."""

    def __init__(self, problem: _Problem, chosen: NDArray[np.int64], seed: int) -> None:
        sets, elements, total = len(problem.starts) - 1, len(problem.weights), int(problem.weights.sum())
        self._problem = problem
        self._state = _State(
            np.zeros(elements, np.int32),
            set_weights(problem.starts, problem.members, problem.weights),
            np.zeros(sets, np.bool_),
            np.zeros(sets, np.int64),
            np.zeros(sets, np.int64),
            np.zeros(sets, np.int64),
            np.array([0, len(chosen), total, total, 0, seed], dtype=np.int64),
        )
        self._state.best[: len(chosen)] = chosen
        _begin(problem, self._state, chosen)

    def go_on(self) -> None:
        _swap(self._problem, self._state, WORK_BETWEEN_POLLS)

    @property
    def best(self) -> NDArray[np.int64]:
        return self._state.best[: self._state.numbers[1]].copy()


@compiled
def _transposed(starts: Ints, members: ShortInts, elements: int) -> tuple[Ints, ShortInts]:
    begin = np.zeros(elements + 1, np.int64)
    for e in members:
        begin[e + 1] += 1
    for e in range(elements):
        begin[e + 1] += begin[e]
    fill = begin[:-1].copy()
    sets = np.empty(members.shape[0], np.int32)
    for s in range(starts.shape[0] - 1):
        for m in range(starts[s], starts[s + 1]):
            e = members[m]
            sets[fill[e]] = s
            fill[e] += 1
    return begin, sets


@compiled
def _put_in(problem: _Problem, state: _State, s: int) -> int:
    """Put a set in; how many gains were updated."""
    alone = 0
    work = 0
    state.inside[s] = True
    state.current[state.numbers[0]] = s
    state.numbers[0] += 1
    for m in range(problem.starts[s], problem.starts[s + 1]):
        e = problem.members[m]
        state.times[e] += 1
        begin, end, weight = problem.by_element[e], problem.by_element[e + 1], problem.weights[e]
        if state.times[e] == 1:
            alone += weight
            for k in range(begin, end):
                state.gain[problem.sets[k]] -= weight
            work += end - begin
        elif state.times[e] == 2:
            for k in range(begin, end):
                other = problem.sets[k]
                if state.inside[other] and other != s:
                    state.gain[other] -= weight
                    break
            work += (end - begin) // 2
    state.gain[s] = alone
    state.numbers[2] -= alone
    return work


@compiled
def _take_out(problem: _Problem, state: _State, place: int) -> int:
    """Take out the set at a place of `current`; how many gains were updated."""
    s = state.current[place]
    state.numbers[0] -= 1
    state.current[place] = state.current[state.numbers[0]]
    state.inside[s] = False
    lost = 0
    work = 0
    for m in range(problem.starts[s], problem.starts[s + 1]):
        e = problem.members[m]
        state.times[e] -= 1
        begin, end, weight = problem.by_element[e], problem.by_element[e + 1], problem.weights[e]
        if state.times[e] == 0:
            lost += weight
            for k in range(begin, end):
                state.gain[problem.sets[k]] += weight
            work += end - begin
        elif state.times[e] == 1:
            for k in range(begin, end):
                other = problem.sets[k]
                if state.inside[other]:
                    state.gain[other] += weight
                    break
            work += (end - begin) // 2
    state.gain[s] = lost
    state.numbers[2] += lost
    return work


@compiled
def _random_below(state: _State, limit: int) -> int:
    """A random number from 0 to limit - 1 (xorshift)."""
    x = state.numbers[5]
    x ^= x << 13
    x ^= (x >> 7) & 0x1FFFFFFFFFFFFFF
    x ^= x << 17
    state.numbers[5] = x
    return int((x >> 11) & 0xFFFFFFFF) % limit


@compiled
def _least_missed(problem: _Problem, state: _State, step: int, last: int) -> int:
    """Place in `current`, before `last`, of the set that may be moved and is missed least; -1 when there is none."""
    place = -1
    least = np.float32(np.inf)
    ties = 1
    for n in range(last):
        s = state.current[n]
        if state.until[s] > step:
            continue
        loss = state.gain[s] * problem.factor[s]
        if loss < least:
            place, least, ties = n, loss, 1
        elif loss == least:
            ties += 1
            if _random_below(state, ties) == 0:
                place = n
    return place


@compiled
def _most_added(problem: _Problem, state: _State, step: int) -> int:
    """The set that adds most: one that may be moved, or one that leaves less uncovered than ever; -1 when none adds."""
    chosen = -1
    most = np.float32(0.0)
    ties = 1
    for s in range(problem.factor.shape[0]):
        added = state.gain[s] * problem.factor[s]
        if added < most or added == 0 or state.inside[s]:
            continue
        if state.until[s] > step and state.numbers[2] - state.gain[s] >= state.numbers[3]:
            continue
        if added > most:
            chosen, most, ties = s, added, 1
        else:
            ties += 1
            if _random_below(state, ties) == 0:
                chosen = s
    return chosen


@compiled
def _begin(problem: _Problem, state: _State, chosen: Ints) -> None:
    for s in chosen:
        _put_in(problem, state, s)


@compiled
def _swap(problem: _Problem, state: _State, most: int) -> None:
    """Go on for `most` updates of a gain."""
    work = 0
    while work < most:
        step = state.numbers[4]
        state.numbers[4] += 1
        while state.numbers[2] <= problem.spare and state.numbers[0] > 0:
            count = state.numbers[0]
            if count <= state.numbers[1]:
                state.best[:count] = state.current[:count]
                state.numbers[1] = count
            work += _take_out(problem, state, max(_least_missed(problem, state, step + 2 * LONGEST_STAY, count), 0))
            state.numbers[3] = np.iinfo(np.int64).max
        if state.numbers[0] == 0:
            break
        added = _most_added(problem, state, step)
        if added >= 0:
            work += _put_in(problem, state, added)
            state.until[added] = step + SHORTEST_STAY + _random_below(state, LONGEST_STAY - SHORTEST_STAY)
            last = state.numbers[0] - 1
        else:
            last = state.numbers[0]
        out = _least_missed(problem, state, step, last)
        if out < 0:
            out = _random_below(state, last) if last > 0 else 0
        moved = state.current[out]
        work += _take_out(problem, state, out) + problem.factor.shape[0]
        state.until[moved] = step + SHORTEST_STAY + _random_below(state, LONGEST_STAY - SHORTEST_STAY)
        state.numbers[3] = min(state.numbers[3], state.numbers[2])
