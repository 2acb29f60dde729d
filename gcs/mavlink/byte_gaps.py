"""Which bytes of a file have not come yet."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable, Iterator


class ByteGaps:
    """Sorted half-open ranges that are missing.

    Args:
        ranges: the missing ranges, disjoint and in order.
    """

    def __init__(self, ranges: Iterable[tuple[int, int]]) -> None:
        self._ranges = [(a, b) for a, b in ranges if a < b]

    def __iter__(self) -> Iterator[tuple[int, int]]:
        return iter(tuple(self._ranges))

    def __bool__(self) -> bool:
        return bool(self._ranges)

    @property
    def missing(self) -> int:
        """Number of missing bytes."""
        return sum(b - a for a, b in self._ranges)

    def fill(self, start: int, end: int) -> int:
        """Take out a range that has come; returns how many of its bytes were missing."""
        if start >= end:
            return 0
        first = max(bisect_right(self._ranges, (start, start)) - 1, 0)
        last, filled, left = first, 0, []
        while last < len(self._ranges) and self._ranges[last][0] < end:
            a, b = self._ranges[last]
            filled += max(0, min(b, end) - max(a, start))
            left += [(a, min(b, start)), (max(a, end), b)]
            last += 1
        self._ranges[first:last] = [(a, b) for a, b in left if a < b]
        return filled

    def cut(self, end: int) -> None:
        """Forget everything from `end` on."""
        self._ranges = [(a, min(b, end)) for a, b in self._ranges if a < end]
