"""Messages of the replanning dialect as the payload of TUNNEL, which every autopilot and radio forwards.

A payload is the message's number (u16, little-endian), the byte CRC_EXTRA of its definition, and the message's own
payload as MAVLink 2 packs it, without trailing zeros.
"""

from __future__ import annotations

import struct
from typing import Any

from gcs.mavlink import replanning_dialect as replanning
from gcs.mavlink.dialect import Message, mavlink

__all__ = ["PAYLOAD_TYPE", "carried", "replanning", "text_of", "tunnelled"]

PAYLOAD_TYPE = 0x8247
_HEAD = struct.Struct("<HB")
_TUNNEL_BYTES = 128
_FRAME_HEAD = struct.Struct("<BBBBBBBHB")
_CHECKSUM = struct.Struct("<H")
_codec: Any = replanning.MAVLink(None)


def tunnelled(message: Message, target_system: int, target_component: int) -> Message:
    """The TUNNEL message that carries a message of the dialect; 0 as a target is everybody."""
    packet = message.pack(_codec)
    payload = _HEAD.pack(message.id, message.crc_extra) + packet[_FRAME_HEAD.size : -_CHECKSUM.size]
    return mavlink.MAVLink_tunnel_message(
        target_system, target_component, PAYLOAD_TYPE, len(payload), list(payload.ljust(_TUNNEL_BYTES, b"\0"))
    )


def carried(message: Message) -> Message | None:
    """The message of the dialect in a TUNNEL message, with its sender; None for all else and all that is malformed."""
    if message.get_type() != "TUNNEL" or message.payload_type != PAYLOAD_TYPE:
        return None
    payload = bytes(message.payload)[: message.payload_length]
    if not _HEAD.size < len(payload) == message.payload_length:
        return None
    number, checksum_extra = _HEAD.unpack_from(payload)
    kind = replanning.mavlink_map.get(number)
    if kind is None or kind.crc_extra != checksum_extra:
        return None
    body = payload[_HEAD.size :]
    sender = message.get_srcSystem(), message.get_srcComponent()
    frame = _FRAME_HEAD.pack(replanning.PROTOCOL_MARKER_V2, len(body), 0, 0, 0, *sender, number, 0) + body
    checksum = replanning.x25crc(frame[1:] + bytes([checksum_extra])).crc
    return _codec.decode(bytearray(frame + _CHECKSUM.pack(checksum)))


def text_of(field: str | bytes) -> str:
    """A text field of a message, for people: printable, without the zeros at its end."""
    text = field if isinstance(field, str) else field.decode("utf-8", "replace")
    return "".join(c if c.isprintable() else " " for c in text.rstrip("\0"))
