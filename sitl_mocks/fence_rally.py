"""Fence and rally points as the two kinds of vehicle keep them: how many, and what becomes of an item."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from sitl_mocks.ardupilot_items import ardupilot_item
from sitl_mocks.dialect import mavlink
from sitl_mocks.mission_items import (
    INVALID_PARAM5_X,
    INVALID_PARAM6_Y,
    INVALID_PARAM7,
    UNSUPPORTED,
    UNSUPPORTED_FRAME,
    ItemRefused,
    StoredItem,
    px4_item,
)

RETURN_POINT, INCLUDED_CORNER, EXCLUDED_CORNER, INCLUDED_CIRCLE, EXCLUDED_CIRCLE, RALLY_POINT = *range(5000, 5005), 5100
MISSION, FENCE, RALLY = 0, 1, 2
"""MAV_MISSION_TYPE."""
_FENCE = {RETURN_POINT, INCLUDED_CORNER, EXCLUDED_CORNER, INCLUDED_CIRCLE, EXCLUDED_CIRCLE}
_FRAMES = {0, 3, 5, 6}
_ARDUPILOT_RALLY_FRAME = {0: 0, 3: 3, 5: 0, 6: 3, 10: 10, 11: 10}
_NO_PARAMS = (0.0, 0.0, 0.0, 0.0)
_INT16 = 32767
_METRES_E7 = math.radians(1e-7) * 6_378_137.0


@dataclass(frozen=True)
class ListKind:
    """One of the lists of a vehicle.

    Attributes:
        mission_type: MAV_MISSION_TYPE.
        capacity: how many items it takes.
        keep: what is kept of an item; raises ItemRefused.
        fit: judges a whole new list before it replaces the old one; None where items are written as they come, or are
            taken in any case.
    """

    mission_type: int
    capacity: int
    keep: Callable[[StoredItem], StoredItem]
    fit: Callable[[Sequence[StoredItem]], bool] | None = None


def with_room(kind: ListKind, items: int) -> ListKind:
    """The same list with room for so many items; 0 leaves it as it is."""
    return replace(kind, capacity=items) if items else kind


def _px4_fence(item: StoredItem) -> StoredItem:
    if item.command not in _FENCE:
        raise ItemRefused(UNSUPPORTED)
    return _px4_place(item)


def _px4_rally(item: StoredItem) -> StoredItem:
    if item.command != RALLY_POINT:
        raise ItemRefused(UNSUPPORTED)
    return _px4_place(item)


def _px4_place(item: StoredItem) -> StoredItem:
    if item.frame not in _FRAMES:
        raise ItemRefused(UNSUPPORTED_FRAME)
    return replace(item, frame=mavlink.MAV_FRAME_GLOBAL_INT, autocontinue=0)


def _ardupilot_fence(item: StoredItem) -> StoredItem:
    if item.command not in _FENCE:
        raise ItemRefused(UNSUPPORTED)
    if item.frame not in _FRAMES:
        raise ItemRefused(UNSUPPORTED_FRAME)
    _in_range(item)
    p1 = 0.0 if item.command == RETURN_POINT else item.params[0]
    return StoredItem(0, item.command, (p1, 0.0, 0.0, 0.0), item.x, item.y, 0.0, autocontinue=0)


def _ardupilot_rally(item: StoredItem) -> StoredItem:
    if item.command != RALLY_POINT:
        raise ItemRefused(UNSUPPORTED)
    if item.frame not in _ARDUPILOT_RALLY_FRAME:
        raise ItemRefused(UNSUPPORTED_FRAME)
    _in_range(item)
    if not abs(item.z) <= _INT16:
        raise ItemRefused(INVALID_PARAM7)
    frame, z = _ARDUPILOT_RALLY_FRAME[item.frame], float(int(item.z))
    return StoredItem(frame, RALLY_POINT, _NO_PARAMS, item.x, item.y, z, autocontinue=0)


def _in_range(item: StoredItem) -> None:
    if abs(item.x) > 900_000_000:
        raise ItemRefused(INVALID_PARAM5_X)
    if abs(item.y) > 1_800_000_000:
        raise ItemRefused(INVALID_PARAM6_Y)


def whole_polygons(items: Sequence[StoredItem]) -> bool:
    """Whether every polygon has all the corners that it says, at least three, no two neighbours in one place."""
    at = 0
    while at < len(items):
        item = items[at]
        if item.command not in {INCLUDED_CORNER, EXCLUDED_CORNER}:
            at += 1
            continue
        count = int(item.params[0])
        polygon = items[at : at + count]
        alike = all((p.command, p.params[0]) == (item.command, item.params[0]) for p in polygon)
        if count < 3 or len(polygon) < count or not alike:
            return False
        places = [(p.x, p.y) for p in polygon]
        if any(place == places[k - 1] for k, place in enumerate(places)):
            return False
        at += count
    return True


def outside(items: Sequence[StoredItem], latitude_deg: float, longitude_deg: float, *, of_all: bool) -> bool:
    """Whether a place breaks a fence: in an excluded area, or not in the included ones.

    Args:
        items: a whole fence.
        latitude_deg: of the place.
        longitude_deg: of the place.
        of_all: whether it has to be in all included areas, and not just in any.
    """
    y, x = latitude_deg * 1e7, longitude_deg * 1e7
    included: list[bool] = []
    at = 0
    while at < len(items):
        item = items[at]
        size = int(item.params[0]) if item.command in {INCLUDED_CORNER, EXCLUDED_CORNER} else 1
        if item.command in {INCLUDED_CIRCLE, EXCLUDED_CIRCLE}:
            east = (x - item.y) * math.cos(math.radians(latitude_deg))
            inside = math.hypot(east, y - item.x) * _METRES_E7 <= item.params[0]
        else:
            inside = size > 1 and _inside(x, y, items[at : at + size])
        if item.command in {INCLUDED_CORNER, INCLUDED_CIRCLE}:
            included.append(inside)
        elif item.command != RETURN_POINT and inside:
            return True
        at += max(size, 1)
    return bool(included) and not (all(included) if of_all else any(included))


def _inside(x: float, y: float, corners: Sequence[StoredItem]) -> bool:
    """Even-odd rule; x is the longitude, y the latitude, in 1e-7 degrees."""
    inside = False
    for a, b in zip(corners, [*corners[1:], corners[0]], strict=True):
        if (a.x > y) != (b.x > y) and x < a.y + (y - a.x) * (b.y - a.y) / (b.x - a.x):
            inside = not inside
    return inside


PX4_MISSION = ListKind(0, 10_000, px4_item)
PX4_LISTS = (ListKind(FENCE, 64, _px4_fence), ListKind(RALLY, 32, _px4_rally))
ARDUPILOT_MISSION = ListKind(0, 650, ardupilot_item)
ARDUPILOT_LISTS = (ListKind(FENCE, 70, _ardupilot_fence, whole_polygons), ListKind(RALLY, 46, _ardupilot_rally))
