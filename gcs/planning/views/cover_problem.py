"""The cover that a choice of views answers: which candidate shows which target, and how many had to be shown."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray


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


def without_twins(
    starts: NDArray[np.int64], members: NDArray[np.int32], weights: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int32], NDArray[np.int64]]:
    """The same sets over fewer targets: one stands for all that are in the same sets, and weighs as much as they do.

    Args:
        starts: where each set's targets begin in `members`, shape (S + 1,).
        members: numbers of the targets, set after set.
        weights: of the targets, shape (T,).

    Returns:
        `starts`, `members` and `weights`. Targets are told apart by the sum of random 64-bit numbers of their sets; the
        chance that two of them are taken for twins is about T^2 / 2^64.
    """
    number = np.random.default_rng(0).integers(np.iinfo(np.int64).max, size=len(starts) - 1)
    sums = np.zeros(len(weights), dtype=np.int64)
    np.add.at(sums, members, np.repeat(number, np.diff(starts)))
    _, first, twin = np.unique(sums, return_index=True, return_inverse=True)
    stands = np.zeros(len(weights), dtype=np.bool_)
    stands[first] = True
    kept = stands[members]
    before = np.concatenate([[0], np.cumsum(kept)])
    total = np.zeros(len(first), dtype=np.int64)
    np.add.at(total, twin, weights)
    return before[starts], twin[members[kept]].astype(np.int32), total
