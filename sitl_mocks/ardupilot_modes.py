"""ArduCopter's flight modes by number."""

from __future__ import annotations

from enum import IntEnum


class Mode(IntEnum):
    """ArduCopter's custom_mode."""

    STABILIZE = 0
    ALT_HOLD = 2
    AUTO = 3
    GUIDED = 4
    LOITER = 5
    RTL = 6
    LAND = 9
    POSHOLD = 16
    BRAKE = 17
    SMART_RTL = 21
