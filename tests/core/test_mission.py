"""The fingerprint of a mission tells items apart and holds NaN equal to NaN."""

import dataclasses
import math

from gcs.core.mission import Command, Frame, MissionItem, mission_crc32

ITEM = MissionItem(0, Frame.GLOBAL_INT, Command.NAV_WAYPOINT, (1.0, math.nan, 0.0, 2.0), 313622000, 1216155000, 12.5)


def test_equal_missions_have_equal_fingerprints():
    assert mission_crc32((ITEM,)) == mission_crc32((dataclasses.replace(ITEM, params=(1.0, math.nan, 0.0, 2.0)),))


def test_any_change_shows():
    changes = [
        {"sequence": 1},
        {"frame": 0},
        {"command": 21},
        {"params": (1.0, 0.0, 0.0, 2.0)},
        {"x": 1},
        {"y": 1},
        {"z": 12.6},
        {"autocontinue": 0},
    ]
    prints = {mission_crc32((dataclasses.replace(ITEM, **c),)) for c in changes} | {mission_crc32((ITEM,))}
    assert len(prints) == len(changes) + 1
