"""MAVLink FTP, the server's side, for files that exist in memory.

The payload of FILE_TRANSFER_PROTOCOL is: u16 sequence, u8 session, u8 opcode, u8 size, u8 requested opcode,
u8 burst complete, u8 padding, u32 offset, then up to 239 bytes of data; little-endian.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from sitl_mocks.dialect import Message, mavlink

HEADER = struct.Struct("<HBBBBBBI")
DATA_SIZE = 239

NONE, TERMINATE, RESET, LIST, OPEN_READ, READ, CREATE, WRITE = 0, 1, 2, 3, 4, 5, 6, 7
CRC32, BURST = 14, 15
ACK, NAK = 128, 129

FAIL, INVALID_DATA_SIZE, INVALID_SESSION, NO_SESSIONS, END_OF_FILE, UNKNOWN_COMMAND = 1, 3, 4, 5, 6, 7
FILE_PROTECTED, NOT_FOUND = 9, 10
_WRITING = {8, 9, 10, 11, 12, 13}
_LONGEST = 1 << 20


class Folder(Protocol):
    """Files that can be read."""

    def content(self, path: str) -> bytes | None:
        """A file; None when there is none."""
        ...

    def entries(self, path: str) -> list[str] | None:
        """What is in a folder, as a listing has it; None when there is no such folder."""
        ...


class WritableFolder(Folder, Protocol):
    """Files that can be written too."""

    def takes(self, path: str) -> bool:
        """Whether a file can be written."""
        ...

    def written(self, path: str, data: bytes) -> bool:
        """A file that was written has been closed; False when its content is of no use."""
        ...


class VirtualFolder(WritableFolder, Protocol):
    """Files that an autopilot makes up, with what follows from that."""

    def announced_size(self, path: str) -> int:
        """What is told of the size of a file before it has been made up."""
        ...

    def checksummed(self, path: str) -> bytes | None:
        """What the checksum is made of."""
        ...


@dataclass
class _Session:
    """An open file.

    Attributes:
        writer: takes it when it is closed; None of one that is read.
        read_size: the one size in which a made-up file may be read.
    """

    path: str
    content: bytearray
    writer: WritableFolder | None = None
    read_size: int = 0


@dataclass
class _Burst:
    """A burst that is being sent; `says_end` tells the end of the file besides, as ArduPilot does."""

    send: Callable[[Message], None]
    receiver: tuple[int, int]
    sequence: int
    data: bytes
    offset: int
    end: int
    size: int
    says_end: bool


class FileServer:
    """Serves files to read, and those that an autopilot makes up (their paths begin with @) to write too.

    Args:
        folder: the files.
        sessions: how many files can be open at once.
        virtual: the files that are made up.
        writable: the other files, where they can be written.
    """

    BURST_BYTES = 24_000
    """A burst ends after this much, so that a receiver with small buffers keeps up; the client asks for the next."""
    PACKETS_PER_STEP = 12

    def __init__(
        self,
        folder: Folder,
        sessions: int = 2,
        virtual: VirtualFolder | None = None,
        writable: WritableFolder | None = None,
    ) -> None:
        self._folder = folder
        self._virtual = virtual
        self._writable = writable
        self._open: dict[int, _Session] = {}
        self._sessions = sessions
        self._bursts: dict[int, _Burst] = {}
        self._last: dict[tuple[int, int], tuple[bytes, bytes]] = {}

    def handle(self, message: Message, send: Callable[[Message], None]) -> None:
        """Answer a request."""
        sender = (message.get_srcSystem(), message.get_srcComponent())
        request = bytes(message.payload)
        if self._last.get(sender, (b"",))[0] == request:
            send(_message(sender, self._last[sender][1]))  # our answer was lost
            return
        sequence, session, opcode, size, _, _, _, offset = HEADER.unpack_from(request)
        data = request[HEADER.size : HEADER.size + min(size, DATA_SIZE)]
        if size > DATA_SIZE:
            answer: bytes | int = INVALID_DATA_SIZE
        elif opcode == BURST:
            self._start_burst(sender, send, sequence, session, offset, size)
            return
        else:
            answer, session = self._answer(opcode, session, offset, size, data)
        reply = _reply(sequence + 1, session, opcode, offset, answer)
        self._last[sender] = (request, reply)
        send(_message(sender, reply))

    @property
    def busy(self) -> bool:
        """Whether a burst is under way."""
        return bool(self._bursts)

    def step(self) -> None:
        """Send the next packets of running bursts."""
        for session, burst in list(self._bursts.items()):
            for _ in range(self.PACKETS_PER_STEP):
                chunk = burst.data[burst.offset : min(burst.offset + burst.size, burst.end)]
                complete = burst.offset + len(chunk) >= burst.end
                burst.sequence += 1
                packet = _reply(burst.sequence, session, BURST, burst.offset, chunk, complete=complete)
                burst.send(_message(burst.receiver, packet))
                burst.offset += len(chunk)
                if not complete:
                    continue
                del self._bursts[session]
                if burst.says_end and burst.end == len(burst.data):
                    end = _reply(burst.sequence + 1, session, BURST, burst.offset, END_OF_FILE, complete=True)
                    burst.send(_message(burst.receiver, end))
                break

    def _answer(self, opcode: int, session: int, offset: int, size: int, data: bytes) -> tuple[bytes | int, int]:
        """The data of an ACK or the code of a NAK, and the session."""
        if opcode == NONE:
            return b"", session
        if opcode == TERMINATE:
            self._bursts.pop(session, None)
            return self._close(session), session
        if opcode == RESET:
            self._open.clear()
            self._bursts.clear()
            return b"", session
        if opcode == LIST:
            return self._list(_path(data), offset), session
        if opcode == OPEN_READ:
            return self._open_read(_path(data))
        if opcode == READ:
            return self._read(session, offset, size), session
        if opcode == CREATE:
            return self._create(_path(data))
        if opcode == WRITE:
            return self._write(session, offset, data), session
        if opcode == CRC32:
            path = _path(data)
            virtual = self._virtual_of(path)
            content = self._folder.content(path) if virtual is None else virtual.checksummed(path)
            return (NOT_FOUND if content is None else struct.pack("<I", file_crc32(content))), session
        if opcode in _WRITING:
            return FILE_PROTECTED, session
        return UNKNOWN_COMMAND, session

    def _virtual_of(self, path: str) -> VirtualFolder | None:
        return self._virtual if path.startswith("@") else None

    def _new_session(self, opened: _Session) -> int | None:
        session = next((n for n in range(self._sessions) if n not in self._open), None)
        if session is not None:
            self._open[session] = opened
        return session

    def _open_read(self, path: str) -> tuple[bytes | int, int]:
        virtual = self._virtual_of(path)
        content = (virtual or self._folder).content(path)
        if content is None:
            return NOT_FOUND, 0
        session = self._new_session(_Session(path, bytearray(content)))
        if session is None:
            return NO_SESSIONS, 0
        size = len(content) if virtual is None else virtual.announced_size(path)
        return struct.pack("<I", size), session

    def _read(self, session: int, offset: int, size: int) -> bytes | int:
        opened = self._open.get(session)
        if opened is None:
            return INVALID_SESSION
        size = min(size or DATA_SIZE, DATA_SIZE)
        if not self._read_size_fits(opened, size):
            return FAIL
        return bytes(opened.content[offset : offset + size]) or END_OF_FILE

    def _read_size_fits(self, opened: _Session, size: int) -> bool:
        opened.read_size = opened.read_size or size
        return opened.writer is None and (opened.read_size == size or self._virtual_of(opened.path) is None)

    def _create(self, path: str) -> tuple[bytes | int, int]:
        writer = self._virtual if path.startswith("@") else self._writable
        if writer is None or not writer.takes(path):
            return FILE_PROTECTED, 0
        session = self._new_session(_Session(path, bytearray(), writer))
        return (NO_SESSIONS, 0) if session is None else (b"", session)

    def _write(self, session: int, offset: int, data: bytes) -> bytes | int:
        opened = self._open.get(session)
        if opened is None:
            return INVALID_SESSION
        if opened.writer is None or offset + len(data) > _LONGEST:
            return FAIL
        opened.content.extend(bytes(max(0, offset + len(data) - len(opened.content))))
        opened.content[offset : offset + len(data)] = data
        return b""

    def _close(self, session: int) -> bytes | int:
        opened = self._open.pop(session, None)
        if opened is None:
            return INVALID_SESSION
        if opened.writer is not None and not opened.writer.written(opened.path, bytes(opened.content)):
            return FAIL
        return b""

    def _list(self, path: str, offset: int) -> bytes | int:
        path = path.rstrip("/")
        entries = (self._virtual_of(path) or self._folder).entries(path)
        if entries is None:
            return NOT_FOUND
        packed = b""
        for entry in entries[offset:]:
            line = entry.encode() + b"\0"
            if len(packed) + len(line) > DATA_SIZE:
                break
            packed += line
        return packed or END_OF_FILE

    def _start_burst(
        self,
        sender: tuple[int, int],
        send: Callable[[Message], None],
        sequence: int,
        session: int,
        offset: int,
        size: int,
    ) -> None:
        opened = self._open.get(session)
        chunk = min(size, DATA_SIZE) if size > 0 else DATA_SIZE
        if opened is None or not self._read_size_fits(opened, chunk) or offset >= len(opened.content):
            code = INVALID_SESSION if opened is None else END_OF_FILE
            send(_message(sender, _reply(sequence + 1, session, BURST, offset, code)))
            return
        content = bytes(opened.content)
        end = min(len(content), offset + self.BURST_BYTES // chunk * chunk)
        self._bursts[session] = _Burst(
            send, sender, sequence, content, offset, end, chunk, self._virtual_of(opened.path) is not None
        )


def file_crc32(content: bytes) -> int:
    """CRC-32 as MAVLink FTP counts it: the usual polynomial, started from 0 and not inverted at the end."""
    return zlib.crc32(content, 0xFFFFFFFF) ^ 0xFFFFFFFF


def _path(data: bytes) -> str:
    path = data.split(b"\0", 1)[0].decode("utf-8", "replace")
    return path if path.startswith(("/", "@")) else "/" + path


def _reply(
    sequence: int, session: int, opcode: int, offset: int, answer: bytes | int, *, complete: bool = False
) -> bytes:
    kind, data = (NAK, bytes([answer])) if isinstance(answer, int) else (ACK, answer)
    header = HEADER.pack(sequence % 65536, session, kind, len(data), opcode, int(complete), 0, offset)
    return (header + data).ljust(251, b"\0")


def _message(receiver: tuple[int, int], payload: bytes) -> Message:
    return mavlink.MAVLink_file_transfer_protocol_message(0, *receiver, list(payload))
