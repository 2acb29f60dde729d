"""A mission, fence or list of rally points as one file: ArduPilot's `@MISSION/*.dat`.

Little-endian: u16 magic 0x763d, u16 MAV_MISSION_TYPE, u16 options (bit 0: keep what is there), u16 number of the first
item, u16 number of items; then 38 bytes an item, which are the untruncated payload of MISSION_ITEM_INT.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence

from gcs.core.errors import IncompleteError, InputError
from gcs.core.mission import MissionItem
from gcs.mavlink.mission_protocol import MissionType

MAGIC = 0x763D
_HEADER = struct.Struct("<5H")
_ITEM = struct.Struct("<4f2if2H6B")
ITEM_BYTES = _ITEM.size
HEADER_BYTES = _HEADER.size


def encode_mission_file(items: Sequence[MissionItem], mission_type: MissionType, target: tuple[int, int]) -> bytes:
    """The file that replaces a list.

    Args:
        items: numbered 0 to n - 1.
        mission_type: which list.
        target: system and component that it is for.

    Raises:
        InputError: more items than the format can count, or a number that does not fit.
    """
    if len(items) > 0xFFFE:
        raise InputError(f"{len(items)} items do not fit into one file: split the plan", field=mission_type.noun)
    parts = [_HEADER.pack(MAGIC, mission_type, 0, 0, len(items))]
    for i in items:
        kind = (i.sequence, i.command, *target, i.frame, i.current, i.autocontinue, mission_type)
        try:
            parts.append(_ITEM.pack(*i.params, i.x, i.y, i.z, *kind))
        except (struct.error, OverflowError) as error:
            raise InputError(f"item {i.sequence} has a number that does not fit: {error}") from error
    return b"".join(parts)


def decode_mission_file(data: bytes, mission_type: MissionType) -> tuple[MissionItem, ...]:
    """The items in a file that a vehicle gave.

    Raises:
        IncompleteError: it is no such file, another list's, or not whole.
    """
    if len(data) < HEADER_BYTES:
        raise IncompleteError(f"the vehicle's {mission_type.noun} file has {len(data)} bytes, too few for its head")
    magic, kind, _, start, count = _HEADER.unpack_from(data)
    if magic != MAGIC or kind != mission_type or start != 0:
        raise IncompleteError(f"the vehicle's {mission_type.noun} file is of another kind")
    if len(data) != HEADER_BYTES + count * ITEM_BYTES:
        raise IncompleteError(
            f"the vehicle's {mission_type.noun} file has {len(data)} bytes, not those of {count} items"
        )
    return tuple(_item(sequence, values) for sequence, values in enumerate(_ITEM.iter_unpack(data[HEADER_BYTES:])))


def _item(sequence: int, values: tuple[float, ...]) -> MissionItem:
    """The item; its place in the file is its number, as its own field may be left empty."""
    p1, p2, p3, p4, x, y, z, _, command, _, _, frame, current, autocontinue, _ = values
    return MissionItem(
        sequence,
        int(frame),
        int(command),
        (p1, p2, p3, p4),
        int(x),
        int(y),
        z,
        int(current),
        int(autocontinue),
    )
