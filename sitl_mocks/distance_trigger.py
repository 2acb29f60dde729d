"""Pictures by the distance flown: what DO_SET_CAM_TRIGG_DIST asks for."""

from __future__ import annotations

import math

import numpy as np

from sitl_mocks.scene_frame import Array


class DistanceTrigger:
    """Says when the next picture is due.

    Args:
        distance_m: from one to the next; 0 for none any more.
        at_once: whether the first one is due where it begins.
    """

    def __init__(self, distance_m: float = 0.0, *, at_once: bool = False) -> None:
        self._distance_m = distance_m if distance_m > 0.0 else math.inf
        self._at_once = at_once
        self._last_m: Array | None = None

    def is_due(self, position_m: Array) -> bool:
        """Whether to take a picture here (scene ENU)."""
        if math.isinf(self._distance_m):
            return False
        if self._last_m is None:
            due = self._at_once
        else:
            due = float(np.linalg.norm(position_m - self._last_m)) >= self._distance_m
        if due or self._last_m is None:
            self._last_m = position_m.copy()
        return due
