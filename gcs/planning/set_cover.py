"""Greedy set cover: few sets that together hold most of what all of them hold."""

from __future__ import annotations

import heapq
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

POLL_EVERY = 2000


def greedy_cover(
    sets: Sequence[NDArray[np.int64]],
    elements: int,
    *,
    preference: NDArray[np.float64] | None = None,
    covered: NDArray[np.bool_] | None = None,
    share: float = 1.0,
    poll: Callable[[], None] | None = None,
) -> list[int]:
    """Choose sets one by one, each time the one that adds most.

    Gains only shrink as more is covered, so a set whose stale gain is below another's fresh one need not be looked at
    (Minoux's lazy evaluation). Equal gains go to the lower index. Chosen sets that the later ones made needless are
    dropped again.

    Args:
        sets: element numbers of each set, without repetition.
        elements: how many elements there are.
        preference: factor on each set's gain, positive, shape (S,); 1 when left out.
        covered: elements that are covered already, shape (elements,).
        share: stop when this share of all that can be covered is.
        poll: called now and then; may raise to stop the search.

    Returns:
        Indices of the chosen sets, in the order of choice.
    """
    factor = np.ones(len(sets)) if preference is None else preference
    before = np.zeros(elements, dtype=np.bool_) if covered is None else covered.copy()
    possible = before.copy()
    for members in sets:
        possible[members] = True
    wanted = int(np.ceil(share * possible.sum() - 1e-9))
    done = before.copy()
    count = int(done.sum())
    heap = [(-len(members) * factor[k], k) for k, members in enumerate(sets)]
    heapq.heapify(heap)
    chosen: list[int] = []
    looked_at = 0
    while heap and count < wanted:
        looked_at += 1
        if poll is not None and looked_at % POLL_EVERY == 0:
            poll()
        _, k = heapq.heappop(heap)
        gain = int((~done[sets[k]]).sum())
        if gain == 0:
            continue
        key = (-gain * factor[k], k)
        if heap and key > heap[0]:
            heapq.heappush(heap, key)
            continue
        chosen.append(k)
        done[sets[k]] = True
        count += gain
    return _without_needless(sets, chosen, before, wanted)


def _without_needless(
    sets: Sequence[NDArray[np.int64]], chosen: list[int], before: NDArray[np.bool_], wanted: int
) -> list[int]:
    """Drop sets, the smallest contribution first, while what is wanted stays covered."""
    times = before.astype(np.int64)
    for k in chosen:
        times[sets[k]] += 1
    spare = int((times > 0).sum()) - wanted
    kept = list(chosen)
    while kept:
        alone = [int((times[sets[k]] == 1).sum()) for k in kept]
        least = int(np.argmin(alone))
        if alone[least] > spare:
            break
        spare -= alone[least]
        times[sets[kept.pop(least)]] -= 1
    return kept
