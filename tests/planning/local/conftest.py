"""The yard paper's query as a binarised map, in the plane and as a room of space."""

import numpy as np
import pytest

from gcs.planning.local.binary_map import BinaryMap

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
