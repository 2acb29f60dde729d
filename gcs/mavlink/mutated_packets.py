"""Packets as a broken or hostile vehicle might send them, for fuzzing the whole receive path.

Most have a right checksum, so that they get past the framing and into decoders and protocols; the others are cut, bent,
joined or of the wrong version.
"""

from __future__ import annotations

import random
import struct

import fastcrc

from gcs.mavlink.dialect import mavlink
from gcs.mavlink.received_message import LAYOUTS, MARKER_V1, MARKER_V2

_NAMES = (
    b"../../../../etc/passwd",
    b"..",
    b"/",
    b"//",
    b"/absolute/name.jpg",
    b"..\\..\\windows.jpg",
    b"name\0.jpg",
    b"mftp://../../x.jpg",
    b"mftp:/DCIM/../../up.jpg",
    b"\xff\xfe\xfd.jpg",
    b"a" * 240,
    b"D..\t0\0F../up.jpg\t4294967295\0F\t\t\0S\0",
    b"http://127.0.0.1/x.jpg",
    b"",
)
_FLOATS = (float("nan"), float("inf"), float("-inf"), 0.0, -0.0, 1e38, -1e38, 1e-45, 2.0**31, -1.0)
_INTEGERS = (0, 1, -1, 127, 128, 255, 256, 32767, 32768, 65535, 65536, 2**31 - 1, 2**31, 2**32 - 1, 2**63 - 1)
_FTP = int(mavlink.MAVLINK_MSG_ID_FILE_TRANSFER_PROTOCOL)
_FTP_HEADER = struct.Struct("<HBBBBBBI")
_FTP_REPLIES = (128, 129)
_ANSWERS = tuple(
    int(getattr(mavlink, f"MAVLINK_MSG_ID_{name}"))
    for name in (
        *("COMMAND_ACK", "PARAM_VALUE", "STATUSTEXT", "TUNNEL", "TIMESYNC", "AUTOPILOT_VERSION"),
        *("MISSION_COUNT", "MISSION_REQUEST", "MISSION_REQUEST_INT", "MISSION_ACK", "MISSION_ITEM_INT"),
        *("MISSION_CURRENT", "CAMERA_IMAGE_CAPTURED", "CAMERA_FEEDBACK", "CAMERA_CAPTURE_STATUS"),
        *("DATA_TRANSMISSION_HANDSHAKE", "ENCAPSULATED_DATA", "MISSION_ITEM_REACHED"),
    )
)
_SAID = tuple(
    int(getattr(mavlink, f"MAVLINK_MSG_ID_{name}"))
    for name in ("HEARTBEAT", "ATTITUDE", "LOCAL_POSITION_NED", "GLOBAL_POSITION_INT", "SYS_STATUS", "BATTERY_STATUS")
)
_COMPONENTS = (1, 1, 1, 100, 154, 0, 255)


class MutatedPackets:
    """Makes packets without end, the same ones for the same seed.

    Args:
        seed: of the choices.
        system_id: of the vehicle they pretend to come from.
        answers_only: only what answers questions, with numbers and clocks left alone: a station that notices that two
            send with one system id begins no exchange, and so would hear no answers.
    """

    def __init__(self, seed: int, system_id: int, *, answers_only: bool) -> None:
        self._rng = random.Random(seed)
        self._system_id = system_id
        self._answers_only = answers_only
        self._numbers = _ANSWERS if answers_only else _ANSWERS + _SAID
        self._all = _ANSWERS if answers_only else tuple(LAYOUTS)
        self._sequence = 0

    def next(self) -> bytes:
        """The next packet, or what once was one."""
        rng = self._rng
        choice = rng.random()
        if choice < 0.30:
            number = rng.choice(self._numbers)
            return self._frame(number, self._fields(number))
        if choice < 0.50:
            number = rng.choice(self._all)
            return self._frame(number, self._fields(number))
        if choice < 0.70:
            return self._frame(_FTP, self._ftp_reply())
        if choice < 0.80:
            return self._frame(rng.choice(self._all), rng.randbytes(rng.randrange(256)))
        if choice < 0.85:
            number = rng.choice(self._numbers)
            return self._frame(number, self._fields(number), version_1=True)
        number = rng.choice(self._numbers)
        return self._bent(self._frame(number, self._fields(number)))

    def _fields(self, number: int) -> bytes:
        """A payload of the right size, with ordinary, extreme and impossible values."""
        rng, unpacker = self._rng, LAYOUTS[number].unpacker
        values: list[object] = []
        for size, kind in _items(unpacker.format):
            if kind == "s":
                values.append((rng.choice(_NAMES) if rng.random() < 0.5 else rng.randbytes(size))[:size])
            elif kind in "fd":
                values.append(rng.choice(_FLOATS) if rng.random() < 0.6 else rng.uniform(-1000.0, 1000.0))
            else:
                bits = 8 * struct.calcsize(f"<{kind}")
                value = rng.choice(_INTEGERS) if rng.random() < 0.5 else rng.randrange(-4, 64)
                value &= (1 << bits) - 1
                values.append(value - (1 << bits) if kind.islower() and value >> (bits - 1) else value)
        return bytes(unpacker.pack(*values))

    def _ftp_reply(self) -> bytes:
        """An answer of a file server that lies about names, sizes and places."""
        rng = self._rng
        data = rng.choice(_NAMES) if rng.random() < 0.5 else rng.randbytes(rng.randrange(240))
        if rng.random() < 0.3:
            data = struct.pack("<I", rng.choice((0, 1, 5, 239, 2**31, 2**32 - 1)))
        size = len(data) if rng.random() < 0.7 else rng.randrange(256)
        asked = rng.choice((3, 4, 5, 15, 1, 2, 14, 7, 6, rng.randrange(256)))
        offset = rng.choice((0, 1, 239, 478, 2**31, 2**32 - 1, rng.randrange(5000)))
        kind = rng.choice(_FTP_REPLIES) if rng.random() < 0.9 else rng.randrange(256)
        head = _FTP_HEADER.pack(rng.randrange(64), rng.randrange(3), kind, size, asked, rng.randrange(2), 0, offset)
        return bytes((0, 255, 190)) + (head + data)[:251]

    def _frame(self, number: int, payload: bytes, *, version_1: bool = False) -> bytes:
        rng = self._rng
        system_id = self._system_id
        if not self._answers_only:
            self._sequence = (self._sequence + (1 if rng.random() < 0.95 else rng.randrange(256))) % 256
            system_id = system_id if rng.random() < 0.97 else rng.randrange(3, 256)
        sender = (self._sequence, system_id, rng.choice(_COMPONENTS))
        if version_1:
            head = bytes((MARKER_V1, len(payload), *sender, number & 0xFF))
            extra = LAYOUTS[number & 0xFF].checksum_extra if number & 0xFF in LAYOUTS else b"\0"
        else:
            head = bytes((MARKER_V2, len(payload), 0, 0, *sender)) + number.to_bytes(3, "little")
            extra = LAYOUTS[number].checksum_extra
        body = head + payload
        return body + int(fastcrc.crc16.mcrf4xx(body[1:] + extra)).to_bytes(2, "little")

    def _bent(self, packet: bytes) -> bytes:
        rng = self._rng
        choice = rng.randrange(5)
        if choice == 0:
            return packet[: rng.randrange(len(packet))]
        if choice == 1:
            return packet[rng.randrange(len(packet)) :] + packet
        if choice == 2:
            place = rng.randrange(len(packet))
            return packet[:place] + bytes((packet[place] ^ (1 << rng.randrange(8)),)) + packet[place + 1 :]
        if choice == 3:
            return packet[:1] + bytes((rng.randrange(256), rng.randrange(256))) + packet[3:]
        return rng.randbytes(rng.randrange(400))


def _items(layout: str) -> list[tuple[int, str]]:
    """The values of a struct's format, one by one: `<I2f10s` -> (1, I), (1, f), (1, f), (10, s)."""
    items: list[tuple[int, str]] = []
    digits = ""
    for letter in layout:
        if letter.isdigit():
            digits += letter
        elif letter != "<":
            count = int(digits or 1)
            items += [(count, letter)] if letter == "s" else [(1, letter)] * count
            digits = ""
    return items
