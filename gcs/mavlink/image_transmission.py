"""The camera's newest picture by DATA_TRANSMISSION_HANDSHAKE and ENCAPSULATED_DATA, for cameras that serve no files.

https://mavlink.io/en/services/image_transmission.html. The protocol cannot ask for single packets and has no
checksum. So the picture is asked for again while packets are missing, and what came in different passes is put together
only if the packets that both have are the same and at least half of the newer pass; behind the last of them, which
vouches for what comes before it, all is taken of one pass. In a compressed picture nothing is the same behind the first
difference, so that two of one size are not mixed. In one that is not (bmp, pgm) whole rows may be the same, black ones,
say: there a newer picture that is the same in every packet that both passes brought would pass for the older one.

    ASK (handshake with size 0) -> PASS (packets, until the last one or silence) -> ASK ... -> DONE
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

from gcs.core.errors import GcsError, IncompleteError, LinkError, NotFoundError, OperationCancelled, RefusedError
from gcs.mavlink.dialect import Message, mavlink
from gcs.mavlink.ftp_protocol import OnBytes
from gcs.mavlink.round_trip import RoundTrip
from gcs.mavlink.transaction import Clock, Send, Transaction

MOST_BYTES = 65_535 * 253
"""What the protocol can number."""
_TIMEOUT_S, _LONGEST_TIMEOUT_S = 0.4, 2.0
_ASKS = 8
"""A handshake that stays unanswered so often is given up."""
_PASSES = 40
_STALLED_PASSES = 8
"""So many passes without any new packet are given up."""
_LATE_S = 0.1
"""Packets that were overtaken by the last one are waited for so long."""
_LONGEST_PACKET = 253
_SUFFIXES = {
    mavlink.MAVLINK_DATA_STREAM_IMG_JPEG: "jpg",
    mavlink.MAVLINK_DATA_STREAM_IMG_BMP: "bmp",
    mavlink.MAVLINK_DATA_STREAM_IMG_PGM: "pgm",
    mavlink.MAVLINK_DATA_STREAM_IMG_PNG: "png",
}
_BEGINNINGS = {"jpg": b"\xff\xd8\xff", "bmp": b"BM", "pgm": b"P5", "png": b"\x89PNG"}


class TransmissionStep(Enum):
    """Where a request is."""

    ASK = "asking"
    PASS = "receiving"
    DONE = "finished"


@dataclass(frozen=True)
class TransmittedImage:
    """A whole picture.

    Attributes:
        data: its file.
        suffix: `jpg`, `png`, `bmp` or `pgm`.
        passes: how often it was sent.
    """

    data: bytes
    suffix: str
    passes: int


@dataclass(frozen=True)
class _Announcement:
    suffix: str
    size: int
    packets: int
    payload: int


class RequestImage(Transaction[TransmittedImage]):
    """Have a camera send its newest picture.

    Args:
        source: system and component of the camera; packets of others are ignored.
        send: puts a message on the link.
        clock: monotonic seconds.
        max_bytes: a larger picture is refused.
        on_progress: told (bytes held, bytes in all).

    Raises (from `result`):
        NotFoundError: it has no picture.
        RefusedError: the picture is too large, or of no kind that is known.
        IncompleteError: it did not arrive whole, however often it was sent.
        LinkError: the camera does not answer, or fell silent.
        OperationCancelled: cancelled.
    """

    def __init__(
        self,
        source: tuple[int, int],
        send: Send,
        clock: Clock,
        *,
        max_bytes: int = MOST_BYTES,
        on_progress: OnBytes | None = None,
    ) -> None:
        super().__init__(send, clock)
        self._source = source
        self._max_bytes = max_bytes
        self._on_progress = on_progress
        self._step = TransmissionStep.ASK
        self._round_trip = RoundTrip(_TIMEOUT_S, _LONGEST_TIMEOUT_S)
        self._announced: _Announcement | None = None
        self._held: dict[int, bytes] = {}
        self._fresh: dict[int, bytes] = {}
        self._last_came = False
        self._asks = 0
        self._passes = 0
        self._stalled = 0
        self._asked_at = 0.0
        self._heard_at = 0.0

    @property
    def step(self) -> TransmissionStep:
        """Where the request is."""
        return self._step

    @property
    def deadline(self) -> float:
        """Clock time at which `on_time` wants to be called next."""
        if self._step is not TransmissionStep.PASS:
            return self._asked_at + self._round_trip.timeout_s(self._asks)
        return self._heard_at + (_LATE_S if self._last_came else self._round_trip.timeout_s())

    def start(self) -> None:
        """Ask for the picture."""
        self._ask()

    def handle(self, message: Message) -> None:
        """Take a packet of the camera; anything else is ignored."""
        if self.finished or (message.get_srcSystem(), message.get_srcComponent()) != self._source:
            return
        kind = message.get_type()
        if kind == "DATA_TRANSMISSION_HANDSHAKE":
            self._on_handshake(message)
        elif kind == "ENCAPSULATED_DATA" and self._announced is not None and self._step is TransmissionStep.PASS:
            self._on_data(message, self._announced)

    def on_time(self) -> None:
        """Ask again for what did not come, or give up."""
        if self.finished:
            return
        if self._step is TransmissionStep.PASS:
            self._end_pass()
        elif self._asks >= _ASKS:
            held = "" if self._announced is None else " in the middle of it"
            self._end(LinkError(f"the camera does not answer when asked for its picture{held}"))
        else:
            self._ask()

    def cancel(self) -> None:
        """End; the protocol has no word for it, and the camera sends to the end of its picture."""
        if not self.finished:
            self._end(OperationCancelled("receiving the picture was cancelled"))

    def _ask(self) -> None:
        self._step = TransmissionStep.ASK
        self._asks += 1
        self._asked_at = self._clock()
        self._send(
            mavlink.MAVLink_data_transmission_handshake_message(
                mavlink.MAVLINK_DATA_STREAM_IMG_JPEG, 0, 0, 0, 0, 0, 100
            )
        )

    def _on_handshake(self, message: Message) -> None:
        if self._step is not TransmissionStep.ASK:
            return  # doubled
        if message.size == 0 or message.packets == 0:
            self._end(NotFoundError("the camera has no picture to send"))
            return
        announced = self._checked(message)
        if announced is None:
            return
        if self._asks == 1:
            self._round_trip.measured(self._clock() - self._asked_at)
        if announced != self._announced:
            self._announced = announced
            self._held = {}
        self._fresh = {}
        self._last_came = False
        self._asks = 0
        self._passes += 1
        self._heard_at = self._clock()
        self._step = TransmissionStep.PASS

    def _checked(self, message: Message) -> _Announcement | None:
        """What is announced, if that is possible."""
        suffix = _SUFFIXES.get(message.type)
        size, packets, payload = message.size, message.packets, message.payload
        if suffix is None:
            self._end(RefusedError(f"the camera's picture is of a kind (type {message.type}) that is not stored"))
        elif size > self._max_bytes:
            self._end(RefusedError(f"the camera's picture has {size} bytes, more than the {self._max_bytes} allowed"))
        elif not 0 < payload <= _LONGEST_PACKET or packets != math.ceil(size / payload):
            self._end(RefusedError(f"the camera announces {size} bytes as {packets} packets of {payload}"))
        else:
            return _Announcement(suffix, size, packets, payload)
        return None

    def _on_data(self, message: Message, announced: _Announcement) -> None:
        number = message.seqnr
        if number >= announced.packets:
            return
        self._heard_at = self._clock()
        self._fresh[number] = bytes(message.data)[: min(announced.payload, announced.size - number * announced.payload)]
        self._last_came = self._last_came or number == announced.packets - 1
        self._tell(announced)
        if not self.finished and len(self._fresh) == announced.packets:
            self._end_pass()

    def _tell(self, announced: _Announcement) -> None:
        if self._on_progress is None:
            return
        packets = max(len(self._fresh), len(self._held))
        try:
            self._on_progress(min(packets * announced.payload, announced.size), announced.size)
        except OperationCancelled:
            self.cancel()

    def _end_pass(self) -> None:
        """The camera has sent all of it: take what came, and ask again if that is not enough."""
        announced = self._announced
        if announced is None:
            return
        before = len(self._held)
        self._held = _joined(self._held, self._fresh)
        self._stalled = 0 if len(self._held) > before else self._stalled + 1
        if len(self._held) == announced.packets:
            self._finish(announced)
        elif self._passes >= _PASSES or self._stalled >= _STALLED_PASSES:
            self._end(
                IncompleteError(
                    f"the picture did not arrive whole: {len(self._held)} of {announced.packets} packets in "
                    f"{self._passes} passes"
                )
            )
        else:
            self._ask()

    def _finish(self, announced: _Announcement) -> None:
        data = b"".join(self._held[number] for number in range(announced.packets))
        if not data.startswith(_BEGINNINGS[announced.suffix]):
            self._end(IncompleteError(f"what the camera sent does not begin like a {announced.suffix} file"))
            return
        self._step = TransmissionStep.DONE
        self._succeed(TransmittedImage(data, announced.suffix, self._passes))

    def _end(self, error: GcsError) -> None:
        self._step = TransmissionStep.DONE
        self._fail(error)


def _joined(held: dict[int, bytes], fresh: dict[int, bytes]) -> dict[int, bytes]:
    """The packets of two passes, if they are of one picture; else those of the newer picture, or of the fuller pass."""
    both = held.keys() & fresh.keys()
    if any(held[n] != fresh[n] for n in both):
        return fresh
    if not both or 2 * len(both) < len(fresh):
        return max(held, fresh, key=len)
    last = max(both)
    ends = max(({n: data for n, data in each.items() if n > last} for each in (held, fresh)), key=len)
    return {n: data for n, data in (held | fresh).items() if n <= last} | ends
