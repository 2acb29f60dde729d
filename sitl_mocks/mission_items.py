"""Mission items as the vehicles keep them, and what each autopilot makes of an item it is given."""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass, field, replace

from sitl_mocks.dialect import Message, mavlink

UNSUPPORTED_FRAME = mavlink.MAV_MISSION_UNSUPPORTED_FRAME
UNSUPPORTED = mavlink.MAV_MISSION_UNSUPPORTED
INVALID = mavlink.MAV_MISSION_INVALID
INVALID_PARAM1 = mavlink.MAV_MISSION_INVALID_PARAM1
INVALID_PARAM5_X = mavlink.MAV_MISSION_INVALID_PARAM5_X
INVALID_PARAM6_Y = mavlink.MAV_MISSION_INVALID_PARAM6_Y
INVALID_PARAM7 = mavlink.MAV_MISSION_INVALID_PARAM7

GLOBAL_FRAMES = {0, 3, 5, 6}

WAYPOINT, LOITER_UNLIMITED, LOITER_TIME, RETURN, LAND, TAKEOFF = 16, 17, 19, 20, 21, 22
DELAY, CONDITION_DELAY, CONDITION_DISTANCE, CONDITION_YAW, JUMP = 93, 112, 114, 115, 177
SPLINE_WAYPOINT, CHANGE_SPEED, DIGICAM_CONTROL, MOUNT_CONTROL = 82, 178, 203, 205
GIMBAL_PITCHYAW, IMAGE_START, IMAGE_STOP = 1000, 2000, 2001


class ItemRefused(Exception):  # noqa: N818 - it is an answer of the protocol, not a failure
    """The item is not taken; `result` is the MAV_MISSION_RESULT to answer with."""

    def __init__(self, result: int) -> None:
        super().__init__(f"MAV_MISSION_RESULT {result}")
        self.result = int(result)


@dataclass(frozen=True)
class StoredItem:
    """One mission item in MISSION_ITEM_INT terms; `wire` is what PX4 makes its list's id of."""

    frame: int
    command: int
    params: tuple[float, float, float, float]
    x: int
    y: int
    z: float
    current: int = 0
    autocontinue: int = 1
    wire: bytes = field(default=b"", compare=False, repr=False)

    @property
    def latitude_deg(self) -> float:
        """Of an item with a place."""
        return self.x * 1e-7

    @property
    def longitude_deg(self) -> float:
        """Of an item with a place."""
        return self.y * 1e-7


def item_of_message(message: Message) -> StoredItem:
    """The item in a MISSION_ITEM or MISSION_ITEM_INT."""
    x, y = message.x, message.y
    if message.get_type() == "MISSION_ITEM":
        scale = 1e7 if message.frame in GLOBAL_FRAMES else 1.0
        x, y = (round(v * scale) if math.isfinite(v) else 0 for v in (x, y))
    params = (message.param1, message.param2, message.param3, message.param4)
    return StoredItem(
        message.frame, message.command, params, int(x), int(y), message.z, message.current, message.autocontinue
    )


def message_of_item(
    item: StoredItem, sequence: int, peer: tuple[int, int], mission_type: int = 0, *, as_float: bool
) -> Message:
    """MISSION_ITEM_INT, or the old MISSION_ITEM for who asked with the old request."""
    head = (*peer, sequence, item.frame, item.command, item.current, item.autocontinue, *item.params)
    if as_float:
        scale = 1e-7 if item.frame in GLOBAL_FRAMES else 1.0
        return mavlink.MAVLink_mission_item_message(*head, item.x * scale, item.y * scale, item.z, mission_type)
    return mavlink.MAVLink_mission_item_int_message(*head, item.x, item.y, item.z, mission_type)


def float32(value: float) -> float:
    """The nearest number that a float field can carry."""
    return float(struct.unpack("<f", struct.pack("<f", value))[0])


_PX4_WITH_PLACE = {16, 17, 19, 21, 22, 31, 80, 84, 85, 195, 201}
_PX4_WITHOUT_PLACE = {
    *(20, 93, 112, 114, 177, 178, 179, 187, 189, 197, 203, 204, 205, 206, 211, 214),
    *(530, 1000, 1001, 2000, 2001, 2003, 2500, 2501, 42600),
}
_PX4_FRAME = {0: 5, 3: 6, 5: 5, 6: 6}


def px4_item(item: StoredItem) -> StoredItem:
    """The item as PX4 keeps it.

    Raises:
        ItemRefused: PX4 does not take it.
    """
    if item.frame in GLOBAL_FRAMES:
        if item.command not in _PX4_WITH_PLACE:
            raise ItemRefused(UNSUPPORTED)
    elif item.frame == mavlink.MAV_FRAME_MISSION:
        if item.command not in _PX4_WITHOUT_PLACE:
            raise ItemRefused(UNSUPPORTED)
        return replace(item, autocontinue=1)
    else:
        raise ItemRefused(UNSUPPORTED_FRAME)
    p1, p2, p3, p4 = item.params
    command = item.command
    if command in {80, 201}:
        command, p1 = 201, 0.0
    if command == WAYPOINT:
        p3 = 0.0
    if command in {WAYPOINT, LAND, TAKEOFF} and math.isfinite(p4):
        p4 = float32(p4 % 360.0)
    return replace(item, frame=_PX4_FRAME[item.frame], command=command, params=(p1, p2, p3, p4), autocontinue=1)


def has_place(item: StoredItem) -> bool:
    """Whether an item that PX4 keeps has a place."""
    return item.command in _PX4_WITH_PLACE
