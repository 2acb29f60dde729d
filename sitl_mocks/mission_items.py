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
CHANGE_SPEED, DIGICAM_CONTROL, MOUNT_CONTROL = 178, 203, 205
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


# PX4 -----------------------------------------------------------------------------------------------------------------

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
        p = item.params
        return replace(item, params=(p[0], 0.0, p[2], p[3]) if item.command == 206 else p, autocontinue=1)
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


# ArduPilot -----------------------------------------------------------------------------------------------------------

_ARDUPILOT_WITH_PLACE = {16, 17, 18, 19, 21, 22, 30, 31, 82, 84, 85, 92, 94, 179, 188, 189, 191, 195, 201}
_ARDUPILOT_WITHOUT_PLACE = {
    *(20, 83, 93, 112, 114, 115, 177, 178, 181, 182, 183, 184, 193, 194, 197, 202, 203, 205, 206, 207, 208, 210),
    *(211, 212, 213, 215, 216, 217, 218, 222, 223, 531, 532, 534, 600, 601, 1000, 2000, 2001, 2500, 2501, 3000, 42600),
}
_ARDUPILOT_FRAME = {0: 0, 2: 0, 3: 3, 5: 0, 6: 3, 10: 10, 11: 10}
_ARDUPILOT_NAN_ALLOWED = {
    WAYPOINT: {4},
    TAKEOFF: {4},
    LAND: {4},
    GIMBAL_PITCHYAW: {1, 2, 3, 4},
    IMAGE_START: {4},
}


def ardupilot_item(item: StoredItem) -> StoredItem:
    """The item as ArduPilot keeps it.

    Raises:
        ItemRefused: ArduPilot does not take it.
    """
    if item.command in {0, 1}:
        raise ItemRefused(INVALID)
    with_place = item.command in _ARDUPILOT_WITH_PLACE
    if not with_place and item.command not in _ARDUPILOT_WITHOUT_PLACE:
        raise ItemRefused(UNSUPPORTED)
    if item.frame not in _ARDUPILOT_FRAME:
        raise ItemRefused(UNSUPPORTED_FRAME)
    allowed = _ARDUPILOT_NAN_ALLOWED.get(item.command, set())
    for number, value in enumerate(item.params, start=1):
        if math.isinf(value) or (math.isnan(value) and number not in allowed):
            raise ItemRefused(INVALID_PARAM1 + number - 1)
    if with_place:
        if abs(item.x) > 900_000_000:
            raise ItemRefused(INVALID_PARAM5_X)
        if abs(item.y) > 1_800_000_000:
            raise ItemRefused(INVALID_PARAM6_Y)
    if not math.isfinite(item.z):
        raise ItemRefused(INVALID_PARAM7)
    if with_place:
        return _ardupilot_place(item)
    x, y, z = 0, 0, 0.0
    if item.command in {202, DIGICAM_CONTROL}:
        x, y = item.x % 256, item.y % 256
    elif item.command == MOUNT_CONTROL:
        z = item.z
    params = item.params
    if item.command == JUMP:
        params = (float(int(params[0])), float(int(params[1])), 0.0, 0.0)
    elif item.command == CHANGE_SPEED or (item.command == IMAGE_START and math.isnan(params[3])):
        params = (*params[:3], 0.0)
    return StoredItem(0, item.command, params, x, y, z)


def _ardupilot_place(item: StoredItem) -> StoredItem:
    p1, p2, p3, p4 = item.params
    if item.command == WAYPOINT:
        p1, p2, p3, p4 = float(int(p1)), 0.0, 0.0, 0.0
    elif item.command == LOITER_TIME:
        p1, p2, p3 = float(int(p1)), 0.0, (1.0 if p3 == 0.0 else p3)
    elif item.command == TAKEOFF:
        p1, p2, p3, p4 = float(int(p1)), 0.0, 0.0, 0.0
    elif item.command == LAND:
        p1, p2, p3, p4 = float(int(p1)), 0.0, 0.0, (0.0 if math.isnan(p4) else p4)
    # Kept in whole centimetres, by way of a product in single precision (which makes a second pass change nothing).
    z = float32(int(float32(item.z * 100.0)) / 100.0)
    return StoredItem(_ARDUPILOT_FRAME[item.frame], item.command, (p1, p2, p3, p4), item.x, item.y, z)


def global_of_command(item: StoredItem) -> bool:
    """Whether the item has a place."""
    return item.command in (_PX4_WITH_PLACE | _ARDUPILOT_WITH_PLACE)
