"""The cover that a choice of views answers: which candidate shows which target, and how many had to be shown."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gcs.planning.numerics.compiled import compiled

if TYPE_CHECKING:
    from numpy.typing import NDArray

Ints = np.ndarray[tuple[int, ...], np.dtype[np.int64]]
ShortInts = np.ndarray[tuple[int, ...], np.dtype[np.int32]]


@dataclass(frozen=True, eq=False)
class CoverProblem:
    """A set cover, whole or in part, and a choice that answers it.

    Attributes:
        starts: where each candidate's targets begin in `members`, shape (C + 1,).
        members: numbers of the targets that each candidate covers, candidate after candidate, without repetition.
        targets: how many targets there are.
        covered: targets that need no candidate, because something else covers them, shape (targets,).
        wanted: how many targets had to be covered, those of `covered` counted in.
        chosen: the candidates that were chosen; together with `covered` they cover at least `wanted` targets.
    """

    starts: NDArray[np.int64]
    members: NDArray[np.int32]
    targets: int
    covered: NDArray[np.bool_]
    wanted: int
    chosen: NDArray[np.int64]

    @classmethod
    def empty(cls) -> CoverProblem:
        """Nothing to cover, and nothing chosen."""
        none = np.zeros(0, dtype=np.int64)
        return cls(np.zeros(1, dtype=np.int64), np.zeros(0, dtype=np.int32), 0, np.zeros(0, dtype=np.bool_), 0, none)

    @property
    def candidates(self) -> int:
        """How many candidates there are."""
        return len(self.starts) - 1

    def members_of(self, candidate: int) -> NDArray[np.int32]:
        """Numbers of the targets that a candidate covers."""
        return self.members[self.starts[candidate] : self.starts[candidate + 1]]


def replicated(
    starts: NDArray[np.int64], members: NDArray[np.int32], weights: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """The same sets over targets that are there as often as their weight says.

    Args:
        starts: where each set's targets begin in `members`, shape (S + 1,).
        members: numbers of the targets, set after set.
        weights: how often each target is to be there, shape (T,).

    Returns:
        `starts` and `members`; the copies of a target have numbers side by side, in the order of the targets.
    """
    return _replicated(starts, members, weights)


@compiled
def _replicated(starts: Ints, members: ShortInts, weights: Ints) -> tuple[Ints, ShortInts]:
    first = np.zeros(weights.shape[0] + 1, np.int64)
    for t in range(weights.shape[0]):
        first[t + 1] = first[t] + weights[t]
    new_starts = np.zeros(starts.shape[0], np.int64)
    for s in range(starts.shape[0] - 1):
        size = 0
        for e in range(starts[s], starts[s + 1]):
            size += weights[members[e]]
        new_starts[s + 1] = new_starts[s] + size
    result = np.empty(new_starts[-1], np.int32)
    at = 0
    for e in range(members.shape[0]):
        for copy in range(first[members[e]], first[members[e] + 1]):
            result[at] = copy
            at += 1
    return new_starts, result
