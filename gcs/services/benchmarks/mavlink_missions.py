"""Missions, fences and rally points that the transfer benchmarks send."""

from __future__ import annotations

import random

from gcs.core.mission import Command, Frame, Mission, MissionItem
from gcs.core.vehicle import Autopilot
from gcs.mavlink.mission_protocol import MissionType


def random_mission(autopilot: Autopilot, rng: random.Random, count: int) -> Mission:
    """A mission of random places: what each autopilot takes, item 0 a waypoint at home for ArduPilot."""
    px4 = autopilot is Autopilot.PX4
    frame, action = (5, 2) if px4 else (0, 0)

    def item(sequence: int) -> MissionItem:
        if sequence % 4 == 3:
            return MissionItem(sequence, action, 93, (float(rng.randrange(1, 60)), -1.0, -1.0, -1.0), 0, 0, 0.0)
        command = 16 if sequence else (22 if px4 else 16)
        params = (float(rng.randrange(5)), 0.5, 0.0, rng.uniform(0.0, 359.0)) if px4 and sequence else (0.0,) * 4
        x, y = _place(rng)
        return MissionItem(sequence, frame, command, params, x, y, round(rng.uniform(5.0, 90.0), 2), int(sequence == 0))

    return Mission(tuple(item(sequence) for sequence in range(count)))


def random_list(mission_type: MissionType, rng: random.Random, count: int) -> Mission:
    """A fence of one polygon, or rally points at whole metres: what every autopilot takes, and keeps as it is."""

    def item(sequence: int) -> MissionItem:
        x, y = _place(rng)
        if mission_type is MissionType.FENCE:
            command, size, z = Command.NAV_FENCE_POLYGON_VERTEX_INCLUSION, float(count), 0.0
        else:
            command, size, z = Command.NAV_RALLY_POINT, 0.0, float(rng.randrange(5, 90))
        return MissionItem(sequence, Frame.GLOBAL, command, (size, 0.0, 0.0, 0.0), x, y, z, autocontinue=0)

    return Mission(tuple(item(sequence) for sequence in range(count)))


def _place(rng: random.Random) -> tuple[int, int]:
    return 313_622_000 + rng.randrange(-20_000, 20_000), 1_216_155_000 + rng.randrange(-20_000, 20_000)


def wire_items(plan: Mission) -> list[list[float]]:
    """Frame, command, param1 to param4, x, y, z and autocontinue of each item, as they travel."""
    return [[i.frame, i.command, *i.params, i.x, i.y, i.z, i.autocontinue] for i in plan.items]
