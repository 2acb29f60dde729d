"""Runs of several flights improved by handing single stops from one run to another ("relocate" moves)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

HOME = -1
"""The node from which every run leaves and to which it comes back; stops are 0, 1, ..."""

NEIGHBOURS = 8
MOST_ROUNDS = 5
_LEAST_GAIN = 1e-6


def exchange_stops(
    runs: Sequence[Sequence[int]],
    stops_m: NDArray[np.float64],
    edge: Callable[[int, int, int], float],
    value: Callable[[int, Sequence[int]], float],
    *,
    longest: bool,
    poll: Callable[[], None],
) -> list[list[int]]:
    """Move stops beside near ones of other runs as long as that makes things better.

    Args:
        runs: stops of each run in visiting order.
        stops_m: places of all stops, shape (N, 3).
        edge: of run number, node and node: at most what this leg costs in this run; exact for legs that are flown.
        value: of run number and stops: what a run costs, the sum of its legs and of a constant; infinite when it may
            not be flown.
        longest: whether the dearest run is to be cheap, instead of all together.
        poll: called often; may raise.

    Returns:
        The runs; none that had a stop is left without.
    """
    exchange = _Exchange([list(run) for run in runs], edge, value, longest)
    near = _nearest(stops_m)
    for _ in range(MOST_ROUNDS):
        changed = False
        for stop in range(len(stops_m)):
            poll()
            changed |= exchange.move(stop, near[stop])
        if not changed:
            break
    return exchange.runs


class _Exchange:
    """The runs as they are now, and what they cost."""

    def __init__(
        self,
        runs: list[list[int]],
        edge: Callable[[int, int, int], float],
        value: Callable[[int, Sequence[int]], float],
        longest: bool,
    ) -> None:
        self.runs = runs
        self._edge = edge
        self._value = value
        self._longest = longest
        self._values = [value(number, run) for number, run in enumerate(runs)]
        self._run_of = {stop: number for number, run in enumerate(runs) for stop in run}

    def move(self, stop: int, near: NDArray[np.int64]) -> bool:
        """Put a stop beside one of its neighbours in another run, if that is better."""
        giver = self._run_of[stop]
        if len(self.runs[giver]) < 2:
            return False
        saved = self._saved(giver, stop)
        for other in near.tolist():
            taker = self._run_of[other]
            if taker == giver:
                continue
            at = self.runs[taker].index(other)
            for place in (at, at + 1):
                if self._may_be_better(giver, saved, taker, place, stop) and self._accept(giver, taker, place, stop):
                    return True
        return False

    def _saved(self, giver: int, stop: int) -> float:
        run = self.runs[giver]
        at = run.index(stop)
        before, after = ([HOME, *run][at], [*run, HOME][at + 1])
        return self._edge(giver, before, stop) + self._edge(giver, stop, after) - self._edge(giver, before, after)

    def _may_be_better(self, giver: int, saved: float, taker: int, place: int, stop: int) -> bool:
        run = self.runs[taker]
        before, after = ([HOME, *run][place], [*run, HOME][place])
        added = self._edge(taker, before, stop) + self._edge(taker, stop, after) - self._edge(taker, before, after)
        if self._longest:
            return self._values[taker] + added < self._values[giver] - _LEAST_GAIN
        return added < saved - _LEAST_GAIN

    def _accept(self, giver: int, taker: int, place: int, stop: int) -> bool:
        less = [other for other in self.runs[giver] if other != stop]
        more = [*self.runs[taker][:place], stop, *self.runs[taker][place:]]
        values = self._value(giver, less), self._value(taker, more)
        before = self._values[giver], self._values[taker]
        total = max if self._longest else sum
        if total(values) >= total(before) - _LEAST_GAIN:
            return False
        self.runs[giver], self.runs[taker] = less, more
        self._values[giver], self._values[taker] = values
        self._run_of[stop] = taker
        return True


def _nearest(stops_m: NDArray[np.float64]) -> NDArray[np.int64]:
    """The nearest other stops of each, shape (N, up to NEIGHBOURS)."""
    from scipy.spatial import KDTree

    count = min(NEIGHBOURS + 1, len(stops_m))
    _, near = KDTree(stops_m).query(stops_m, count)
    near = np.asarray(near, dtype=np.int64).reshape(len(stops_m), count)
    return np.array([row[row != stop][: count - 1] for stop, row in enumerate(near)], dtype=np.int64).reshape(
        len(stops_m), count - 1
    )
