"""Telemetry logs (`.tlog`): every packet of a flight's link behind the time at which it passed.

The form is the one that QGroundControl, Mission Planner, MAVProxy and pymavlink read: eight bytes of microseconds since
1970 (UTC, big-endian), then the MAVLink packet as it was on the wire. The lowest two bits of the time are zero, since
pymavlink takes them for the number of a link.

Packets are taken from any thread and never wait for the disk; a thread of the log writes twice a second, so that what a
killed process loses is less than the last second. A disk that is too slow or full costs packets, which are counted.
"""

from __future__ import annotations

import errno
import logging
import os
import struct
import threading
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

from gcs.core.errors import NotFoundError
from gcs.storage.image_store import checked_name

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

log = logging.getLogger(__name__)

WRITE_EVERY_S = 0.5
TRY_AGAIN_S = 5.0
MAX_WAITING = 4 * 1024 * 1024
"""Bytes that may wait for the disk; as many again may be on their way to it."""
CLOSE_S = 5.0
CHUNK = 64 * 1024
SUFFIX = ".tlog"

_TIME = struct.Struct(">Q")
_LINK_BITS = 3
_MARKERS = {0xFE: 8, 0xFD: 12}
"""First byte of a packet -> its length without payload and signature."""
_SIGNED, _SIGNATURE = 0x01, 13


@dataclass(frozen=True)
class LogTotals:
    """What became of the packets of one recording.

    Attributes:
        packets: on the disk.
        lost: not on the disk, because it was full or too slow.
    """

    packets: int
    lost: int


class TelemetryLog:
    """Writes one log; a file that is there already is continued behind its last whole packet.

    Args:
        path: of the file; its folder is made.
        tell: takes a sentence when the disk does not take the log, and when it does so again; called in the log's own
            thread.
        wall: seconds since 1970, asked once.
        clock: monotonic seconds, so that times in the log never go back when the computer's clock is set.
        write_every_s: how often the disk is given what waits.
        max_waiting: bytes that may wait; packets beyond are lost.
    """

    def __init__(
        self,
        path: Path,
        tell: Callable[[str], None],
        *,
        wall: Callable[[], float] = time.time,
        clock: Callable[[], float] = time.monotonic,
        write_every_s: float = WRITE_EVERY_S,
        max_waiting: int = MAX_WAITING,
    ) -> None:
        self.path = path
        self._tell = tell
        self._clock = clock
        self._epoch_s = wall() - clock()
        self._write_every_s = write_every_s
        self._max_waiting = max_waiting
        self._lock = threading.Lock()
        self._waiting = bytearray()
        self._waiting_packets = 0
        self._lost = 0
        self._closing = threading.Event()
        self._descriptor: int | None = None
        self._length = 0
        self._block = bytearray()
        self._block_packets = 0
        self._packets = 0
        self._failing = False
        self._try_at = float("-inf")
        self._thread = threading.Thread(target=self._run, name=f"log {path.name}", daemon=True)
        self._thread.start()

    def record(self, packet: bytes | bytearray) -> None:
        """Take a packet, heard or sent; from any thread, without waiting for the disk."""
        with self._lock:
            if self._closing.is_set():
                return
            if len(self._waiting) + _TIME.size + len(packet) > self._max_waiting:
                self._lost += 1
                return
            self._waiting += _TIME.pack(int((self._epoch_s + self._clock()) * 1e6) & ~_LINK_BITS)
            self._waiting += packet
            self._waiting_packets += 1

    def close(self) -> LogTotals:
        """Write what waits and close the file; waits for the disk, but not for ever."""
        with self._lock:
            self._closing.set()
        self._thread.join(CLOSE_S)
        with self._lock:
            unwritten = self._waiting_packets + self._block_packets
            return LogTotals(self._packets, self._lost + unwritten)

    # ---- in the log's own thread ----

    def _run(self) -> None:
        closing = False
        while not closing:
            closing = self._closing.wait(self._write_every_s)
            if closing or self._clock() >= self._try_at:
                self._write()
                if self._block_packets == 0 and closing:
                    self._write()
        if self._descriptor is not None:
            try:
                os.fsync(self._descriptor)
            except OSError as error:
                log.warning("%s: %s", self.path, error.strerror)
            os.close(self._descriptor)

    def _write(self) -> None:
        """Write one block of whole packets, or leave the file as it was."""
        if not self._block:
            with self._lock:
                self._block, self._waiting = self._waiting, bytearray()
                self._block_packets, self._waiting_packets = self._waiting_packets, 0
        try:
            descriptor = self._opened()
            try:
                written = 0
                while written < len(self._block):
                    written += os.write(descriptor, memoryview(self._block)[written:])
            except OSError:
                os.ftruncate(descriptor, self._length)
                raise
        except OSError as error:
            self._failed(error)
            return
        self._length += len(self._block)
        with self._lock:
            self._packets += self._block_packets
            self._block, self._block_packets = bytearray(), 0
        if self._failing:
            self._failing = False
            self._tell(f"the telemetry log is written again; packets lost until now: {self._lost}")

    def _opened(self) -> int:
        if self._descriptor is None:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            descriptor = os.open(self.path, os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_CLOEXEC, 0o600)
            try:
                self._length = whole_length(self.path)
                os.ftruncate(descriptor, self._length)
            except OSError:
                os.close(descriptor)
                raise
            self._descriptor = descriptor
        return self._descriptor

    def _failed(self, error: OSError) -> None:
        self._try_at = self._clock() + TRY_AGAIN_S
        if not self._failing:
            self._failing = True
            full = error.errno in {errno.ENOSPC, errno.EDQUOT}
            why = "the disk is full: free some space" if full else (error.strerror or str(error))
            self._tell(f"the telemetry log cannot be written ({why}); the flight is not touched by it")


class TelemetryLogStore:
    """The folder `flights/` of a data directory, with one log a flight.

    Args:
        directory: the data directory.
    """

    def __init__(self, directory: Path) -> None:
        self._directory = directory / "flights"

    def open(self, flight_id: str, tell: Callable[[str], None]) -> TelemetryLog:
        """Begin a flight's log, or go on with it."""
        return TelemetryLog(self._directory / self.file_name(flight_id), tell)

    @staticmethod
    def file_name(flight_id: str) -> str:
        """The name of a flight's log.

        Raises:
            NotFoundError: this is no name of a flight.
        """
        return f"{checked_name(flight_id)}{SUFFIX}"

    def size_bytes(self, flight_id: str) -> int | None:
        """How long a flight's log is now; None when it has none."""
        try:
            return (self._directory / self.file_name(flight_id)).stat().st_size
        except OSError:
            return None

    def read(self, flight_id: str) -> tuple[int, Iterator[bytes]]:
        """A flight's log as it is now, also while it is being written.

        Returns:
            Its size in bytes, and as many bytes in pieces.

        Raises:
            NotFoundError: there is none.
        """
        path = self._directory / self.file_name(flight_id)
        size = self.size_bytes(flight_id)
        if size is None:
            raise NotFoundError("this flight has no telemetry log", field=flight_id)
        return size, _pieces(path, size)


def whole_length(path: Path) -> int:
    """Bytes of a log up to the end of its last whole packet; a killed process may leave part of one behind it."""
    size = path.stat().st_size
    end = 0
    with path.open("rb") as file:
        while head := file.read(_TIME.size + 3):
            if len(head) < _TIME.size + 3 or head[_TIME.size] not in _MARKERS:
                break
            marker, payload, flags = head[_TIME.size :]
            signature = _SIGNATURE if marker == 0xFD and flags & _SIGNED else 0
            following = end + _TIME.size + _MARKERS[marker] + payload + signature
            if following > size:
                break
            end = following
            file.seek(end)
    return end


def _pieces(path: Path, size: int) -> Iterator[bytes]:
    with path.open("rb") as file:
        left = size
        while left > 0:
            piece = file.read(min(left, CHUNK))
            if not piece:
                return
            left -= len(piece)
            yield piece
