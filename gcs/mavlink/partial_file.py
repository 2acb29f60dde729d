"""What has come of a file whose transfer was broken off, to go on with, and who keeps it meanwhile."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Protocol

from gcs.mavlink.byte_gaps import ByteGaps


@dataclass(frozen=True)
class PartialFile:
    """What a fetch that broke off had.

    Attributes:
        size: size of the whole file, as announced.
        data: `size` bytes, zero where they are missing.
        gaps: missing half-open ranges.
        may_be_stale: the vehicle may hold another file of this name and size by now, as after a restart of the station:
            the whole then only counts if the vehicle's checksum agrees.
    """

    size: int
    data: bytes
    gaps: tuple[tuple[int, int], ...]
    may_be_stale: bool = False

    @classmethod
    def of_pieces(cls, size: int, pieces: Iterable[tuple[int, bytes]]) -> PartialFile:
        """A file put together from (offset, data) that were kept; it may be stale."""
        data, gaps = bytearray(size), ByteGaps([(0, size)])
        for offset, piece in pieces:
            end = min(offset + len(piece), size)
            if gaps.fill(offset, end):
                data[offset:end] = piece[: end - offset]
        return cls(size, bytes(data), tuple(gaps), may_be_stale=True)


class PartKeeper(Protocol):
    """Keeps the pieces of a file as they come, so that a fetch can go on after the station was ended."""

    def begin(self, size: int) -> None:
        """Forget what was kept: a file of `size` bytes begins."""
        ...

    def add(self, offset: int, data: bytes) -> None:
        """Keep a piece; must not wait for long and must not fail."""
        ...
