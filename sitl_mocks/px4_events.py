"""EVENT messages of the PX4-like vehicle: what it tells of in numbers, on every link.

Numbers and log levels are those that were recorded from a real one; pymavlink's dialects lack the message.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass

from sitl_mocks.dialect import Message, mavlink

EVENT = 410
_CRC_EXTRA = 160
_PAYLOAD = struct.Struct("<IIHBBB40s")


@dataclass(frozen=True)
class Event:
    """What is told.

    Attributes:
        number: of the event.
        levels: of the external and the internal log, a nibble each.
        arguments: packed.
    """

    number: int
    levels: int
    arguments: bytes = b""


ITEM_REFUSED = Event(0x01FEB270, 0x33)
NOT_FLYABLE = Event(0x01FE4222, 0x63)
"""Recorded of a take-off that is not the first place. Told here of every flaw of a mission without a number known."""


def unsupported_command(sequence: int, command: int) -> Event:
    """An item was taken whose command the mission cannot be flown with."""
    return Event(0x0185E823, 0x43, struct.pack("<HH", sequence + 1, command))


class EventMessage(mavlink.MAVLink_message):  # type: ignore[misc]
    """EVENT to everybody.

    Args:
        event: what is told.
        boot_ms: when.
        sequence: number of the message.
    """

    def __init__(self, event: Event, boot_ms: int, sequence: int) -> None:
        super().__init__(EVENT, "EVENT")
        self._event_payload = _PAYLOAD.pack(event.number, boot_ms, sequence, 0, 0, event.levels, event.arguments)

    def pack(self, mav: Message, force_mavlink1: bool = False) -> bytes:
        """The packet; there is none of MAVLink 1."""
        return b"" if force_mavlink1 else bytes(self._pack(mav, _CRC_EXTRA, self._event_payload))


class Px4Events:
    """Numbers the events and sends them.

    Args:
        broadcast: sends a message on every link.
        boot_ms: the vehicle's clock.
    """

    def __init__(self, broadcast: Callable[[Message], None], boot_ms: Callable[[], int]) -> None:
        self._broadcast = broadcast
        self._boot_ms = boot_ms
        self._sequence = 0

    def tell(self, event: Event) -> None:
        """Send an event."""
        self._broadcast(EventMessage(event, self._boot_ms(), self._sequence))
        self._sequence = (self._sequence + 1) % 2**16
