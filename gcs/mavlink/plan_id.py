"""The opaque id by which a vehicle names each of its lists, where it does.

PX4's is a CRC-32 of the items as they came over the wire, so that the station knows it beforehand: equal ids, and equal
counts, mean that the vehicle took exactly what was sent. It travels in extension fields of MISSION_ACK, MISSION_COUNT
and MISSION_CURRENT that pymavlink's dialects lack, so it is read from the end of the payload. Checked on recorded
traffic of PX4 1.16/1.17.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Sequence

from gcs.core.mission import MissionItem
from gcs.mavlink.dialect import Message
from gcs.mavlink.mission_protocol import MissionType

_ITEM = struct.Struct("<BHB4fiif")
_ALL_BITS = 0xFFFFFFFF
_MARKER_V1 = 0xFE
_HEADER_V1, _HEADER_V2 = 6, 10
_LIST_ID_AT = {"MISSION_ACK": 4, "MISSION_COUNT": 5}
_IDS_OF_ALL = struct.Struct("<III")
_IDS_OF_ALL_AT = 6


def px4_plan_id(items: Sequence[MissionItem]) -> int:
    """The id that PX4 gives to a list sent as MISSION_ITEM_INT; its CRC-32 starts at 0 and its end is not inverted."""
    crc = _ALL_BITS
    for i in items:
        crc = zlib.crc32(_ITEM.pack(i.frame, i.command, i.autocontinue, *i.params, i.x, i.y, i.z), crc)
    return crc ^ _ALL_BITS


def told_plan_id(message: Message) -> int | None:
    """The id in a MISSION_ACK or a MISSION_COUNT; None when it carries none (the protocol's 0)."""
    packet, at = bytes(message.get_msgbuf()), _LIST_ID_AT[message.get_type()]
    (told,) = struct.unpack_from("<I", _payload(packet).ljust(at + 4, b"\0"), at)
    return int(told) or None


def told_list_ids(message: Message) -> dict[MissionType, int]:
    """The ids of all lists in a MISSION_CURRENT, 0 for each that has none; empty when it has no room for them."""
    packet = bytes(message.get_msgbuf())
    if packet[0] == _MARKER_V1:
        return {}
    end = _IDS_OF_ALL_AT + _IDS_OF_ALL.size
    ids = _IDS_OF_ALL.unpack_from(_payload(packet).ljust(end, b"\0"), _IDS_OF_ALL_AT)
    return dict(zip(MissionType, ids, strict=True))


def _payload(packet: bytes) -> bytes:
    header = _HEADER_V1 if packet[0] == _MARKER_V1 else _HEADER_V2
    return packet[header : header + packet[1]]
