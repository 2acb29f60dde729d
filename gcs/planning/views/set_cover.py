"""Greedy set cover: few sets that together hold most of what all of them hold."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gcs.planning.numerics.compiled import compiled
from gcs.planning.numerics.quaternary_heap import sift_down

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

LOOKS_BETWEEN_POLLS = 4000

Ints = np.ndarray[tuple[int, ...], np.dtype[np.int64]]
ShortInts = np.ndarray[tuple[int, ...], np.dtype[np.int32]]
Floats = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Marks = np.ndarray[tuple[int, ...], np.dtype[np.bool_]]


def greedy_cover(
    starts: NDArray[np.int64],
    members: NDArray[np.int32],
    weights: NDArray[np.int64],
    wanted: int,
    *,
    preference: NDArray[np.float64] | None = None,
    first: NDArray[np.int64] | None = None,
    poll: Callable[[], None] | None = None,
) -> NDArray[np.int64]:
    """Choose sets one by one, each time the one that adds most.

    Gains only shrink as more is covered, so a set whose stale gain is below another's fresh one need not be looked at
    (Minoux's lazy evaluation).

    Args:
        starts: where each set's elements begin in `members`, shape (S + 1,).
        members: element numbers, set after set, without repetition within one.
        weights: how much each element counts, positive, shape (E,).
        wanted: stop when this weight is covered, or all that the sets hold.
        preference: factor on each set's gain, positive, shape (S,); 1 when left out.
        first: sets that are chosen before all others.
        poll: called now and then; may raise to stop the search.

    Returns:
        Indices of the chosen sets, in the order of choice, those of `first` at the beginning.
    """
    factor = np.ones(len(starts) - 1) if preference is None else preference
    done = np.zeros(len(weights), dtype=np.bool_)
    chosen = np.empty(len(starts) - 1, dtype=np.int64)
    count = 0
    for k in () if first is None else first:
        done[members[starts[k] : starts[k + 1]]] = True
        chosen[count] = k
        count += 1
    keys = -set_weights(starts, members, weights) * factor
    sets = np.argsort(keys, kind="stable")  # sorted keys are a heap
    keys = keys[sets]
    state = np.array([count, int(weights[done].sum()), len(sets)], dtype=np.int64)
    while not _choose(starts, members, weights, wanted, factor, done, keys, sets, state, chosen, LOOKS_BETWEEN_POLLS):
        if poll is not None:
            poll()
    return chosen[: state[0]].copy()


def without_needless(
    starts: NDArray[np.int64],
    members: NDArray[np.int32],
    weights: NDArray[np.int64],
    chosen: NDArray[np.int64],
    wanted: int,
) -> NDArray[np.int64]:
    """Drop sets, the smallest contribution first, while as much as is wanted stays covered.

    Args:
        starts: as in `greedy_cover`.
        members: as in `greedy_cover`.
        weights: as in `greedy_cover`.
        chosen: indices of the sets to begin with.
        wanted: the weight that stays covered; when less is, what is covered does.

    Returns:
        The sets that are left, in the same order.
    """
    return _drop(starts, members, weights, chosen, wanted)


@compiled
def _choose(
    starts: Ints,
    members: ShortInts,
    weights: Ints,
    wanted: int,
    factor: Floats,
    done: Marks,
    keys: Floats,
    sets: Ints,
    state: Ints,
    chosen: Ints,
    most: int,
) -> bool:
    """Look at `most` sets at the head of the heap; whether the search is over."""
    count, covered, size = state[0], state[1], state[2]
    looks = 0
    while covered < wanted and size > 0 and looks < most:
        looks += 1
        k = sets[0]
        gain = 0
        for e in range(starts[k], starts[k + 1]):
            if not done[members[e]]:
                gain += weights[members[e]]
        key = -gain * factor[k]
        next_key = np.inf
        for child in range(1, min(5, size)):
            next_key = min(next_key, keys[child])
        if gain > 0 and key > next_key:
            sift_down(keys, sets, size, key, k)
            continue
        size -= 1
        sift_down(keys, sets, size, keys[size], sets[size])
        if gain > 0:
            chosen[count] = k
            count += 1
            covered += gain
            for e in range(starts[k], starts[k + 1]):
                done[members[e]] = True
    state[0], state[1], state[2] = count, covered, size
    return bool(covered >= wanted or size == 0)


@compiled
def set_weights(starts: Ints, members: ShortInts, weights: Ints) -> Ints:
    """Weight of all elements of each set, shape (S,)."""
    result = np.zeros(starts.shape[0] - 1, np.int64)
    for k in range(starts.shape[0] - 1):
        for e in range(starts[k], starts[k + 1]):
            result[k] += weights[members[e]]
    return result


@compiled
def _drop(starts: Ints, members: ShortInts, weights: Ints, chosen: Ints, wanted: int) -> Ints:
    times = np.zeros(weights.shape[0], np.int32)
    covered = 0
    for k in chosen:
        for e in range(starts[k], starts[k + 1]):
            times[members[e]] += 1
            if times[members[e]] == 1:
                covered += weights[members[e]]
    kept = chosen.copy()
    left = kept.shape[0]
    while left > 0:
        least, alone = -1, 0
        for n in range(left):
            k = kept[n]
            only = 0
            for e in range(starts[k], starts[k + 1]):
                if times[members[e]] == 1:
                    only += weights[members[e]]
            if least < 0 or only < alone:
                least, alone = n, only
        if alone > max(covered - wanted, 0):
            break
        covered -= alone
        k = kept[least]
        for e in range(starts[k], starts[k + 1]):
            times[members[e]] -= 1
        kept[least : left - 1] = kept[least + 1 : left].copy()
        left -= 1
    return kept[:left].copy()
