"""PX4's flight modes by number and name."""

from __future__ import annotations

from enum import IntEnum


def mode_number(main: int, sub: int = 0) -> int:
    """PX4's custom_mode: main mode in byte 2, sub mode in byte 3."""
    return main << 16 | sub << 24


class Mode(IntEnum):
    """PX4's custom_mode: main mode in byte 2, sub mode in byte 3."""

    MANUAL = mode_number(1)
    ALTCTL = mode_number(2)
    POSCTL = mode_number(3)
    TAKEOFF = mode_number(4, 2)
    LOITER = mode_number(4, 3)
    MISSION = mode_number(4, 4)
    RTL = mode_number(4, 5)
    LAND = mode_number(4, 6)
    ACRO = mode_number(5)
    OFFBOARD = mode_number(6)
    STABILIZED = mode_number(7)


NAMES = {
    Mode.MANUAL: "MANUAL",
    Mode.ALTCTL: "ALTCTL",
    Mode.POSCTL: "POSCTL",
    Mode.TAKEOFF: "AUTO.TAKEOFF",
    Mode.LOITER: "AUTO.LOITER",
    Mode.MISSION: "AUTO.MISSION",
    Mode.RTL: "AUTO.RTL",
    Mode.LAND: "AUTO.LAND",
    Mode.ACRO: "ACRO",
    Mode.OFFBOARD: "OFFBOARD",
    Mode.STABILIZED: "STABILIZED",
}
PILOT_MODES = {Mode.MANUAL, Mode.ALTCTL, Mode.POSCTL, Mode.ACRO, Mode.STABILIZED}
AUTO_MODES = {Mode.TAKEOFF, Mode.LOITER, Mode.MISSION, Mode.RTL, Mode.LAND}
