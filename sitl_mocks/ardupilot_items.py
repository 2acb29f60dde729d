"""What ArduPilot keeps of a mission item; measured by giving it items of every command with all fields set."""

from __future__ import annotations

import math
from collections.abc import Callable

from sitl_mocks.mission_items import (
    DIGICAM_CONTROL,
    GIMBAL_PITCHYAW,
    IMAGE_START,
    INVALID,
    INVALID_PARAM1,
    INVALID_PARAM5_X,
    INVALID_PARAM6_Y,
    INVALID_PARAM7,
    JUMP,
    LAND,
    LOITER_TIME,
    MOUNT_CONTROL,
    SPLINE_WAYPOINT,
    TAKEOFF,
    UNSUPPORTED,
    UNSUPPORTED_FRAME,
    WAYPOINT,
    ItemRefused,
    StoredItem,
    float32,
)

_PLACES_KEEP = {
    **dict.fromkeys((84, 188, 189, 191), ""),
    **dict.fromkeys((WAYPOINT, TAKEOFF, 30, SPLINE_WAYPOINT, 85, 92, 94, 179, 195, 201), "1"),
    LAND: "14",
    31: "24",
    17: "3",
    **dict.fromkeys((18, LOITER_TIME), "134"),
}
"""Command with a place -> numbers of the parameters that are kept."""

_OTHERS_KEEP = {
    20: "",
    **dict.fromkeys((112, 114, 193, 194, 197, 207, 208, 210, 212, 215, 216, 600, 2001, 2500, 2501, 3000), "1"),
    **dict.fromkeys((JUMP, 181, 183, 211, 218, 531, 532, 601), "12"),
    **dict.fromkeys((83, 178, 182, 213, 534), "123"),
    **dict.fromkeys((93, 115, 184, 217, 222, 223, IMAGE_START, 42600), "1234"),
    206: "13",
    202: "1234xyz",
    DIGICAM_CONTROL: "1234xy",
    MOUNT_CONTROL: "123",
    GIMBAL_PITCHYAW: "1234xz",
    42702: "1234xy",
    42703: "1234x",
}
"""Command without a place -> parameters and other fields that are kept; the rest becomes 0."""

_16_BITS = {42702, 42703}
"""Commands that keep 16 bits of x and y, with a sign; others keep 8."""
_MOUNT_MODE_MAVLINK = 2.0
"""z of every mount control: the only mode that it knows."""
_WHOLE_PARAM1 = {WAYPOINT, SPLINE_WAYPOINT, LOITER_TIME, TAKEOFF, LAND, JUMP}
_FRAME = {0: 0, 2: 0, 3: 3, 5: 0, 6: 3, 10: 10, 11: 10}
_NAN_ALLOWED = {WAYPOINT: {4}, TAKEOFF: {4}, LAND: {4}, GIMBAL_PITCHYAW: {1, 2, 3, 4}, IMAGE_START: {4}}


def ardupilot_item(item: StoredItem) -> StoredItem:
    """The item as ArduPilot keeps it.

    Raises:
        ItemRefused: ArduPilot does not take it.
    """
    if item.command in {0, 1}:
        raise ItemRefused(INVALID)
    with_place = item.command in _PLACES_KEEP
    if not with_place and item.command not in _OTHERS_KEEP:
        raise ItemRefused(UNSUPPORTED)
    if item.frame not in _FRAME:
        raise ItemRefused(UNSUPPORTED_FRAME)
    allowed = _NAN_ALLOWED.get(item.command, set())
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
    return _with_place(item) if with_place else _without_place(item)


def _with_place(item: StoredItem) -> StoredItem:
    p1, p2, p3, p4 = _kept_params(item, _PLACES_KEEP[item.command])
    if item.command == LOITER_TIME and p3 == 0.0:
        p3 = 1.0
    # Kept in whole centimetres, by way of a product in single precision (which makes a second pass change nothing).
    z = float32(int(float32(item.z * 100.0)) / 100.0)
    return StoredItem(_FRAME[item.frame], item.command, (p1, p2, p3, p4), item.x, item.y, z)


def _without_place(item: StoredItem) -> StoredItem:
    keeps = _OTHERS_KEEP[item.command]
    cut: Callable[[int], int] = _int16 if item.command in _16_BITS else _uint8
    z = item.z if "z" in keeps else 0.0
    return StoredItem(
        frame=0,
        command=item.command,
        params=_kept_params(item, keeps),
        x=cut(item.x) if "x" in keeps else 0,
        y=cut(item.y) if "y" in keeps else 0,
        z=_MOUNT_MODE_MAVLINK if item.command == MOUNT_CONTROL else z,
    )


def _kept_params(item: StoredItem, keeps: str) -> tuple[float, float, float, float]:
    p1, p2, p3, p4 = (p if number in keeps else 0.0 for number, p in zip("1234", item.params, strict=True))
    if item.command in _WHOLE_PARAM1:
        p1 = float(int(p1))
    if math.isnan(p4) and item.command != GIMBAL_PITCHYAW:
        p4 = 0.0
    return p1, float(int(p2)) if item.command == JUMP else p2, p3, p4


def _uint8(value: int) -> int:
    return value % 2**8


def _int16(value: int) -> int:
    return (value + 2**15) % 2**16 - 2**15
