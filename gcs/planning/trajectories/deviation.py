"""Distance of a curve from the nearest point of a polyline."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from gcs.planning.numerics.compiled import compiled

if TYPE_CHECKING:
    from numpy.typing import NDArray

Floats = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

_BLOCK = 16
"""Legs in a block."""


class PolylineDistance:
    """Exact distances to a polyline, blocks of consecutive legs being passed over by their bounding boxes.

    Args:
        path_m: shape (K, 3), K >= 2.
    """

    def __init__(self, path_m: NDArray[np.float64]) -> None:
        path = np.ascontiguousarray(path_m, dtype=np.float64)
        self._starts, self._ends = path[:-1].copy(), path[1:].copy()
        first = np.arange(0, len(self._starts), _BLOCK)
        self._low = np.minimum.reduceat(np.minimum(self._starts, self._ends), first)
        self._high = np.maximum.reduceat(np.maximum(self._starts, self._ends), first)

    def distance(self, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Distances (m) of points (N, 3) in the polyline's frame, shape (N,)."""
        result = np.empty(len(points_m))
        _distances(np.ascontiguousarray(points_m), self._starts, self._ends, self._low, self._high, result)
        return result


@compiled
def _leg_distance_squared(p: Floats, a: Floats, b: Floats) -> float:
    along = 0.0
    square = 0.0
    for k in range(3):
        along += (p[k] - a[k]) * (b[k] - a[k])
        square += (b[k] - a[k]) ** 2
    share = 0.0 if square == 0.0 else min(max(along / square, 0.0), 1.0)
    result = 0.0
    for k in range(3):
        result += (a[k] + share * (b[k] - a[k]) - p[k]) ** 2
    return result


@compiled
def _distances(points: Floats, starts: Floats, ends: Floats, low: Floats, high: Floats, result: Floats) -> None:
    nearest = 0
    for i in range(points.shape[0]):
        p = points[i]
        # The leg that was nearest to the point before is a good first guess.
        best = _leg_distance_squared(p, starts[nearest], ends[nearest])
        for block in range(low.shape[0]):
            gap = 0.0
            for k in range(3):
                outside = max(low[block, k] - p[k], p[k] - high[block, k], 0.0)
                gap += outside * outside
            if gap >= best:
                continue
            for leg in range(block * _BLOCK, min((block + 1) * _BLOCK, starts.shape[0])):
                square = _leg_distance_squared(p, starts[leg], ends[leg])
                if square < best:
                    best = square
                    nearest = leg
        result[i] = math.sqrt(best)
