"""What a vehicle will hold of an item of its fence or of its list of rally points.

Measured on ArduCopter 4.7 and PX4 1.16/1.17. What a vehicle does not keep or tell is left out of a comparison.

| | ArduPilot | PX4 | others |
| --- | --- | --- | --- |
| frame of a fence item | 0, whatever was sent (0, 3, 5, 6) | 5, whatever was sent | 5 = 0, 6 = 3 |
| frame of a rally point | 5 -> 0, 6 -> 3, 11 -> 10 | 5, whatever was sent | 5 = 0, 6 = 3 |
| height of a rally point | whole metres | float32 | float32 |
| height of a fence item | not kept: a polygon has none | without meaning | without meaning |
| param1 | corners of the polygon, or radius in m, in float32 | the same | the same |
| other params, autocontinue | 0 | without meaning | without meaning |
"""

from __future__ import annotations

import math
from dataclasses import replace

from gcs.core.mission import Command, MissionItem
from gcs.core.vehicle import Autopilot

_PLAIN_FRAME = {5: 0, 6: 3, 11: 10}
_WITH_PARAM1 = frozenset(
    {
        Command.NAV_FENCE_POLYGON_VERTEX_INCLUSION,
        Command.NAV_FENCE_POLYGON_VERTEX_EXCLUSION,
        Command.NAV_FENCE_CIRCLE_INCLUSION,
        Command.NAV_FENCE_CIRCLE_EXCLUSION,
    }
)


def canonical_fence_item(item: MissionItem, autopilot: Autopilot) -> MissionItem:
    """A fence item, its floats in float32 already, as a family of autopilots holds it."""
    frame = {Autopilot.ARDUPILOT: 0, Autopilot.PX4: 5}.get(autopilot, _PLAIN_FRAME.get(item.frame, item.frame))
    param1 = item.params[0] if item.command in _WITH_PARAM1 else 0.0
    return replace(item, frame=frame, params=(param1, 0.0, 0.0, 0.0), z=0.0, current=0, autocontinue=0)


def canonical_rally_item(item: MissionItem, autopilot: Autopilot) -> MissionItem:
    """A rally point, its floats in float32 already, as a family of autopilots holds it."""
    frame = 5 if autopilot is Autopilot.PX4 else _PLAIN_FRAME.get(item.frame, item.frame)
    whole = autopilot is Autopilot.ARDUPILOT and math.isfinite(item.z)
    z = float(int(item.z)) if whole else item.z
    return replace(item, frame=frame, params=(0.0, 0.0, 0.0, 0.0), z=z, current=0, autocontinue=0)
