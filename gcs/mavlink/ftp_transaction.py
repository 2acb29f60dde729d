"""What all MAVLink FTP exchanges share: numbered requests that are sent again unchanged until they are answered."""

from __future__ import annotations

from abc import abstractmethod
from typing import TypeVar

from gcs.core.errors import ConflictError, GcsError, LinkError, NotFoundError, RefusedError
from gcs.mavlink.dialect import Message
from gcs.mavlink.ftp_protocol import (
    FtpError,
    FtpPayload,
    Opcode,
    SequenceNumbers,
    decode,
    encode_path,
    error_words,
    ftp_message,
)
from gcs.mavlink.round_trip import RoundTrip
from gcs.mavlink.transaction import Clock, Send, Transaction

R = TypeVar("R")

TIMEOUT_S = 0.25
LONGEST_TIMEOUT_S = 1.5
TRIES = 15
TRIES_FIRST = 6
"""For the first request where there is another way to get what is wanted."""


class FtpTransaction(Transaction[R]):
    """Base of the exchanges with a component that serves files.

    Args:
        path: of the file or folder on the vehicle.
        target_system: system id of the vehicle.
        target_component: the component that serves files (the autopilot, or a camera).
        send: puts a message on the link.
        clock: monotonic seconds.
        sequence: numbers shared by all exchanges with this component.
        own_system: system id of the station; when given, answers meant for another station are ignored.
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
    ) -> None:
        super().__init__(send, clock)
        self._path = path
        self._raw_path = encode_path(path)
        self._target = (target_system, target_component)
        self._own_system = own_system
        self._sequence = sequence if sequence is not None else SequenceNumbers()
        self._pending: FtpPayload | None = None
        self._sent_at = 0.0
        self._tries = 0
        self._most_tries = TRIES
        self._patience = 1.0
        self._round_trip = RoundTrip(TIMEOUT_S, LONGEST_TIMEOUT_S)

    @property
    def deadline(self) -> float:
        """Clock time at which `on_time` wants to be called next."""
        return self._sent_at + self._round_trip.timeout_s(self._tries, self._patience)

    def handle(self, message: Message) -> None:
        """Take an answer; anything else is ignored."""
        if self.finished or message.get_type() != "FILE_TRANSFER_PROTOCOL":
            return
        if (message.get_srcSystem(), message.get_srcComponent()) != self._target:
            return
        if self._own_system is not None and message.target_system not in {0, self._own_system}:
            return
        payload = decode(message)
        if payload is None or payload.opcode not in {Opcode.ACK, Opcode.NAK}:
            return
        pending = self._pending
        if (
            pending is not None
            and payload.request == pending.opcode
            and payload.sequence == (pending.sequence + 1) % (1 << 16)
        ):
            if self._tries == 0:
                self._round_trip.measured(self._clock() - self._sent_at)
            self._pending = None
            self._answered(pending, payload)
        else:
            self._unasked(payload)

    def on_time(self) -> None:
        """Send the request again, unchanged, so that the vehicle can see that it is the same; or give up."""
        if self.finished or self._pending is None:
            return
        self._tries += 1
        if self._tries >= self._most_tries:
            self._unanswered(self._pending)
        else:
            self._put(self._pending)

    @abstractmethod
    def _answered(self, request: FtpPayload, answer: FtpPayload) -> None:
        """The pending request was answered; none is pending now."""

    def _unasked(self, payload: FtpPayload) -> None:
        """A payload that does not answer the pending request: burst data, or a doubled packet."""

    def _unanswered(self, request: FtpPayload) -> None:
        """The pending request was sent often enough."""
        del request
        self._fail(LinkError("the vehicle does not answer to file requests"))

    def _ask(
        self,
        opcode: Opcode,
        *,
        session: int = 0,
        size: int | None = None,
        offset: int = 0,
        data: bytes = b"",
        patience: float = 1.0,
    ) -> None:
        """Send a new request and wait for its answer; `patience` stretches the waiting."""
        size = len(data) if size is None else size
        self._pending = FtpPayload(self._sequence.next(), opcode, session, size, offset=offset, data=data)
        self._tries, self._patience = 0, patience
        self._put(self._pending)

    def _put(self, payload: FtpPayload) -> None:
        self._sent_at = self._clock()
        self._put_beside(payload)

    def _put_beside(self, payload: FtpPayload) -> None:
        """Send something that the pending request's timer is not for."""
        self._send(ftp_message(payload, *self._target))

    def _refusal(self, error: FtpError, does_not: str, noun: str = "file") -> GcsError:
        """What an error of the vehicle means for people, who are told what it does not do."""
        if error is FtpError.NO_SESSIONS_AVAILABLE:
            return ConflictError("the vehicle serves files to somebody else; try again later", field=self._path)
        if error is FtpError.FILE_NOT_FOUND:
            return NotFoundError(f"the vehicle has no such {noun}", field=self._path)
        return RefusedError(f"the vehicle does not {does_not} it: {error_words(error)}", field=self._path)

    def _fail_with(self, error: GcsError) -> None:
        self._pending = None
        self._fail(error)
