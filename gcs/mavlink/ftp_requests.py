"""Requests of one MAVLink FTP exchange of which several wait for their answers at once: pieces read, or written."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from gcs.mavlink.ftp_protocol import FtpPayload
from gcs.mavlink.round_trip import RoundTrip
from gcs.mavlink.transaction import Clock


@dataclass(frozen=True)
class SentRequest:
    """A request that was not answered yet.

    Attributes:
        request: as it was sent.
        sent_at: clock time of the last sending.
        tries: how often it was sent again.
    """

    request: FtpPayload
    sent_at: float
    tries: int = 0


class RequestsUnderWay:
    """Keeps them by their numbers, and knows when each is to be sent again.

    Args:
        put: sends a request.
        clock: monotonic seconds.
        round_trip: says how long to wait, and is told how long answers took.
    """

    def __init__(self, put: Callable[[FtpPayload], None], clock: Clock, round_trip: RoundTrip) -> None:
        self._put = put
        self._clock = clock
        self._round_trip = round_trip
        self._sent: dict[int, SentRequest] = {}

    def __len__(self) -> int:
        return len(self._sent)

    @property
    def offsets(self) -> set[int]:
        """Where in the file the pieces are that are asked for."""
        return {sent.request.offset for sent in self._sent.values()}

    @property
    def deadline(self) -> float:
        """When the first is due again; infinite when there is none."""
        return min((self._due(sent) for sent in self._sent.values()), default=float("inf"))

    def send(self, request: FtpPayload) -> None:
        """Send a new one."""
        self._sent[request.sequence] = SentRequest(request, self._clock())
        self._put(request)

    def send_again(self, sent: SentRequest) -> None:
        """Send one again, unchanged."""
        self._sent[sent.request.sequence] = replace(sent, sent_at=self._clock(), tries=sent.tries + 1)
        self._put(sent.request)

    def due(self) -> list[SentRequest]:
        """Those that are to be sent again."""
        now = self._clock()
        return [sent for sent in self._sent.values() if now >= self._due(sent)]

    def answered(self, answer: FtpPayload) -> SentRequest | None:
        """The one that this answers, which waits no longer; None when it answers none."""
        sent = self._sent.pop((answer.sequence - 1) % (1 << 16), None)
        if sent is not None and sent.tries == 0:
            self._round_trip.measured(self._clock() - sent.sent_at)
        return sent

    def clear(self) -> None:
        """Wait for none any more."""
        self._sent.clear()

    def _due(self, sent: SentRequest) -> float:
        return sent.sent_at + self._round_trip.timeout_s(sent.tries)
