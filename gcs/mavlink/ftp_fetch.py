"""Fetching a file over MAVLink FTP: burst reads, lost pieces asked for meanwhile, size and CRC-32 checked at the end.

    OPEN -> READ (a burst, and reads of what it left out) -> CLOSE -> CHECK (CRC-32 on the vehicle)

A fetch that breaks off leaves what it has in `partial`, with which a later one goes on. Nothing of the vehicle's is
trusted: sizes are bounded, data outside the file is ignored, and a file counts as whole only if its checksum agrees
(or the vehicle has none to offer, which the result says).
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass
from enum import Enum

from gcs.core.errors import GcsError, IncompleteError, LinkError, OperationCancelled, RefusedError
from gcs.mavlink.byte_gaps import ByteGaps
from gcs.mavlink.ftp_protocol import (
    CHUNK,
    FtpError,
    FtpPayload,
    OnBytes,
    Opcode,
    SequenceNumbers,
    checksum_agrees,
)
from gcs.mavlink.ftp_requests import RequestsUnderWay
from gcs.mavlink.ftp_transaction import TRIES, TRIES_FIRST, FtpTransaction
from gcs.mavlink.partial_file import PartialFile, PartKeeper
from gcs.mavlink.transaction import Clock, Send

MOST_BYTES = 64 << 20
_SILENCE_S = 15.0
"""Given up when no new byte comes for so long."""
_READS = 24
"""Reads under way at once: enough for a loss of 5 % at 50 ms and 2 MB/s."""
_READS_MADE_UP = 4
"""ArduPilot queues five requests and drops the rest."""
_LOST_SESSION = {FtpError.INVALID_SESSION, FtpError.FILE_NOT_FOUND}
"""What PX4 and ArduPilot say of a session that they have closed."""
_REORDERED = 8 * CHUNK
"""A gap so far behind the burst is taken for lost, not for late."""
_BURST_WORTH = 24 * CHUNK
"""Smaller gaps are read piece by piece."""
_RESTARTS = 3
_CHECK_PATIENCE = 8.0
"""A vehicle reads the whole file for its checksum."""


@dataclass(frozen=True)
class FetchedFile:
    """A whole file.

    Attributes:
        data: its bytes.
        crc32: CRC-32 of the bytes, as zlib computes it.
        confirmed: whether the vehicle's own checksum agreed; False when it has none to offer.
    """

    data: bytes
    crc32: int
    confirmed: bool


class BrokenFetchError(LinkError):
    """The link broke in the middle of a file.

    Args:
        partial: what came, to go on with; None when nothing is known of the file.
    """

    def __init__(self, message: str, partial: PartialFile | None) -> None:
        super().__init__(message)
        self.partial = partial


class FetchStep(Enum):
    """Where a fetch is."""

    OPEN = "opening"
    READ = "reading"
    CLOSE = "closing"
    CHECK = "comparing checksums"
    DONE = "finished"


class FetchFile(FtpTransaction[FetchedFile]):
    """Read a file.

    Args:
        path: the file on the vehicle.
        target_system: system id of the vehicle.
        target_component: the component that serves files.
        send: puts a message on the link.
        clock: monotonic seconds.
        sequence: numbers shared by all exchanges with this component.
        own_system: system id of the station.
        max_bytes: a larger file is refused.
        resume: what an earlier fetch of the same file left.
        keep: is given every piece that comes, besides those of `resume`.
        made_up: the vehicle makes the file up as it is read (ArduPilot's `@...` folders): the size that it announces is
            none, and its checksum may be that of another layout, so the end is looked for and nothing is compared.
        on_progress: told (bytes held, bytes in all).

    Raises (from `result`):
        NotFoundError: there is no such file.
        RefusedError: the file is too large, or the vehicle does not give it.
        IncompleteError: it arrived damaged again and again.
        BrokenFetchError: the vehicle stopped answering; it has what came.
        OperationCancelled: cancelled.
    """

    def __init__(
        self,
        path: str,
        target_system: int,
        target_component: int,
        send: Send,
        clock: Clock,
        *,
        sequence: SequenceNumbers | None = None,
        own_system: int | None = None,
        max_bytes: int = MOST_BYTES,
        resume: PartialFile | None = None,
        keep: PartKeeper | None = None,
        made_up: bool = False,
        on_progress: OnBytes | None = None,
    ) -> None:
        super().__init__(path, target_system, target_component, send, clock, sequence=sequence, own_system=own_system)
        self._max_bytes = max_bytes
        self._resume = resume
        self._keep = keep
        self._may_be_stale = False
        self._made_up = made_up
        self._most_tries = TRIES_FIRST if made_up else TRIES
        self._most_reads = _READS_MADE_UP if made_up else _READS
        self._on_progress = on_progress
        self._step = FetchStep.OPEN
        self._session = 0
        self._size = 0
        self._buffer = bytearray()
        self._gaps = ByteGaps([])
        self._shrunk = False
        self._reads = RequestsUnderWay(self._put_beside, clock, self._round_trip)
        self._burst: FtpPayload | None = None
        self._burst_heard_at = 0.0
        self._burst_end = 0
        self._burst_gave = False
        self._burst_works = True
        self._advanced_at = clock()
        self._restarts = 0
        self._was_reset = False

    @property
    def step(self) -> FetchStep:
        """Where the fetch is."""
        return self._step

    @property
    def partial(self) -> PartialFile | None:
        """What there is so far; None before the file was opened."""
        if not self._size or self._shrunk:
            return None
        return PartialFile(self._size, bytes(self._buffer), tuple(self._gaps), self._may_be_stale)

    @property
    def deadline(self) -> float:
        """Clock time at which `on_time` wants to be called next."""
        if self._step is not FetchStep.READ:
            return super().deadline
        if self._burst is None:
            return self._reads.deadline
        return min(self._reads.deadline, self._burst_heard_at + self._round_trip.timeout_s())

    def start(self) -> None:
        """Open the file."""
        self._open()

    def on_time(self) -> None:
        """Ask again for what is missing, or give up."""
        if self.finished:
            return
        if self._step is not FetchStep.READ:
            super().on_time()
            return
        now = self._clock()
        if now - self._advanced_at > _SILENCE_S:
            self._broken(f"the vehicle stopped in the middle of {self._path}")
            return
        if self._burst is not None and now >= self._burst_heard_at + self._round_trip.timeout_s():
            self._burst = None
        for read in self._reads.due():
            self._reads.send_again(read)
        self._pump()

    def cancel(self) -> None:
        """Close the file on the vehicle, without waiting for the answer, and end."""
        if self.finished:
            return
        if self._step is not FetchStep.OPEN:
            self._ask(Opcode.TERMINATE_SESSION, session=self._session)
        self._end(OperationCancelled(f"fetching {self._path} was cancelled"))

    def _answered(self, request: FtpPayload, answer: FtpPayload) -> None:
        if request.opcode == Opcode.OPEN_FILE_RO:
            self._on_open(answer)
        elif request.opcode == Opcode.RESET_SESSIONS:
            self._open()
        elif request.opcode == Opcode.TERMINATE_SESSION:
            self._on_closed()
        elif request.opcode == Opcode.CALC_FILE_CRC32:
            self._on_checksum(answer)

    def _unanswered(self, request: FtpPayload) -> None:
        if request.opcode == Opcode.TERMINATE_SESSION:
            self._on_closed()
        else:
            self._broken(f"the vehicle does not answer to file requests ({self._step.value} {self._path})")

    def _unasked(self, payload: FtpPayload) -> None:
        if self._step is not FetchStep.READ or payload.session != self._session:
            return
        if payload.request == Opcode.BURST_READ_FILE:
            self._on_burst(payload)
        elif payload.request == Opcode.READ_FILE:
            read = self._reads.answered(payload)
            if read is not None:
                self._on_read(read.request, payload)

    def _open(self) -> None:
        self._step = FetchStep.OPEN
        self._burst = None
        self._reads.clear()
        self._ask(Opcode.OPEN_FILE_RO, data=self._raw_path)

    def _on_open(self, answer: FtpPayload) -> None:
        error = answer.error
        if error in {FtpError.NO_SESSIONS_AVAILABLE, FtpError.FAIL} and not self._was_reset:
            # A fetch that was killed leaves its session open: vehicles have one or few.
            self._was_reset = True
            self._ask(Opcode.RESET_SESSIONS)
        elif error is not None:
            self._end(self._refusal(error, "open"))
        elif len(answer.data) < 4:
            self._end(RefusedError("the vehicle opened it without telling its size", field=self._path))
        else:
            self._begin_reading(answer.session, struct.unpack_from("<I", answer.data)[0])

    def _begin_reading(self, session: int, size: int) -> None:
        self._session = session
        size = self._max_bytes if self._made_up else size
        if size > self._max_bytes:
            self._ask(Opcode.TERMINATE_SESSION, session=session)
            self._end(RefusedError(f"it has {size} bytes, more than the {self._max_bytes} allowed", field=self._path))
            return
        same_file = size == self._size and not self._shrunk and not self._made_up
        if self._resume is not None and self._resume.size == size:
            self._buffer, self._gaps = bytearray(self._resume.data), ByteGaps(self._resume.gaps)
            self._may_be_stale = self._resume.may_be_stale
        elif not same_file:
            self._buffer, self._gaps = bytearray(size), ByteGaps([(0, size)])
            self._may_be_stale = False
            if self._keep is not None:
                self._keep.begin(size)
        self._resume = None
        self._size, self._shrunk = size, False
        self._step = FetchStep.READ
        self._advanced_at = self._clock()
        self._burst_works = True
        self._pump()

    def _on_burst(self, payload: FtpPayload) -> None:
        error = payload.error
        current = self._burst is not None and 0 < (payload.sequence - self._burst.sequence) % (1 << 16) < (1 << 15)
        if current:
            self._sequence.heard(payload.sequence)
        if error is None:
            new = self._take(payload)
            if current:
                self._burst_heard_at = self._clock()
                self._burst_gave = self._burst_gave or new > 0
                self._burst_end = max(self._burst_end, min(payload.offset + len(payload.data), len(self._buffer)))
                if payload.burst_complete:
                    self._burst = None
        elif self._burst is None or not current:
            return
        elif error in _LOST_SESSION:
            self._reopen()
            return
        else:
            self._on_burst_end(self._burst, payload)
        self._pump()

    def _on_burst_end(self, burst: FtpPayload, payload: FtpPayload) -> None:
        """The end of the file, or no bursts at all: what is missing is read piece by piece if this gave nothing."""
        ended = payload.error is FtpError.END_OF_FILE
        if ended and payload.offset > burst.offset and payload.offset >= self._burst_end:
            self._cut(payload.offset)
        self._burst_works = self._burst_gave and ended
        self._burst = None

    def _on_read(self, request: FtpPayload, payload: FtpPayload) -> None:
        error = payload.error
        if error in _LOST_SESSION:
            self._reopen()
            return
        if error is FtpError.END_OF_FILE or (error is None and not payload.data):
            self._cut(request.offset)
        elif error is not None:
            self._end(self._refusal(error, "read"))
            return
        else:
            self._take(payload)
        self._pump()

    def _cut(self, end: int) -> None:
        """The file ends here, whatever was announced."""
        self._shrunk = self._shrunk or end < self._size
        self._gaps.cut(end)
        del self._buffer[end:]

    def _take(self, payload: FtpPayload) -> int:
        """Put data in its place; returns how many bytes were new."""
        start = payload.offset
        end = min(start + len(payload.data), len(self._buffer))
        new = self._gaps.fill(start, end)
        if new:
            self._buffer[start:end] = payload.data[: end - start]
            if self._keep is not None:
                self._keep.add(start, payload.data[: end - start])
            self._advanced_at = self._clock()
            if self._on_progress is not None:
                try:
                    self._on_progress(len(self._buffer) - self._gaps.missing, len(self._buffer))
                except OperationCancelled:
                    self.cancel()
        return new

    def _pump(self) -> None:
        """Start a burst or reads for what is missing; close when nothing is."""
        if self.finished:
            return
        if not self._gaps:
            self._burst = None
            self._reads.clear()
            self._step = FetchStep.CLOSE
            self._ask(Opcode.TERMINATE_SESSION, session=self._session)
            return
        if self._burst is None and self._burst_works:
            large = next((a for a, b in self._gaps if b - a >= _BURST_WORTH), None)
            if large is not None:
                self._start_burst(large)
        limit = len(self._buffer) if self._burst is None else self._burst_end - _REORDERED
        asked = self._reads.offsets
        for start, end in self._gaps:
            for offset in range(start, min(end, limit), CHUNK):
                if len(self._reads) >= self._most_reads:
                    return
                if offset not in asked:
                    self._start_read(offset)

    def _start_burst(self, offset: int) -> None:
        self._burst = FtpPayload(self._sequence.next(), Opcode.BURST_READ_FILE, self._session, CHUNK, offset=offset)
        self._burst_heard_at, self._burst_end, self._burst_gave = self._clock(), offset, False
        self._put_beside(self._burst)

    def _start_read(self, offset: int) -> None:
        # Always a whole chunk, also for less: some servers allow one size a session.
        self._reads.send(FtpPayload(self._sequence.next(), Opcode.READ_FILE, self._session, CHUNK, offset=offset))

    def _reopen(self) -> None:
        """The vehicle lost the session (it restarted, perhaps): go on in a new one."""
        self._restarts += 1
        if self._restarts > _RESTARTS:
            self._end(IncompleteError("the vehicle closed it again and again while it was read", field=self._path))
        else:
            self._open()

    def _on_closed(self) -> None:
        if self._made_up:
            self._done(confirmed=False)
            return
        self._step = FetchStep.CHECK
        self._ask(Opcode.CALC_FILE_CRC32, data=self._raw_path, patience=_CHECK_PATIENCE)

    def _on_checksum(self, answer: FtpPayload) -> None:
        data = bytes(self._buffer)
        told = struct.unpack_from("<I", answer.data)[0] if answer.error is None and len(answer.data) >= 4 else None
        needs_none = told is None and not self._shrunk and not self._may_be_stale
        if needs_none or (told is not None and checksum_agrees(data, told)):
            self._done(confirmed=told is not None)
            return
        self._restarts += 1
        if self._restarts > _RESTARTS:
            self._end(IncompleteError("it arrived damaged again and again: its checksum differs", field=self._path))
        else:
            self._size, self._buffer, self._gaps = 0, bytearray(), ByteGaps([])
            self._open()

    def _done(self, *, confirmed: bool) -> None:
        data = bytes(self._buffer)
        self._step = FetchStep.DONE
        self._succeed(FetchedFile(data, zlib.crc32(data), confirmed))

    def _broken(self, message: str) -> None:
        self._end(BrokenFetchError(message, self.partial))

    def _end(self, error: GcsError) -> None:
        self._step = FetchStep.DONE
        self._fail_with(error)
