"""MAVLink FTP on the wire: the 251-byte payload, listings, names and checksums.

https://mavlink.io/en/services/ftp.html. Everything that a vehicle sends is untrusted: sizes, offsets and names.
"""

from __future__ import annotations

import secrets
import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum

from gcs.core.errors import InputError
from gcs.mavlink.dialect import Message, mavlink

CHUNK = 239
"""Data bytes in one message."""
_HEADER = struct.Struct("<HBBBBBBI")
_PAYLOAD = 251


class Opcode(IntEnum):
    """What a message asks or answers."""

    NONE = 0
    TERMINATE_SESSION = 1
    RESET_SESSIONS = 2
    LIST_DIRECTORY = 3
    OPEN_FILE_RO = 4
    READ_FILE = 5
    CREATE_FILE = 6
    WRITE_FILE = 7
    CALC_FILE_CRC32 = 14
    BURST_READ_FILE = 15
    ACK = 128
    NAK = 129


class FtpError(IntEnum):
    """Reasons in a NAK."""

    NONE = 0
    FAIL = 1
    FAIL_ERRNO = 2
    INVALID_DATA_SIZE = 3
    INVALID_SESSION = 4
    NO_SESSIONS_AVAILABLE = 5
    END_OF_FILE = 6
    UNKNOWN_COMMAND = 7
    FILE_EXISTS = 8
    FILE_PROTECTED = 9
    FILE_NOT_FOUND = 10


_ENOENT = 2

_ERROR_WORDS = {
    FtpError.FAIL: "it failed",
    FtpError.FAIL_ERRNO: "it failed",
    FtpError.INVALID_DATA_SIZE: "it did not understand the size",
    FtpError.INVALID_SESSION: "it does not know the session",
    FtpError.NO_SESSIONS_AVAILABLE: "it serves somebody else",
    FtpError.END_OF_FILE: "the file ended",
    FtpError.UNKNOWN_COMMAND: "it does not know the command",
    FtpError.FILE_EXISTS: "the file exists",
    FtpError.FILE_PROTECTED: "the file is protected",
    FtpError.FILE_NOT_FOUND: "there is no such file",
}


@dataclass(frozen=True)
class FtpPayload:
    """The content of one FILE_TRANSFER_PROTOCOL message.

    Attributes:
        sequence: number of the message, modulo 65536; an answer has that of its request plus one.
        session: which open file.
        opcode: what it asks, or ACK or NAK.
        size: number of data bytes, or what the command says.
        request: the opcode that is answered.
        burst_complete: the vehicle sends no more of this burst by itself.
        offset: place in the file, or number of the first listing entry.
        data: at most 239 bytes.
    """

    sequence: int
    opcode: int
    session: int = 0
    size: int = 0
    request: int = 0
    burst_complete: bool = False
    offset: int = 0
    data: bytes = b""

    def encode(self) -> bytes:
        """The 251 bytes."""
        head = _HEADER.pack(
            self.sequence,
            self.session,
            self.opcode,
            self.size,
            self.request,
            int(self.burst_complete),
            0,
            self.offset,
        )
        return (head + self.data).ljust(_PAYLOAD, b"\0")

    @property
    def error(self) -> FtpError | None:
        """Why a NAK was sent; None for other messages."""
        if self.opcode != Opcode.NAK:
            return None
        try:
            error = FtpError(self.data[0]) if self.data else FtpError.FAIL
        except ValueError:
            return FtpError.FAIL
        if error is FtpError.FAIL_ERRNO and self.data[1:2] == bytes([_ENOENT]):
            return FtpError.FILE_NOT_FOUND
        return error


def decode(message: Message) -> FtpPayload | None:
    """The content of a FILE_TRANSFER_PROTOCOL message; None when it is malformed."""
    raw = bytes(message.payload)
    if len(raw) < _HEADER.size:
        return None
    sequence, session, opcode, size, request, burst_complete, _, offset = _HEADER.unpack_from(raw)
    if size > CHUNK:
        return None
    data = raw[_HEADER.size : _HEADER.size + size]
    return FtpPayload(sequence, opcode, session, size, request, bool(burst_complete), offset, data)


def ftp_message(payload: FtpPayload, target_system: int, target_component: int) -> Message:
    """FILE_TRANSFER_PROTOCOL with a payload."""
    return mavlink.MAVLink_file_transfer_protocol_message(0, target_system, target_component, payload.encode())


def error_words(error: FtpError) -> str:
    """A reason in plain words."""
    return _ERROR_WORDS.get(error, error.name)


class SequenceNumbers:
    """Sequence numbers of all requests to one server.

    A server that sees a number again sends its last answer again, so the numbers run on from one exchange to the next
    and begin at a random place: one object for each component that serves files.

    Args:
        first: where to begin; random by default.
    """

    def __init__(self, first: int | None = None) -> None:
        self._last = secrets.randbelow(1 << 16) if first is None else first % (1 << 16)

    def next(self) -> int:
        """A number for a new request."""
        self._last = (self._last + 1) % (1 << 16)
        return self._last

    def heard(self, sequence: int) -> None:
        """Go beyond a number that the server has used (the answers of a burst count on)."""
        if 0 < (sequence - self._last) % (1 << 16) < (1 << 15):
            self._last = sequence


@dataclass(frozen=True)
class DirectoryEntry:
    """One plain name in a folder.

    Attributes:
        name: a file name without any path.
        is_directory: whether it is a folder.
        size: bytes, as the vehicle says; 0 for folders.
    """

    name: str
    is_directory: bool
    size: int


def is_plain_name(name: str) -> bool:
    """Whether a name is that of a file in a folder and nothing else: no path, no control characters."""
    return (
        0 < len(name) <= 200
        and name not in {".", ".."}
        and not any(c in name for c in '/\\:*?"<>|')
        and name.isprintable()
        and name == name.strip()
        and not name.endswith(".")
    )


def parse_listing(data: bytes) -> tuple[int, list[DirectoryEntry], list[str]]:
    """Read one answer to LIST_DIRECTORY.

    Returns:
        The number of entries in it (the next request's offset counts on by so many), those that are files or folders
        with plain names, and what was dropped, in plain words.
    """
    entries, dropped, count = [], [], 0
    for raw in data.split(b"\0"):
        if not raw:
            continue
        count += 1
        kind, text = raw[:1], raw[1:].decode("utf-8", "replace")
        name, _, size = text.partition("\t")
        if kind == b"S" or name in {".", ".."}:
            continue
        if kind not in {b"F", b"D"} or not is_plain_name(name):
            dropped.append(f"a name that is no plain file name: {text[:80]!r}")
        elif kind == b"F" and not (size.isascii() and size.isdigit()):
            dropped.append(f"a file without a size: {name!r}")
        else:
            entries.append(DirectoryEntry(name, kind == b"D", int(size) if kind == b"F" else 0))
    return count, entries, dropped


def path_from_url(url: str) -> tuple[str, int | None]:
    """Path and component id of a `mftp://[;comp=ID]/PATH` address, of `mftp:PATH`, or of a bare path.

    Raises:
        InputError: another scheme, or a path that climbs (`..`).
    """
    component = None
    path = url
    if "://" in url or url.startswith("mftp:"):
        scheme, _, rest = url.partition(":")
        if scheme != "mftp":
            raise InputError(f"files come by MAVLink FTP only, not by {scheme}", field=url[:120])
        path = rest.removeprefix("//")
        if path.startswith("[;comp="):
            number, _, path = path.removeprefix("[;comp=").partition("]")
            if not (number.isascii() and number.isdigit() and 0 < int(number) < 256):
                raise InputError("the component in the address is not a number from 1 to 255", field=url[:120])
            component = int(number)
    encode_path(path)
    return path, component


def encode_path(path: str) -> bytes:
    """A path as it goes on the wire.

    Raises:
        InputError: empty, too long, unprintable, or it climbs (`..`).
    """
    raw = path.encode()
    if not raw or len(raw) >= CHUNK or not path.isprintable():
        raise InputError("a vehicle's file path has 1 to 238 printable bytes", field=path[:120])
    if ".." in path.replace("\\", "/").split("/"):
        raise InputError("a vehicle's file path must not climb with `..`", field=path[:120])
    return raw


def file_name_of(path: str) -> str:
    """The last part of a vehicle's path as a name that is safe to store under.

    Raises:
        InputError: it has none.
    """
    name = path.replace("\\", "/").rsplit("/", 1)[-1]
    if not is_plain_name(name):
        raise InputError("the vehicle's path does not end in a plain file name", field=path[:120])
    return name


def checksum_agrees(data: bytes, told: int) -> bool:
    """Whether a CRC-32 told by a vehicle is that of the data.

    The protocol's own variant starts at 0 and is not inverted (PX4, ArduPilot, QGroundControl); the usual one of zlib
    is accepted too. Both fix 32 bits, so that nothing is lost by accepting either.
    """
    return told in {protocol_crc32(data), zlib.crc32(data)}


def protocol_crc32(data: bytes) -> int:
    """CRC-32 as MAVLink FTP computes it: polynomial 0x04C11DB7 reflected, start 0, no final inversion."""
    return zlib.crc32(data, 0xFFFFFFFF) ^ 0xFFFFFFFF


OnBytes = Callable[[int, int], None]
"""Progress of a file: bytes held, bytes in all. May raise `OperationCancelled` to stop it."""
