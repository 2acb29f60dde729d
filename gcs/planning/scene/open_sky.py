"""The open sky over a scene: from which height, column by column, a straight climb is clear."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from gcs.planning.numerics.compiled import compiled

if TYPE_CHECKING:
    from numpy.typing import NDArray

HEIGHT_ROUNDING_M = 1e-9

Floats = np.ndarray[tuple[int, ...], np.dtype[np.float64]]


class OpenSky(NamedTuple):
    """Heights from which the sky is open (a named tuple, so that kernels can take it).

    Attributes:
        low: lowest corner of the grid, scene ENU, shape (3,).
        pitch: edge of the square columns (m).
        floor: lowest height from which every point of the column can climb, shape (nx, ny); inf where none can.
    """

    low: NDArray[np.float64]
    pitch: float
    floor: NDArray[np.float64]


@compiled
def covered_length(a: Floats, b: Floats, sky: OpenSky) -> float:
    """Length (m) of the part of a straight segment between two points (3,) that is not under the open sky.

    Walks the columns that the segment crosses; outside the grid nothing is under the open sky.
    """
    length = math.sqrt((b[0] - a[0]) ** 2 + (b[1] - a[1]) ** 2 + (b[2] - a[2]) ** 2)
    covered = 0.0
    at = 0.0
    while at < 1.0:
        leave = 1.0
        for k in range(2):
            rate = (b[k] - a[k]) / sky.pitch
            if rate == 0.0:
                continue
            place = (a[k] - sky.low[k]) / sky.pitch + at * rate
            border = math.floor(place) + 1.0 if rate > 0.0 else math.ceil(place) - 1.0
            leave = min(leave, at + (border - place) / rate)
        leave = max(leave, at + 1e-12)
        middle = (at + leave) / 2
        i = math.floor((a[0] + middle * (b[0] - a[0]) - sky.low[0]) / sky.pitch)
        j = math.floor((a[1] + middle * (b[1] - a[1]) - sky.low[1]) / sky.pitch)
        floor = math.inf
        if 0 <= i < sky.floor.shape[0] and 0 <= j < sky.floor.shape[1]:
            floor = sky.floor[i, j] - HEIGHT_ROUNDING_M
        enter_height = a[2] + at * (b[2] - a[2])
        leave_height = a[2] + leave * (b[2] - a[2])
        lowest, highest = min(enter_height, leave_height), max(enter_height, leave_height)
        if highest < floor:
            covered += leave - at
        elif lowest < floor:
            covered += (leave - at) * (floor - lowest) / (highest - lowest)
        at = leave
    return covered * length
