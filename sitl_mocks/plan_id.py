"""The opaque id by which PX4 names each of its lists: a CRC-32 of the items as they came over the wire.

pymavlink's dialects lack the fields that carry it (extensions of MISSION_ACK, MISSION_COUNT, MISSION_CURRENT), so they
are put behind the payload here.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterable

from sitl_mocks.dialect import Message, mavlink
from sitl_mocks.mission_items import StoredItem

_ITEM_INT = struct.Struct("<BHB4fiif")
_ITEM = struct.Struct("<BHB7f")
_ALL_BITS = 0xFFFFFFFF


def wire_form(message: Message) -> bytes:
    """The bytes of a MISSION_ITEM(_INT) that its list's id is made of."""
    packer = _ITEM_INT if message.get_type() == "MISSION_ITEM_INT" else _ITEM
    params = (message.param1, message.param2, message.param3, message.param4)
    return packer.pack(message.frame, message.command, message.autocontinue, *params, message.x, message.y, message.z)


def sent_frame(item: StoredItem) -> int | None:
    """The frame in which an item came over the wire; None of one that did not."""
    return item.wire[0] if item.wire else None


def plan_id(items: Iterable[StoredItem]) -> int:
    """The id of a list: PX4 starts the CRC at 0 and does not invert its end."""
    return zlib.crc32(b"".join(item.wire for item in items), _ALL_BITS) ^ _ALL_BITS


class _WithIds:
    """A message with 32-bit extension fields that the dialect lacks."""

    ids: tuple[int, ...] = ()

    def pack(self: Message, mav: Message, force_mavlink1: bool = False) -> bytes:
        payload = self.unpacker.pack(*(getattr(self, name) for name in self.ordered_fieldnames))
        extensions = b"" if force_mavlink1 else struct.pack(f"<{len(self.ids)}I", *self.ids)
        return bytes(self._pack(mav, self.crc_extra, payload + extensions, force_mavlink1=force_mavlink1))


class MissionAckWithId(_WithIds, mavlink.MAVLink_mission_ack_message):  # type: ignore[misc]
    """MISSION_ACK with `opaque_id`."""


class MissionCountWithId(_WithIds, mavlink.MAVLink_mission_count_message):  # type: ignore[misc]
    """MISSION_COUNT with `opaque_id`."""


class MissionCurrentWithIds(_WithIds, mavlink.MAVLink_mission_current_message):  # type: ignore[misc]
    """MISSION_CURRENT with `mission_id`, `fence_id` and `rally_points_id`."""
