"""Writing a file over MAVLink FTP, several pieces under way at once.

    CREATE -> WRITE (all pieces, lost ones again) -> CLOSE

Some vehicles (ArduPilot's `@MISSION` folder) use the file only when it is closed, and say then whether they took it.
"""

from __future__ import annotations

from enum import Enum

from gcs.core.errors import GcsError, LinkError, OperationCancelled
from gcs.mavlink.ftp_protocol import CHUNK, FtpError, FtpPayload, OnBytes, Opcode, SequenceNumbers
from gcs.mavlink.ftp_requests import RequestsUnderWay
from gcs.mavlink.ftp_transaction import TRIES, TRIES_FIRST, FtpTransaction
from gcs.mavlink.transaction import Clock, Send

WRITES = 5
"""Pieces under way at once: ArduPilot queues five requests."""
_RESTARTS = 3
_CLOSE_PATIENCE = 4.0
"""A vehicle may use the whole file before it answers."""


class StoreStep(Enum):
    """Where a store is."""

    CREATE = "creating"
    WRITE = "writing"
    CLOSE = "closing"
    DONE = "finished"


class StoreFile(FtpTransaction[None]):
    """Write a file.

    Args:
        path: the file on the vehicle; what it held is replaced.
        target_system: system id of the vehicle.
        target_component: the component that serves files.
        send: puts a message on the link.
        clock: monotonic seconds.
        data: not empty.
        sequence: numbers shared by all exchanges with this component.
        own_system: system id of the station.
        on_progress: told (bytes written, bytes in all).

    Raises (from `result`):
        NotFoundError: there is no such file or folder.
        ConflictError: the vehicle serves somebody else.
        RefusedError: the vehicle does not take it.
        LinkError: the vehicle stopped answering; what it holds is unknown.
        OperationCancelled: cancelled; what it holds is unknown.
    """

    def __init__(
        self,
        path: str,
        target_system: int,
        target_component: int,
        send: Send,
        clock: Clock,
        *,
        data: bytes,
        sequence: SequenceNumbers | None = None,
        own_system: int | None = None,
        on_progress: OnBytes | None = None,
    ) -> None:
        super().__init__(path, target_system, target_component, send, clock, sequence=sequence, own_system=own_system)
        self._data = data
        self._on_progress = on_progress
        self._step = StoreStep.CREATE
        self._session = 0
        self._waiting: list[int] = []
        self._writes = RequestsUnderWay(self._put_beside, clock, self._round_trip)
        self._restarts = 0
        self._was_reset = False

    @property
    def step(self) -> StoreStep:
        """Where the store is."""
        return self._step

    @property
    def deadline(self) -> float:
        """Clock time at which `on_time` wants to be called next."""
        if self._step is not StoreStep.WRITE:
            return super().deadline
        return self._writes.deadline

    def start(self) -> None:
        """Create the file."""
        self._create()

    def on_time(self) -> None:
        """Send again what was not answered, or give up."""
        if self.finished:
            return
        if self._step is not StoreStep.WRITE:
            super().on_time()
            return
        for write in self._writes.due():
            if write.tries + 1 >= self._most_tries:
                self._end(LinkError(f"the vehicle stopped in the middle of {self._path}"))
                return
            self._writes.send_again(write)

    def cancel(self) -> None:
        """Close the file on the vehicle, without waiting for the answer, and end."""
        if self.finished:
            return
        if self._step is not StoreStep.CREATE:
            self._ask(Opcode.TERMINATE_SESSION, session=self._session)
        self._end(OperationCancelled(f"writing {self._path} was cancelled"))

    def _answered(self, request: FtpPayload, answer: FtpPayload) -> None:
        if request.opcode == Opcode.CREATE_FILE:
            self._on_created(answer)
        elif request.opcode == Opcode.RESET_SESSIONS:
            self._create()
        elif answer.error is None:
            self._step = StoreStep.DONE
            self._succeed(None)
        else:
            self._end(self._refusal(answer.error, "take"))

    def _unasked(self, payload: FtpPayload) -> None:
        if self._step is not StoreStep.WRITE or payload.request != Opcode.WRITE_FILE:
            return
        if self._writes.answered(payload) is None:
            return
        if payload.error in {FtpError.INVALID_SESSION, FtpError.FILE_NOT_FOUND} and self._restarts < _RESTARTS:
            self._restarts += 1
            self._create()
        elif payload.error is not None:
            self._end(self._refusal(payload.error, "take"))
        else:
            self._go_on()

    def _create(self) -> None:
        self._step = StoreStep.CREATE
        self._writes.clear()
        self._most_tries = TRIES_FIRST
        self._ask(Opcode.CREATE_FILE, data=self._raw_path)

    def _on_created(self, answer: FtpPayload) -> None:
        if answer.error in {FtpError.NO_SESSIONS_AVAILABLE, FtpError.FAIL} and not self._was_reset:
            # A transfer that was killed leaves its session open: vehicles have one or few.
            self._was_reset = True
            self._ask(Opcode.RESET_SESSIONS)
        elif answer.error is not None:
            self._end(self._refusal(answer.error, "take"))
        else:
            self._session, self._step = answer.session, StoreStep.WRITE
            self._most_tries = TRIES
            self._waiting = list(range(0, len(self._data), CHUNK))
            self._go_on()

    def _go_on(self) -> None:
        """Write the next pieces; close when all are written."""
        missing = len(self._waiting) + len(self._writes)
        if self._on_progress is not None:
            try:
                self._on_progress(max(0, len(self._data) - CHUNK * missing), len(self._data))
            except OperationCancelled:
                self.cancel()
                return
        while self._waiting and len(self._writes) < WRITES:
            offset = self._waiting.pop(0)
            data = self._data[offset : offset + CHUNK]
            number = self._sequence.next()
            self._writes.send(FtpPayload(number, Opcode.WRITE_FILE, self._session, len(data), offset=offset, data=data))
        if not missing:
            self._step = StoreStep.CLOSE
            self._ask(Opcode.TERMINATE_SESSION, session=self._session, patience=_CLOSE_PATIENCE)

    def _end(self, error: GcsError) -> None:
        self._step = StoreStep.DONE
        self._fail_with(error)
