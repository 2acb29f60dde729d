"""MAVLink frames from untrusted bytes.

pymavlink's own buffer throws a whole claimed frame away when its checksum is wrong, and real frames inside it with it.
Here the search goes on right behind the false marker, so that garbage costs nothing but itself.
"""

from __future__ import annotations

import struct

from gcs.mavlink.dialect import Message, mavlink

MARKER_V1 = 0xFE
MARKER_V2 = 0xFD
SIGNED = 0x01


class FrameParser:
    """Turns a stream of bytes into messages; never raises, whatever the bytes are.

    Attributes:
        bad_bytes: how many bytes were no part of a good frame.
        unknown_messages: frames of message numbers that the dialect lacks.
    """

    def __init__(self) -> None:
        self._buffer = bytearray()
        self._codec = mavlink.MAVLink(None)
        self.bad_bytes = 0
        self.unknown_messages = 0

    def feed(self, data: bytes) -> list[Message]:
        """Take bytes as they came; returns the messages that are complete now."""
        self._buffer += data
        messages: list[Message] = []
        start = 0
        while True:
            start = self._skip_to_marker(start)
            length = self._frame_length(start)
            if length is None or len(self._buffer) - start < length:
                break
            message = self._decode(start, length)
            if message is None:
                self.bad_bytes += 1
                start += 1
                continue
            start += length
            if message.get_msgId() < 0:
                self.unknown_messages += 1
            else:
                messages.append(message)
        del self._buffer[:start]
        return messages

    def _skip_to_marker(self, start: int) -> int:
        buffer = self._buffer
        position = start
        while position < len(buffer) and buffer[position] not in (MARKER_V1, MARKER_V2):
            position += 1
        self.bad_bytes += position - start
        return position

    def _frame_length(self, start: int) -> int | None:
        """Length of the frame that is claimed at `start`; None while its head is incomplete."""
        if len(self._buffer) - start < 3:
            return None
        marker, payload, flags = self._buffer[start : start + 3]
        if marker == MARKER_V1:
            return int(payload) + 8
        return int(payload) + 12 + (13 if flags & SIGNED else 0)

    def _decode(self, start: int, length: int) -> Message | None:
        frame = self._buffer[start : start + length]
        if frame[0] == MARKER_V2:
            if frame[2] & ~SIGNED:
                return None
            number = frame[7] | frame[8] << 8 | frame[9] << 16
        else:
            number = frame[5]
        if number not in mavlink.mavlink_map:
            return mavlink.MAVLink_unknown(number, bytes(frame)) if self._followed_well(start + length) else None
        try:
            return self._codec.decode(frame)
        except (mavlink.MAVError, struct.error, ValueError, TypeError, IndexError):
            return None

    def _followed_well(self, after: int) -> bool:
        """The checksum of an unknown message cannot be checked: what follows must look like a frame, or be the end."""
        return after >= len(self._buffer) or self._buffer[after] in (MARKER_V1, MARKER_V2)


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
