"""Mission items as the wire has them, and the frames and commands this project uses (numbers of MAVLink common.xml)."""

from __future__ import annotations

import math
import zlib
from dataclasses import dataclass, field
from enum import IntEnum


class Frame(IntEnum):
    """MAV_FRAME values that are used."""

    GLOBAL = 0
    MISSION = 2
    GLOBAL_RELATIVE_ALT = 3
    GLOBAL_INT = 5
    GLOBAL_RELATIVE_ALT_INT = 6


class Command(IntEnum):
    """MAV_CMD values that are used in missions."""

    NAV_WAYPOINT = 16
    NAV_RETURN_TO_LAUNCH = 20
    NAV_LAND = 21
    NAV_TAKEOFF = 22
    NAV_DELAY = 93
    CONDITION_YAW = 115
    DO_CHANGE_SPEED = 178
    DO_MOUNT_CONTROL = 205
    DO_DIGICAM_CONTROL = 203
    DO_GIMBAL_MANAGER_PITCHYAW = 1000
    IMAGE_START_CAPTURE = 2000
    NAV_FENCE_RETURN_POINT = 5000
    NAV_FENCE_POLYGON_VERTEX_INCLUSION = 5001
    NAV_FENCE_POLYGON_VERTEX_EXCLUSION = 5002
    NAV_FENCE_CIRCLE_INCLUSION = 5003
    NAV_FENCE_CIRCLE_EXCLUSION = 5004
    NAV_RALLY_POINT = 5100


PLACE_COMMANDS = frozenset(
    {16, 17, 18, 19, 21, 22, 30, 31, 80, 82, 84, 85, 92, 94, 179, 195, 201, 5000, 5001, 5002, 5003, 5004, 5100}
)
"""Commands whose x, y, z are a place; of the others they are plain numbers, whatever the frame says."""


@dataclass(frozen=True)
class MissionItem:
    """One item of a mission in MISSION_ITEM_INT terms.

    Attributes:
        sequence: 0-based.
        frame: MAV_FRAME.
        command: MAV_CMD.
        params: param1 to param4; NaN means unset.
        x: latitude in 1e-7 deg (global frames), or param5 as a whole number.
        y: longitude in 1e-7 deg, or param6.
        z: altitude in m in the frame's datum, or param7.
        current: 1 on the item to start with, else 0.
        autocontinue: 1 to go on by itself.
    """

    sequence: int
    frame: int
    command: int
    params: tuple[float, float, float, float]
    x: int
    y: int
    z: float
    current: int = 0
    autocontinue: int = 1


@dataclass(frozen=True)
class Mission:
    """A mission to be put on a vehicle, and which of its items belong to which viewpoint.

    Attributes:
        items: numbered 0 to n - 1.
        viewpoint_items: viewpoint id -> sequence of the item that takes its picture.
    """

    items: tuple[MissionItem, ...]
    viewpoint_items: dict[int, int] = field(default_factory=dict)


def mission_crc32(items: tuple[MissionItem, ...]) -> int:
    """A fingerprint of a list of items for logs and records (not the wire's opaque id); NaN equals NaN."""
    lines = []
    for i in items:
        params = ",".join("nan" if math.isnan(p) else f"{p:.6g}" for p in i.params)
        lines.append(f"{i.sequence};{i.frame};{i.command};{params};{i.x};{i.y};{i.z:.4f};{i.autocontinue}")
    return zlib.crc32("\n".join(lines).encode())
