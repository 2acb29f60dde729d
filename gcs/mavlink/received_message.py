"""A message as it was received: its header read, its fields unpacked only when somebody asks for one.

It answers to what pymavlink's messages answer to (`get_type()`, `get_srcSystem()`, fields as attributes), at a tenth of
the price for a message that nobody wants. Most of what a hundred vehicles send is of that kind.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from struct import Struct, calcsize
from typing import Any

from gcs.mavlink.dialect import mavlink

MARKER_V1 = 0xFE
MARKER_V2 = 0xFD
SIGNED = 0x01
"""Of the incompatibility flags: a signature follows the checksum."""
HEADER_V1 = 6
HEADER_V2 = 10
CHECKSUM = 2
SIGNATURE = 13


@dataclass(frozen=True)
class Layout:
    """How a kind of message lies on the wire.

    Attributes:
        name: such as `HEARTBEAT`.
        checksum_extra: the byte that ends every checksum of this kind, so that no other definition of it is taken.
        unpacker: of the whole payload.
        fields: name -> first place among the unpacked values, number of values (0: no array), whether it is text.
        numbers: the names in the order of the unpacked values, if each field is a single number; else empty.
    """

    name: str
    checksum_extra: bytes
    unpacker: Struct
    fields: dict[str, tuple[int, int, bool]]
    numbers: tuple[str, ...]

    def values(self, payload: bytes) -> dict[str, Any]:
        """All fields of a payload, which may be shorter or longer than the dialect's."""
        if len(payload) < self.unpacker.size:
            payload = payload.ljust(self.unpacker.size, b"\0")
        unpacked = self.unpacker.unpack_from(payload)
        if self.numbers:
            return dict(zip(self.numbers, unpacked, strict=True))
        return {name: _value(unpacked, *where) for name, where in self.fields.items()}


def _value(unpacked: tuple[Any, ...], place: int, count: int, is_text: bool) -> Any:
    if count:
        return list(unpacked[place : place + count])
    if is_text:
        return unpacked[place].split(b"\0", 1)[0].decode("ascii", errors="replace")
    return unpacked[place]


def _layout(kind: Any) -> Layout:
    fields = {}
    for name, order, of_type in zip(kind.fieldnames, kind.orders, kind.fieldtypes, strict=True):
        place, count = sum(kind.lengths[:order]), kind.lengths[order]
        fields[name] = (place, 0 if count == 1 or of_type == "char" else count, of_type == "char")
    numbers = () if any(count or is_text for _, count, is_text in fields.values()) else tuple(kind.ordered_fieldnames)
    return Layout(kind.msgname, bytes([kind.crc_extra]), kind.unpacker, fields, numbers)


def _boot_ms_at(kind: Any) -> int:
    """Where `time_boot_ms` begins in a payload."""
    parts = re.findall(r"\d*[a-zA-Z]", kind.unpacker.format)
    return calcsize("<" + "".join(parts[: kind.ordered_fieldnames.index("time_boot_ms")]))


LAYOUTS: dict[int, Layout] = {number: _layout(kind) for number, kind in mavlink.mavlink_map.items()}
"""By message number: all that the dialect has."""
_BOOT_MS_AT = {
    number: _boot_ms_at(kind) for number, kind in mavlink.mavlink_map.items() if "time_boot_ms" in kind.fieldnames
}
CHECKSUM_EXTRAS: dict[int, bytes] = {number: layout.checksum_extra for number, layout in LAYOUTS.items()}


class ReceivedMessage:
    """One message of the dialect, out of a frame whose checksum was right.

    Its own attributes have names that no field of the dialect has. The fields become attributes when one is asked for.

    Attributes:
        packet: the whole of it, as it was on the wire.
        message_number: which message of the dialect it is.
        layout: of that message.
        running_number: that its sender gave it, modulo 256.
        from_system: system id of its sender.
        from_component: component id of its sender.
    """

    __slots__ = ("__dict__", "from_component", "from_system", "layout", "message_number", "packet", "running_number")

    def __init__(
        self,
        packet: bytes,
        message_number: int,
        layout: Layout,
        running_number: int,
        from_system: int,
        from_component: int,
    ) -> None:
        self.packet = packet
        self.message_number = message_number
        self.layout = layout
        self.running_number = running_number
        self.from_system = from_system
        self.from_component = from_component

    @property
    def is_signed(self) -> bool:
        """Whether it carries a signature, of whatever worth."""
        return self.packet[0] == MARKER_V2 and bool(self.packet[2] & SIGNED)

    @property
    def boot_s(self) -> float:
        """Its `time_boot_ms` in seconds; asked of so many messages that the other fields stay packed."""
        at = _BOOT_MS_AT[self.message_number]
        return int.from_bytes(self.get_payload()[at : at + 4], "little") * 1e-3

    def __getattr__(self, name: str) -> Any:
        """A field that is asked for before any other was."""
        if name not in self.layout.fields:
            raise AttributeError(f"{self.get_type()} has no field {name!r}")
        fields = self.__dict__
        fields.update(self.layout.values(self.get_payload()))
        return fields[name]

    def __repr__(self) -> str:
        fields = ", ".join(f"{name}={getattr(self, name)!r}" for name in self.layout.fields)
        return f"{self.get_type()}({fields})"

    def get_type(self) -> str:
        """Name of the message."""
        return self.layout.name

    def get_msgId(self) -> int:  # noqa: N802 - pymavlink's names, as its messages are taken in the same places
        """Number of the message."""
        return self.message_number

    def get_srcSystem(self) -> int:  # noqa: N802
        """System id of its sender."""
        return self.from_system

    def get_srcComponent(self) -> int:  # noqa: N802
        """Component id of its sender."""
        return self.from_component

    def get_seq(self) -> int:
        """Number that its sender gave it, modulo 256."""
        return self.running_number

    def get_msgbuf(self) -> bytes:
        """The whole packet."""
        return self.packet

    def get_payload(self) -> bytes:
        """Its fields as they came: trailing zeros are cut off, and a newer definition has more than the dialect."""
        packet = self.packet
        start = HEADER_V2 if packet[0] == MARKER_V2 else HEADER_V1
        return packet[start : start + packet[1]]
