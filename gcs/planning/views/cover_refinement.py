"""Large neighbourhood search for smaller covers: take out a few sets that overlap, put in others, keep what is as good.

With one set fewer than the best cover so far, the search looks for sets that cover as much as is wanted all the same.
In each step up to four sets are taken out, a random one and such as share elements with it, and as many put in
greedily; sets that have just been taken out stay out for a few steps. A step that leaves more uncovered is undone, but
for some that leave little more, the fewer the longer the search goes on (simulated annealing). When enough is covered
there is a new best cover, and one set is dropped. Gains of all sets are kept up to date element by element. (Ruin and
recreate: Schrimpf et al. 2000.)
"""

from __future__ import annotations

import math
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from gcs.planning.numerics.compiled import compiled
from gcs.planning.numerics.worker_threads import in_threads
from gcs.planning.views.cover_problem import without_twins
from gcs.planning.views.set_cover import set_weights

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

SEARCHES = 2
"""Searches with different random numbers; the smallest cover counts."""

MOST_OUT = 4
"""Sets that are taken out in a step, at most."""

PROBES = 4
"""Random elements that are looked at, for each of them, to find overlapping sets."""

LONGEST_STAY = 10
"""For how many steps, at most, a set that was taken out stays out."""

WARMTH = 3.0
"""Weight that a step may leave uncovered in addition with a chance of 1/e; at first, falling to nothing."""

WORK_BETWEEN_POLLS = 5_000_000

Ints = np.ndarray[tuple[int, ...], np.dtype[np.int64]]
ShortInts = np.ndarray[tuple[int, ...], np.dtype[np.int32]]


class _Problem(NamedTuple):
    """Sets and elements, both ways round.

    Attributes:
        starts: where each set's elements begin in `members`, shape (S + 1,).
        members: element numbers, set after set.
        weights: how much each element counts, shape (E,).
        by_element: where each element's sets begin in `sets`, shape (E + 1,).
        sets: set numbers, element after element.
        preference: decides between sets of equal gain, shape (S,).
        spare: weight that may stay uncovered.
    """

    starts: NDArray[np.int64]
    members: NDArray[np.int32]
    weights: NDArray[np.int64]
    by_element: NDArray[np.int64]
    sets: NDArray[np.int32]
    preference: NDArray[np.float64]
    spare: int


class _State(NamedTuple):
    """Where a search is.

    Attributes:
        times: how many of the sets that are in hold each element, shape (E,).
        gain: what each set that is out would add, and what each that is in covers alone, shape (S,).
        place: where in `current` each set is, -1 for those that are out, shape (S,).
        until: the step until which each set stays out, shape (S,).
        current: the sets that are in, shape (S,).
        best: those of the smallest cover, shape (S,).
        numbers: how many sets are in; how many the best cover has; uncovered weight; steps; random numbers' state.
    """

    times: NDArray[np.int32]
    gain: NDArray[np.int64]
    place: NDArray[np.int64]
    until: NDArray[np.int64]
    current: NDArray[np.int64]
    best: NDArray[np.int64]
    numbers: NDArray[np.int64]


INSIDE, BEST, UNCOVERED, STEPS, RANDOM = range(5)

RANDOM_STEPS = 1_000_000


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
        preference: decides between sets that add the same, shape (S,).
        poll: called now and then; may raise to stop the search.

    Returns:
        Sets that cover at least `wanted`, at most as many as were given.
    """
    starts, members, weights = without_twins(starts, members, weights)
    by_element, sets = _transposed(starts, members, len(weights))
    preferred = np.ones(len(starts) - 1) if preference is None else preference
    problem = _Problem(starts, members, weights, by_element, sets, preferred, int(weights.sum()) - wanted)
    searches = [_begun(problem, chosen, int(seed)) for seed in rng.integers(1, 2**62, SEARCHES)]

    pieces = math.ceil(work / WORK_BETWEEN_POLLS)
    for piece in range(pieces):
        warmth = WARMTH * (1 - piece / pieces)
        in_threads(partial(_search, problem, most=WORK_BETWEEN_POLLS, warmth=warmth), searches)
        if poll is not None:
            poll()
    best = min(searches, key=lambda state: int(state.numbers[BEST]))
    return best.best[: best.numbers[BEST]].copy()


def _begun(problem: _Problem, chosen: NDArray[np.int64], seed: int) -> _State:
    sets, elements = len(problem.starts) - 1, len(problem.weights)
    state = _State(
        times=np.zeros(elements, np.int32),
        gain=set_weights(problem.starts, problem.members, problem.weights),
        place=np.full(sets, -1, np.int64),
        until=np.zeros(sets, np.int64),
        current=np.zeros(sets, np.int64),
        best=np.zeros(sets, np.int64),
        numbers=np.array([0, len(chosen), problem.weights.sum(), 0, seed], dtype=np.int64),
    )
    state.best[: len(chosen)] = chosen
    _put_all_in(problem, state, chosen)
    return state


@compiled
def _transposed(starts: Ints, members: ShortInts, elements: int) -> tuple[Ints, ShortInts]:
    """For every element the sets that hold it: where they begin, shape (elements + 1,), and their numbers."""
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
    state.place[s] = state.numbers[INSIDE]
    state.current[state.numbers[INSIDE]] = s
    state.numbers[INSIDE] += 1
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
                if state.place[other] >= 0 and other != s:
                    state.gain[other] -= weight
                    break
            work += (end - begin) // 2
    state.gain[s] = alone
    state.numbers[UNCOVERED] -= alone
    return work


@compiled
def _take_out(problem: _Problem, state: _State, s: int) -> int:
    """Take out a set; how many gains were updated."""
    state.numbers[INSIDE] -= 1
    last = state.current[state.numbers[INSIDE]]
    state.current[state.place[s]] = last
    state.place[last] = state.place[s]
    state.place[s] = -1
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
                if state.place[other] >= 0:
                    state.gain[other] += weight
                    break
            work += (end - begin) // 2
    state.gain[s] = lost
    state.numbers[UNCOVERED] += lost
    return work


@compiled
def _put_all_in(problem: _Problem, state: _State, chosen: Ints) -> None:
    for s in chosen:
        _put_in(problem, state, s)


@compiled
def _worth_keeping(state: _State, worse: int, warmth: float) -> bool:
    """Whether a step that leaves so much more uncovered is kept."""
    return worse <= 0 or worse < -warmth * math.log((1 + _random_below(state, RANDOM_STEPS)) / RANDOM_STEPS)


@compiled
def _random_below(state: _State, limit: int) -> int:
    """A random number from 0 to limit - 1 (xorshift)."""
    x = state.numbers[RANDOM]
    x ^= x << 13
    x ^= (x >> 7) & 0x1FFFFFFFFFFFFFF
    x ^= x << 17
    state.numbers[RANDOM] = x
    return int((x >> 11) & 0xFFFFFFFF) % limit


@compiled
def _most_added(problem: _Problem, state: _State) -> int:
    """The set that adds most of those that may be put in; -1 when none adds anything."""
    chosen = -1
    most = 0
    ties = 1
    for s in range(problem.preference.shape[0]):
        gain = state.gain[s]
        if gain < most or gain == 0 or state.place[s] >= 0 or state.until[s] > state.numbers[STEPS]:
            continue
        if gain > most or problem.preference[s] > problem.preference[chosen]:
            chosen, most, ties = s, gain, 1
        elif problem.preference[s] == problem.preference[chosen]:
            ties += 1
            if _random_below(state, ties) == 0:
                chosen = s
    return chosen


@compiled
def _least_missed(state: _State) -> int:
    """The set that covers least alone."""
    chosen = state.current[0]
    for n in range(state.numbers[INSIDE]):
        if state.gain[state.current[n]] < state.gain[chosen]:
            chosen = state.current[n]
    return int(chosen)


@compiled
def _ruin(problem: _Problem, state: _State, out: Ints) -> tuple[int, int]:
    """Take out a random set and some that overlap with it; how many, and how many gains were updated."""
    wanted = 1 + _random_below(state, min(MOST_OUT, state.numbers[INSIDE]))
    first = state.current[_random_below(state, state.numbers[INSIDE])]
    out[0] = first
    count = 1
    work = _take_out(problem, state, first)
    size = problem.starts[first + 1] - problem.starts[first]
    for _ in range(PROBES * wanted):
        if count == wanted or size == 0:
            break
        e = problem.members[problem.starts[first] + _random_below(state, size)]
        begin, sets = problem.by_element[e], problem.by_element[e + 1] - problem.by_element[e]
        shift = _random_below(state, sets)
        for k in range(sets):
            s = problem.sets[begin + (k + shift) % sets]
            if state.place[s] >= 0:
                out[count] = s
                count += 1
                work += _take_out(problem, state, s)
                break
    for k in range(count):
        state.until[out[k]] = state.numbers[STEPS] + 1 + _random_below(state, LONGEST_STAY)
    return count, work


@compiled
def _search(problem: _Problem, state: _State, most: int, warmth: float) -> None:
    """Go on for `most` updates of a gain."""
    out = np.empty(MOST_OUT, np.int64)
    put = np.empty(MOST_OUT, np.int64)
    work = 0
    while work < most:
        while state.numbers[UNCOVERED] <= problem.spare and state.numbers[INSIDE] > 0:
            count = state.numbers[INSIDE]
            if count <= state.numbers[BEST]:
                state.best[:count] = state.current[:count]
                state.numbers[BEST] = count
            work += _take_out(problem, state, _least_missed(state))
        if state.numbers[INSIDE] == 0:
            break
        uncovered = state.numbers[UNCOVERED]
        taken, updates = _ruin(problem, state, out)
        work += updates
        added = 0
        while added < taken:
            s = _most_added(problem, state)
            work += problem.preference.shape[0]
            if s < 0:
                break
            put[added] = s
            added += 1
            work += _put_in(problem, state, s)
        if added < taken or not _worth_keeping(state, state.numbers[UNCOVERED] - uncovered, warmth):
            for k in range(added):
                work += _take_out(problem, state, put[k])
            for k in range(taken):
                work += _put_in(problem, state, out[k])
        state.numbers[STEPS] += 1
