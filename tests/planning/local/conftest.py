"""The yard paper's query as a binarised map, in the plane and as a room of space."""

import math

import numpy as np
import pytest

from gcs.planning.local.binary_map import BinaryMap
from gcs.planning.local.lidar_scan import LidarScan

START, GOAL = (6.7, 29.6), (39.9, 29.6)
OPTIMUM = 34.9728440


@pytest.fixture(scope="session")
def paper_map() -> BinaryMap:
    blocked = np.zeros((460, 460), dtype=np.bool_)
    blocked[198:268, 247:349] = True
    return BinaryMap(blocked, np.zeros(2), 0.1)


@pytest.fixture(scope="session")
def room() -> BinaryMap:
    """20 m x 20 m x 10 m with a wall across it, 8 m high."""
    blocked = np.zeros((40, 40, 20), dtype=np.bool_)
    blocked[18:22, :, :16] = True
    return BinaryMap(blocked, np.array([-10.0, -10.0, 0.0]), 0.5)


SECTORS, BEAMS_EACH, REACH = 72, 10, 20.0


@pytest.fixture(scope="session")
def sector_scan():
    """A lidar as autopilots pass it on: the least of ten beams in each of 72 sectors, with 2 cm of noise."""

    def scan(position, heading, circles, rng=None):
        count = SECTORS * BEAMS_EACH
        bearings = heading + ((np.arange(count) + 0.5) / BEAMS_EACH - 0.5) * 2 * math.pi / SECTORS
        rays = np.column_stack([np.cos(bearings), np.sin(bearings)])
        ranges = np.full(count, math.inf)
        for x, y, radius in circles:
            to = np.array([x, y]) - position
            along = rays @ to
            square = radius**2 - (to @ to - along**2)
            hit = (square > 0) & (along > 0)
            ranges[hit] = np.minimum(ranges[hit], np.maximum(along[hit] - np.sqrt(square[hit]), 0.0))
        if rng is not None:
            ranges = np.maximum(ranges + rng.normal(0.0, 0.02, count), 0.0)
        least = ranges.reshape(SECTORS, BEAMS_EACH).min(axis=1)
        return LidarScan(np.where(least <= REACH, least, math.inf), 0.0, 2 * math.pi / SECTORS, REACH)

    return scan
