"""Notices that one of a vehicle's lists became another one after the station had found out what it holds.

Vehicles that give their lists ids tell those of all three in MISSION_CURRENT, again and again. ArduPilot has none, but
may tell there how many items its mission has, which is taken for an id: an exchange for as many items is not seen. An
id counts as another one when it came `TOLD_TIMES` times in a row: one old packet that is late must not look like a
change.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from gcs.core.vehicle import Autopilot
from gcs.mavlink.dialect import Message
from gcs.mavlink.mission_protocol import MissionType
from gcs.mavlink.plan_id import told_list_ids
from gcs.mavlink.telemetry_decoder import mission_progress

TOLD_TIMES = 2
SETTLED_S = 3.0
"""For so long after an upload the vehicle may still tell the id of what it held before."""


@dataclass
class _Known:
    list_id: int | None
    settled_at: float
    confirmed: bool = False
    other: int | None = None
    told: int = 0


def told_marks(message: Message, autopilot: Autopilot) -> dict[MissionType, int]:
    """The ids in a MISSION_CURRENT, or what is taken for them; 0 for each list that has none."""
    if autopilot is Autopilot.ARDUPILOT:
        return {MissionType.MISSION: mission_progress(message).total or 0}
    return told_list_ids(message)


class ListWatch:
    """Watches the ids of one vehicle's lists."""

    def __init__(self) -> None:
        self._known: dict[MissionType, _Known] = {}

    @property
    def idle(self) -> bool:
        """Whether the station knows nothing that could change."""
        return not self._known

    def forget(self, mission_type: MissionType) -> None:
        """What the vehicle holds is not known, or is being changed by the station."""
        self._known.pop(mission_type, None)

    def uploaded(self, mission_type: MissionType, list_id: int | None, now_s: float) -> None:
        """The station knows what the vehicle holds, as it has put it there; `list_id` where it can be told ahead."""
        self._known[mission_type] = _Known(list_id, now_s + SETTLED_S)

    def read(self, mission_type: MissionType, now_s: float) -> None:
        """The station knows what the vehicle holds, as it has read it."""
        self._known[mission_type] = _Known(None, now_s)

    def take(self, ids: Mapping[MissionType, int], now_s: float) -> list[MissionType]:
        """Take the ids of a MISSION_CURRENT, as of `told_marks`; returns the lists that were changed, each once."""
        changed = [kind for kind, known in self._known.items() if kind in ids and _differs(known, ids[kind], now_s)]
        for kind in changed:
            self.forget(kind)
        return changed


def _differs(known: _Known, told: int, now_s: float) -> bool:
    settled = now_s >= known.settled_at
    if known.list_id is None and settled:
        known.list_id = told
    if told == known.list_id:
        known.confirmed, known.told = True, 0
        return False
    if not known.confirmed and (told == 0 or not settled):
        return False
    known.told = known.told + 1 if told == known.other else 1
    known.other = told
    return known.told >= TOLD_TIMES
