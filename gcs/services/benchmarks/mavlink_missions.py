"""Missions that the transfer benchmarks send."""

from __future__ import annotations

import random

from gcs.core.mission import Mission, MissionItem
from gcs.core.vehicle import Autopilot


def random_mission(autopilot: Autopilot, rng: random.Random, count: int) -> Mission:
    """A mission of random places: what each autopilot takes, item 0 a waypoint at home for ArduPilot."""
    px4 = autopilot is Autopilot.PX4
    frame, action = (5, 2) if px4 else (0, 0)

    def item(sequence: int) -> MissionItem:
        if sequence % 4 == 3:
            return MissionItem(sequence, action, 93, (float(rng.randrange(1, 60)), -1.0, -1.0, -1.0), 0, 0, 0.0)
        command = 16 if sequence else (22 if px4 else 16)
        params = (float(rng.randrange(5)), 0.5, 0.0, rng.uniform(0.0, 359.0)) if px4 and sequence else (0.0,) * 4
        x, y = (centre + rng.randrange(-20_000, 20_000) for centre in (313_622_000, 1_216_155_000))
        return MissionItem(sequence, frame, command, params, x, y, round(rng.uniform(5.0, 90.0), 2), int(sequence == 0))

    return Mission(tuple(item(sequence) for sequence in range(count)))


def wire_items(plan: Mission) -> list[list[float]]:
    """Frame, command, param1 to param4, x, y, z and autocontinue of each item, as they travel."""
    return [[i.frame, i.command, *i.params, i.x, i.y, i.z, i.autocontinue] for i in plan.items]
