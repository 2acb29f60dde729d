"""The path that an ArduPilot-like vehicle remembers, to fly home along it (SmartRTL)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gcs.planning.flights.retrace import straightened

Array = NDArray[np.float64]

SAVE_S = 1 / 3
_LOOK_THROUGH_EVERY = 50
_LOOK_THROUGH_AT_LAST = 10
_CUT_WITHIN = 0.99


class PathMemory:
    """Keeps points of a flight; straightens and cuts loops now and then, and gives up when it is full.

    Args:
        home_m: where the flight starts.
        accuracy_m: least distance of two points kept; 0 keeps nothing.
        most: points that there is room for.
    """

    def __init__(self, home_m: Array, accuracy_m: float, most: int) -> None:
        self._accuracy_m = accuracy_m
        self._most = most
        self._points = [np.array(home_m, dtype=np.float64)]
        self._looked_through = 1
        self._since_s = 0.0
        self.usable = accuracy_m > 0.0 and most > 0

    def watch(self, position_m: Array, dt_s: float) -> bool:
        """Let time pass; False when the memory has just become full."""
        self._since_s += dt_s
        if not self.usable or self._since_s < SAVE_S:
            return True
        self._since_s = 0.0
        if np.linalg.norm(position_m - self._points[-1]) < self._accuracy_m:
            return True
        if len(self._points) >= self._most:
            self.usable = False
            return False
        self._points.append(np.array(position_m, dtype=np.float64))
        fresh = len(self._points) - self._looked_through
        near_full = self._most - len(self._points) <= _LOOK_THROUGH_AT_LAST
        if fresh >= _LOOK_THROUGH_EVERY or (near_full and fresh >= _LOOK_THROUGH_AT_LAST):
            self._look_through()
        return True

    def way_back(self, position_m: Array) -> list[Array]:
        """The points to fly to, from here to home."""
        self._points.append(np.array(position_m, dtype=np.float64))
        self._look_through()
        return self._points[-2::-1]

    def _look_through(self) -> None:
        path = np.array(self._points)
        path = without_loops(path[straightened(path, 0.5 * self._accuracy_m)], _CUT_WITHIN * self._accuracy_m)
        self._points = list(path)
        self._looked_through = len(self._points)


def without_loops(path_m: Array, within_m: float) -> Array:
    """Cut out what lies between two pieces of a polyline (N, 3) that meet within a distance, latest loops first."""
    path = np.asarray(path_m, dtype=np.float64)
    i = len(path) - 1
    while i >= 3:
        earlier = path[: i - 1]
        distance, middle = _between_segments(path[i - 1], path[i], earlier[:-1], earlier[1:])
        meets = np.flatnonzero(distance < within_m)
        if len(meets):
            j = int(meets[0])
            path = np.concatenate([path[: j + 1], middle[j][None], path[i:]])
            i = j + 1
        i -= 1
    return path


def _between_segments(a: Array, b: Array, c: Array, d: Array) -> tuple[Array, Array]:
    """Distance of one segment a-b (3,) from others c-d (M, 3), and the middle of where they are nearest."""
    u, v, w = b - a, d - c, a - c
    uu, vv = max(float(u @ u), 1e-12), np.maximum((v * v).sum(axis=1), 1e-12)
    uv, uw, vw = v @ u, w @ u, (v * w).sum(axis=1)
    square = uu * vv - uv**2
    s = np.where(square > 1e-12, (uv * vw - vv * uw) / np.maximum(square, 1e-12), 0.0).clip(0.0, 1.0)
    t = ((uv * s + vw) / vv).clip(0.0, 1.0)
    s = ((uv * t - uw) / uu).clip(0.0, 1.0)
    p, q = a + s[:, None] * u, c + t[:, None] * v
    return np.linalg.norm(p - q, axis=1), (p + q) / 2
