"""MAVLink FTP, the server's side, for a folder that exists in memory.

The payload of FILE_TRANSFER_PROTOCOL is: u16 sequence, u8 session, u8 opcode, u8 size, u8 requested opcode,
u8 burst complete, u8 padding, u32 offset, then up to 239 bytes of data; little-endian.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass

from sitl_mocks.camera import CameraFolder
from sitl_mocks.dialect import Message, mavlink

HEADER = struct.Struct("<HBBBBBBI")
DATA_SIZE = 239

NONE, TERMINATE, RESET, LIST, OPEN_READ, READ = 0, 1, 2, 3, 4, 5
CRC32, BURST = 14, 15
ACK, NAK = 128, 129

FAIL, INVALID_DATA_SIZE, INVALID_SESSION, NO_SESSIONS, END_OF_FILE, UNKNOWN_COMMAND = 1, 3, 4, 5, 6, 7
FILE_PROTECTED, NOT_FOUND = 9, 10
_WRITING = {6, 7, 8, 9, 10, 11, 12, 13}


@dataclass
class _Burst:
    """A burst that is being sent."""

    send: Callable[[Message], None]
    receiver: tuple[int, int]
    sequence: int
    data: bytes
    offset: int
    end: int
    size: int


class FileServer:
    """Serves files read-only.

    Args:
        folder: the files.
        sessions: how many files can be open at once.
    """

    BURST_BYTES = 24_000
    """A burst ends after this much, so that a receiver with small buffers keeps up; the client asks for the next."""
    PACKETS_PER_STEP = 12

    def __init__(self, folder: CameraFolder, sessions: int = 2) -> None:
        self._folder = folder
        self._open: dict[int, bytes] = {}
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
                if complete:
                    del self._bursts[session]
                    break

    def _answer(self, opcode: int, session: int, offset: int, size: int, data: bytes) -> tuple[bytes | int, int]:
        """The data of an ACK or the code of a NAK, and the session."""
        if opcode == NONE:
            return b"", session
        if opcode == TERMINATE:
            self._bursts.pop(session, None)
            return (b"", session) if self._open.pop(session, None) is not None else (INVALID_SESSION, session)
        if opcode == RESET:
            self._open.clear()
            self._bursts.clear()
            return b"", session
        if opcode == LIST:
            return self._list(_path(data), offset), session
        if opcode == OPEN_READ:
            return self._open_read(_path(data))
        if opcode == READ:
            content = self._open.get(session)
            if content is None:
                return INVALID_SESSION, session
            part = content[offset : offset + min(size or DATA_SIZE, DATA_SIZE)]
            return (part or END_OF_FILE), session
        if opcode == CRC32:
            content = self._folder.files.get(_path(data))
            return (NOT_FOUND if content is None else struct.pack("<I", file_crc32(content))), session
        if opcode in _WRITING:
            return FILE_PROTECTED, session
        return UNKNOWN_COMMAND, session

    def _open_read(self, path: str) -> tuple[bytes | int, int]:
        content = self._folder.files.get(path)
        if content is None:
            return NOT_FOUND, 0
        session = next((n for n in range(self._sessions) if n not in self._open), None)
        if session is None:
            return NO_SESSIONS, 0
        self._open[session] = content
        return struct.pack("<I", len(content)), session

    def _list(self, path: str, offset: int) -> bytes | int:
        path = path.rstrip("/")
        if path == "":
            entries = ["DDCIM"]
        elif path == "/DCIM":
            names = sorted(self._folder.files)
            entries = [f"F{name.rsplit('/', 1)[1]}\t{len(self._folder.files[name])}" for name in names]
        else:
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
        content = self._open.get(session)
        if content is None or offset >= len(content):
            code = INVALID_SESSION if content is None else END_OF_FILE
            send(_message(sender, _reply(sequence + 1, session, BURST, offset, code)))
            return
        chunk = min(size, DATA_SIZE) if size > 0 else DATA_SIZE
        end = min(len(content), offset + self.BURST_BYTES // chunk * chunk)
        self._bursts[session] = _Burst(send, sender, sequence, content, offset, end, chunk)


def file_crc32(content: bytes) -> int:
    """CRC-32 as MAVLink FTP counts it: the usual polynomial, started from 0 and not inverted at the end."""
    return zlib.crc32(content, 0xFFFFFFFF) ^ 0xFFFFFFFF


def _path(data: bytes) -> str:
    path = data.split(b"\0", 1)[0].decode("utf-8", "replace")
    return path if path.startswith("/") else "/" + path


def _reply(
    sequence: int, session: int, opcode: int, offset: int, answer: bytes | int, *, complete: bool = False
) -> bytes:
    kind, data = (NAK, bytes([answer])) if isinstance(answer, int) else (ACK, answer)
    header = HEADER.pack(sequence % 65536, session, kind, len(data), opcode, int(complete), 0, offset)
    return (header + data).ljust(251, b"\0")


def _message(receiver: tuple[int, int], payload: bytes) -> Message:
    return mavlink.MAVLink_file_transfer_protocol_message(0, *receiver, list(payload))
