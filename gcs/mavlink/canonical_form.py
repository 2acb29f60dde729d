"""What a vehicle will hold of an item that it is sent, for each family of autopilots.

Autopilots do not store items as they come: frames are renamed, numbers rounded, fields that a command does not use
are dropped. Two items are the same to a vehicle exactly if their canonical forms are equal, so a read-back is compared
in that form. The rules were measured on ArduCopter 4.7 and PX4 1.16/1.17:

| | ArduPilot | PX4 | others |
| --- | --- | --- | --- |
| item 0 | home; whatever is sent is replaced | an item like any other | like any other |
| frames | 5 -> 0, 6 -> 3, 11 -> 10; 0 for items without a place | 0 -> 5, 3 -> 6 | 5 = 0, 6 = 3, 11 = 10 |
| fields kept | by command, see `_ARDUPILOT_KEEPS` | all, but for those below | all |
| NAV_WAYPOINT | param1 cut to whole seconds | param3 dropped | |
| NAV_ROI, DO_SET_ROI | | NAV_ROI becomes DO_SET_ROI, param1 dropped | |
| yaw (param4) of navigation items | dropped | wrapped to 0-360 deg through radians, NaN kept | |
| x, y of items without a place | a byte each, where they are kept | kept | |
| z | whole centimetres | float32 | float32 |
| rounding when told | last unit of x and y of a place, last bits of a float | the same | the same |
| autocontinue | 1 | kept | kept |
| every float | float32 | float32 | float32 |

Fences and rally points: see `canonical_fence_rally`.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from dataclasses import dataclass, replace

from gcs.core.mission import PLACE_COMMANDS, MissionItem, mission_crc32
from gcs.core.vehicle import Autopilot
from gcs.mavlink.canonical_fence_rally import canonical_fence_item, canonical_rally_item
from gcs.mavlink.mission_protocol import MissionType

_PLAIN_FRAME = {5: 0, 6: 3, 11: 10}
_INT_FRAME = {0: 5, 3: 6, 10: 11}
_NAV_WAYPOINT = 16
_YAW_COMMANDS_PX4 = frozenset({16, 21, 22, 84, 85})
_ROI_PX4 = {80: 201, 201: 201}

_ARDUPILOT_KEEPS: dict[int, str] = {
    16: "1xyz",
    17: "3xyz",
    18: "134xyz",
    19: "134xyz",
    20: "",
    21: "1xyz",  # param4 is a turning direction of fixed wings, and comes back as -1 or 1
    22: "1xyz",
    82: "1xyz",
    93: "1234",
    112: "1",
    114: "1",
    115: "1234",
    177: "12",
    178: "123",
    195: "1xyz",
    201: "1xyz",
    203: "1234xy",
    205: "123z",
    206: "13",
    1000: "1234xz",
    2000: "1234",
    2001: "1",
    2500: "1",
}
"""Fields that ArduPilot stores of a command; commands that are not listed are expected back as they were sent."""

_CENTIMETRE_M = 0.0101
"""ArduPilot cuts z to centimetres after a float32 product, so the last centimetre is not certain."""
_FLOAT_BITS = 2.0**-21
"""Relative: what a vehicle that counts in float32 may lose when it tells a number."""
_PLACE_UNIT = 1
"""1e-7 deg (1 cm): a vehicle that keeps degrees as floating-point numbers may cut them when it tells them."""
_YAW_DEG = 0.01
"""PX4 keeps yaw in float32 radians."""
MOST_TOLD = 5
"""So many differences are told in words; the rest is counted."""


@dataclass(frozen=True)
class MissionComparison:
    """What a vehicle holds against what it should hold.

    Attributes:
        equal: whether every item is the same to the vehicle.
        differences: what differs, in plain words, item by item.
        canonical_crc32: fingerprint of what it should hold, in canonical form.
        replaceable: numbers of the items that have to be replaced; None where the lists are not of one length.
    """

    equal: bool
    differences: tuple[str, ...]
    canonical_crc32: int
    replaceable: range | None = None

    @property
    def summary(self) -> str:
        """All of it in one line."""
        if self.equal:
            return "the vehicle holds exactly what was sent"
        more = len(self.differences) - MOST_TOLD
        return "; ".join(self.differences[:MOST_TOLD]) + (f" (and {more} more)" if more > 0 else "")


def float32(value: float) -> float:
    """The nearest float32, as on the wire; values beyond its range become infinite."""
    try:
        return float(struct.unpack("<f", struct.pack("<f", value))[0])
    except OverflowError:
        return math.copysign(math.inf, value)


def canonical_item(item: MissionItem, autopilot: Autopilot) -> MissionItem:
    """The item as a family of autopilots holds it; `current` is left out, because it moves."""
    item = _in_float32(item)
    if autopilot is Autopilot.ARDUPILOT:
        return _ardupilot(item)
    if autopilot is Autopilot.PX4:
        return _px4(item)
    return replace(item, frame=_PLAIN_FRAME.get(item.frame, item.frame))


def _in_float32(item: MissionItem) -> MissionItem:
    p1, p2, p3, p4 = (float32(p) for p in item.params)
    return replace(item, params=(p1, p2, p3, p4), z=float32(item.z), current=0)


def canonical_items(
    items: Sequence[MissionItem], autopilot: Autopilot, mission_type: MissionType = MissionType.MISSION
) -> tuple[MissionItem, ...]:
    """All items of a list as the vehicle holds them; on ArduPilot a mission without item 0, which is its home."""
    if mission_type is not MissionType.MISSION:
        form = canonical_fence_item if mission_type is MissionType.FENCE else canonical_rally_item
        return tuple(form(_in_float32(i), autopilot) for i in items)
    kept = items[1:] if autopilot is Autopilot.ARDUPILOT else items
    return tuple(canonical_item(i, autopilot) for i in kept)


def compare(
    sent: Sequence[MissionItem],
    read: Sequence[MissionItem],
    autopilot: Autopilot,
    mission_type: MissionType = MissionType.MISSION,
) -> MissionComparison:
    """Compare what was sent with what was read back, as the vehicle sees it."""
    expected, found = (canonical_items(items, autopilot, mission_type) for items in (sent, read))
    differences = []
    if len(sent) != len(read):
        differences.append(f"it holds {len(read)} items instead of {len(sent)}")
    numbers = []
    for a, b in zip(expected, found, strict=False):
        different = _differences(a, b, autopilot)
        differences.extend(different)
        if different:
            numbers.append(a.sequence)
    replaceable = range(numbers[0], numbers[-1] + 1) if numbers and len(sent) == len(read) else None
    return MissionComparison(not differences, tuple(differences), mission_crc32(expected), replaceable)


def _ardupilot(item: MissionItem) -> MissionItem:
    p1, p2, p3, p4 = item.params
    keeps = _ARDUPILOT_KEEPS.get(item.command)
    if keeps is None:
        return replace(item, frame=_PLAIN_FRAME.get(item.frame, item.frame), autocontinue=1)
    place = item.command in PLACE_COMMANDS
    if item.command in {_NAV_WAYPOINT, 21, 22, 82}:
        p1 = 0.0 if math.isnan(p1) else float(int(p1)) if math.isfinite(p1) else p1
    if item.command == 19 and p3 == 0.0:
        p3 = 1.0
    x, y = (item.x, item.y) if place else (item.x & 0xFF, item.y & 0xFF)
    return replace(
        item,
        frame=_PLAIN_FRAME.get(item.frame, item.frame) if place else 0,
        params=(
            p1 if "1" in keeps else 0.0,
            p2 if "2" in keeps else 0.0,
            p3 if "3" in keeps else 0.0,
            p4 if "4" in keeps else 0.0,
        ),
        x=x if "x" in keeps else 0,
        y=y if "y" in keeps else 0,
        z=(round(item.z, 2) if place else item.z) if "z" in keeps else 0.0,
        autocontinue=1,
    )


def _px4(item: MissionItem) -> MissionItem:
    p1, p2, p3, p4 = item.params
    command = _ROI_PX4.get(item.command, item.command)
    if command == _NAV_WAYPOINT:
        p3 = 0.0
    if command == 201:
        p1 = 0.0
    if command in _YAW_COMMANDS_PX4 and math.isfinite(p4):
        p4 %= 360.0
    return replace(item, frame=_INT_FRAME.get(item.frame, item.frame), command=command, params=(p1, p2, p3, p4))


def _differences(a: MissionItem, b: MissionItem, autopilot: Autopilot) -> list[str]:
    """Differences of two items in canonical form."""
    found = []
    place = a.command in PLACE_COMMANDS
    yaw = autopilot is Autopilot.PX4 and a.command in _YAW_COMMANDS_PX4
    z_tolerance = _CENTIMETRE_M if autopilot is Autopilot.ARDUPILOT and place else 0.0
    place_tolerance = _PLACE_UNIT if place else 0
    pairs: list[tuple[str, float, float, float]] = [
        ("sequence", a.sequence, b.sequence, 0.0),
        ("command", a.command, b.command, 0.0),
        ("frame", a.frame, b.frame, 0.0),
        *((f"param{k + 1}", a.params[k], b.params[k], _YAW_DEG if yaw and k == 3 else 0.0) for k in range(4)),
        ("x", a.x, b.x, place_tolerance),
        ("y", a.y, b.y, place_tolerance),
        ("z", a.z, b.z, z_tolerance),
        ("autocontinue", a.autocontinue, b.autocontinue, 0.0),
    ]
    for name, sent, held, tolerance in pairs:
        apart = abs(sent - held)
        if yaw and name == "param4":
            apart = min(apart, 360.0 - apart)
        bits = _FLOAT_BITS * abs(sent) if isinstance(sent, float) and math.isfinite(sent) else 0.0
        same = sent == held or (math.isnan(sent) and math.isnan(held)) or apart <= tolerance + bits
        if not same:
            found.append(f"item {a.sequence}: {name} is {held:g} instead of {sent:g}")
    return found
