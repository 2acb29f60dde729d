"""MAVLink frames from untrusted bytes.

pymavlink's own buffer throws a whole claimed frame away when its checksum is wrong, and real frames inside it with it.
Here the search goes on right behind the false marker, so that garbage costs nothing but itself. Only the header is read
and the checksum taken; fields are unpacked when somebody asks for them (`received_message`).
"""

from __future__ import annotations

import re

import fastcrc

from gcs.mavlink.dialect import Message, mavlink
from gcs.mavlink.received_message import (
    CHECKSUM,
    HEADER_V1,
    HEADER_V2,
    LAYOUTS,
    MARKER_V1,
    MARKER_V2,
    SIGNATURE,
    SIGNED,
    ReceivedMessage,
)

_checksum = fastcrc.crc16.mcrf4xx
_MARKERS = re.compile(b"[\xfd\xfe]")


class FrameParser:
    """Turns a stream of bytes into messages; never raises, whatever the bytes are.

    Attributes:
        bad_bytes: how many bytes were no part of a good frame.
        unknown_messages: frames of message numbers that the dialect lacks.
    """

    __slots__ = ("_rest", "bad_bytes", "unknown_messages")

    def __init__(self) -> None:
        self._rest = b""
        self.bad_bytes = 0
        self.unknown_messages = 0

    def feed(self, data: bytes) -> list[ReceivedMessage]:
        """Take bytes as they came; returns the messages that are complete now."""
        if self._rest:
            data = self._rest + data
        messages: list[ReceivedMessage] = []
        start, size = 0, len(data)
        while start < size:
            if data[start] not in (MARKER_V2, MARKER_V1):
                start = self._next_marker(data, start)
                continue
            length = _frame_length(data, start)
            if length is None or size - start < length:
                break
            frame = data if length == size else data[start : start + length]
            message = _message(frame)
            if message is not None:
                messages.append(message)
                start += length
            elif _is_unknown(frame) and self._followed_well(data, start + length):
                self.unknown_messages += 1
                start += length
            else:
                self.bad_bytes += 1
                start += 1
        self._rest = data[start:]
        return messages

    def feed_datagram(self, data: bytes) -> list[ReceivedMessage]:
        """Take a datagram: like `feed`, but one that begins with a frame shows that what is left of the last was none.

        What was left may be a frame that was cut, or a false marker with frames behind it. Bridges that cut a serial
        stream at will go on with it instead.
        """
        if not self._rest and len(data) > HEADER_V2 and data[0] == MARKER_V2 and not data[2]:
            message = _message(data) if len(data) == data[1] + HEADER_V2 + CHECKSUM else None
            if message is not None:  # by far the most: one packet, whole and unsigned
                return [message]
        hidden = self._give_up_rest() if self._rest and _begins_with_frame(data) else []
        return hidden + self.feed(data)

    def _give_up_rest(self) -> list[ReceivedMessage]:
        hidden: list[ReceivedMessage] = []
        while self._rest:
            behind, self._rest = self._rest[1:], b""
            self.bad_bytes += 1
            hidden += self.feed(behind)
        return hidden

    def _next_marker(self, data: bytes, start: int) -> int:
        found = _MARKERS.search(data, start)
        position = len(data) if found is None else found.start()
        self.bad_bytes += position - start
        return position

    @staticmethod
    def _followed_well(data: bytes, after: int) -> bool:
        """The checksum of an unknown message cannot be checked: what follows must look like a frame, or be the end."""
        return after >= len(data) or data[after] in (MARKER_V1, MARKER_V2)


def _frame_length(data: bytes, start: int) -> int | None:
    """Length of the frame that is claimed at `start`; None while its head is incomplete."""
    if len(data) - start < 3:
        return None
    if data[start] == MARKER_V1:
        return data[start + 1] + HEADER_V1 + CHECKSUM
    return data[start + 1] + HEADER_V2 + CHECKSUM + (SIGNATURE if data[start + 2] & SIGNED else 0)


def _begins_with_frame(data: bytes) -> bool:
    if not data or data[0] not in (MARKER_V2, MARKER_V1):
        return False
    length = _frame_length(data, 0)
    return length is not None and length <= len(data) and _message(data[:length]) is not None


def _message(frame: bytes) -> ReceivedMessage | None:
    """The message of a frame; None when the dialect lacks it, its checksum is wrong, or it asks for what is unknown."""
    end = frame[1]
    if frame[0] == MARKER_V2:
        if frame[2] & ~SIGNED:
            return None
        end += HEADER_V2
        number = frame[7] | frame[8] << 8 | frame[9] << 16
        sequence, system_id, component_id = frame[4], frame[5], frame[6]
    else:
        end += HEADER_V1
        sequence, system_id, component_id, number = frame[2], frame[3], frame[4], frame[5]
    layout = LAYOUTS.get(number)
    if layout is None or _checksum(frame[1:end] + layout.checksum_extra) != frame[end] | frame[end + 1] << 8:
        return None
    return ReceivedMessage(frame, number, layout, sequence, system_id, component_id)


def _is_unknown(frame: bytes) -> bool:
    if frame[0] == MARKER_V1:
        return frame[5] not in LAYOUTS
    return not frame[2] & ~SIGNED and frame[7] | frame[8] << 8 | frame[9] << 16 not in LAYOUTS


class FramePacker:
    """Numbers and packs outgoing messages of one sender to one peer; one thread at a time.

    Args:
        system_id: of this station.
        component_id: of this station.
    """

    def __init__(self, system_id: int, component_id: int) -> None:
        self._codec = mavlink.MAVLink(None, srcSystem=system_id, srcComponent=component_id)

    def pack(self, message: Message) -> bytes:
        """The frame of a message (MAVLink 2, unsigned)."""
        frame = bytes(message.pack(self._codec))
        self._codec.seq = (self._codec.seq + 1) % 256
        return frame
