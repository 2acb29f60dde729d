"""PX4's check of a mission that it has already acknowledged: taken does not mean flyable."""

from __future__ import annotations

import math
from collections.abc import Sequence

from sitl_mocks.mission_items import CONDITION_DELAY, CONDITION_DISTANCE, TAKEOFF, StoredItem, has_place
from sitl_mocks.px4_events import NOT_FLYABLE, Event, unsupported_command

_TAKEN_BUT_UNSUPPORTED = {CONDITION_DELAY, CONDITION_DISTANCE}


class MissionCheck:
    """When a mission that was taken is known to be flyable or not: a second of wall time after that."""

    DURATION_S = 1.0

    def __init__(self) -> None:
        self._over_s = -math.inf

    def begin(self, wall_s: float) -> None:
        """A mission was taken."""
        self._over_s = wall_s + self.DURATION_S

    def end(self) -> None:
        """It is not waited for: the mission is being flown, and goes on at once."""
        self._over_s = -math.inf

    def is_over(self, wall_s: float) -> bool:
        """Whether the result is known."""
        return wall_s >= self._over_s


def flaw_of(mission: Sequence[StoredItem]) -> Event | None:
    """What is told of a mission that cannot be flown; None of one that can, or of none at all."""
    places = 0
    for sequence, item in enumerate(mission):
        if item.command in _TAKEN_BUT_UNSUPPORTED:
            return unsupported_command(sequence, item.command)
        if has_place(item):
            places += 1
            if not _is_on_earth(item) or (item.command == TAKEOFF and places > 1):
                return NOT_FLYABLE
    return None


def _is_on_earth(item: StoredItem) -> bool:
    return math.isfinite(item.z) and abs(item.x) <= 900_000_000 and abs(item.y) <= 1_800_000_000
