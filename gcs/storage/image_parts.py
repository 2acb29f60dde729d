"""Pictures that are not whole yet: the pieces that have come, kept over a restart of the station.

    header   MAGIC, size of the whole file, CRC-32 of that size
    piece    offset, length, CRC-32 of offset, length and data; data
    piece    ...

All numbers are little-endian uint32. Pieces are only ever appended, so that a killed station leaves at worst a torn
last piece, which its CRC-32 tells. What this file cannot tell is whether the vehicle still holds the same picture:
whoever goes on with it has to compare a checksum at the end.
"""

from __future__ import annotations

import logging
import struct
import zlib
from contextlib import suppress
from typing import TYPE_CHECKING, BinaryIO

if TYPE_CHECKING:
    from pathlib import Path

log = logging.getLogger(__name__)

SUFFIX = ".part"
MAGIC = b"gcs part 1\n"
_HEADER = struct.Struct(f"<{len(MAGIC)}sII")
_PIECE = struct.Struct("<III")
_MOST_LENGTH = 1 << 16
_BUFFER_BYTES = 1 << 14
"""A killed station loses at most so much of what had come."""
_MOST_PER_BYTE = 2
"""No more than so many bytes are kept for each of the picture: pieces can be sent that overlap without end."""


class ImagePart:
    """The part file of one picture.

    What cannot be kept is not: the fetch itself goes on.

    Args:
        path: of the part file.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file: BinaryIO | None = None
        self._end: int | None = None
        """Where the next piece goes in a file that is not opened yet."""
        self._room = 0

    def load(self) -> tuple[int, list[tuple[int, bytes]]] | None:
        """What was kept: the size of the whole, and (offset, data) of its pieces; more can be added afterwards.

        Returns:
            None when there is nothing that is of use; a file that is damaged is gone then.
        """
        try:
            raw = self._path.read_bytes()
        except OSError:
            return None
        size = _size_in(raw)
        if size is None:
            self.remove()
            return None
        pieces, self._end = _whole_pieces(raw, size)
        self._room = _MOST_PER_BYTE * size - self._end
        return size, pieces

    def begin(self, size: int) -> None:
        """Forget what was kept: a picture of `size` bytes begins."""
        self.close()
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            self._file = self._path.open("wb", buffering=_BUFFER_BYTES)
            self._file.write(_HEADER.pack(MAGIC, size, _size_crc32(size)))
        except OSError as error:
            self._give_up(error)
        self._room = _MOST_PER_BYTE * size

    def add(self, offset: int, data: bytes) -> None:
        """Keep a piece of it."""
        self._room -= _PIECE.size + len(data)
        if self._room < 0 or (self._file is None and self._end is None):
            return
        try:
            self._opened().write(_PIECE.pack(offset, len(data), _piece_crc32(offset, data)) + data)
        except OSError as error:
            self._give_up(error)

    def close(self) -> None:
        """Keep what there is for later."""
        file, self._file, self._end = self._file, None, None
        if file is not None:
            with suppress(OSError):
                file.close()

    def remove(self) -> None:
        """The picture is whole, or what was kept of it is of no use."""
        self.close()
        with suppress(OSError):
            self._path.unlink(missing_ok=True)

    def _opened(self) -> BinaryIO:
        if self._file is None:
            self._file = self._path.open("r+b", buffering=_BUFFER_BYTES)
            self._file.seek(self._end or 0)
            self._file.truncate()
        return self._file

    def _give_up(self, error: OSError) -> None:
        log.warning("%s: a picture's pieces cannot be kept: %s", self._path, error)
        self.remove()


def _whole_pieces(raw: bytes, size: int) -> tuple[list[tuple[int, bytes]], int]:
    """The pieces up to the first that is torn or damaged, and where it begins."""
    pieces: list[tuple[int, bytes]] = []
    at = _HEADER.size
    while at + _PIECE.size <= len(raw):
        offset, length, crc32 = _PIECE.unpack_from(raw, at)
        data = raw[at + _PIECE.size : at + _PIECE.size + length]
        if not 0 < length <= _MOST_LENGTH or offset + length > size or _piece_crc32(offset, data) != crc32:
            break
        pieces.append((offset, data))
        at += _PIECE.size + length
    return pieces, at


def _size_in(raw: bytes) -> int | None:
    """The size that a header tells; None when it is none."""
    if len(raw) < _HEADER.size:
        return None
    magic, size, crc32 = _HEADER.unpack_from(raw)
    return size if magic == MAGIC and crc32 == _size_crc32(size) else None


def _size_crc32(size: int) -> int:
    return zlib.crc32(size.to_bytes(4, "little"))


def _piece_crc32(offset: int, data: bytes) -> int:
    return zlib.crc32(data, zlib.crc32(struct.pack("<II", offset, len(data))))
