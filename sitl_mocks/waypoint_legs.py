"""How ArduPilot flies a chain of waypoints at which it does not stop.

Each leg is a curve of speed from rest to rest that is laid over its neighbours' ones, so the shorter a leg is the
slower it is flown, and turns begin before the waypoint. Here a point is led along the legs, ahead of the vehicle by the
way that it needs to brake, at the speed that was measured for legs of such a length.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from sitl_mocks.airframe import Airframe, FlightLimits
from sitl_mocks.scene_frame import Array

_JERKS_M_S3 = (1.0, 5.0, 20.0)
_FACTORS = (0.57, 0.5, 0.38)
"""Fitted to flights with legs of 1 m to 8 m at these jerks."""
_SHARPEST_COSINE = 0.5
_PASSED_M = 0.3
"""How near it comes to a waypoint at which the turn is sharper than that."""
_LEAST_LEG_M = 1e-3
_MARGIN = 1.1
"""The point is led this much farther ahead than for the leg's speed: at just that speed the vehicle would brake."""


def leg_speed_m_s(length_m: float, jerk_m_s3: float) -> float:
    """Speed on a leg between others: `k (J L^2)^(1/3)`."""
    factor = float(np.interp(math.log(jerk_m_s3), np.log(_JERKS_M_S3), _FACTORS))
    return factor * math.cbrt(jerk_m_s3 * length_m**2)


class WaypointLeg:
    """One leg of a chain.

    Args:
        start_m: where it begins, scene ENU.
        target_m: the waypoint at its end.
        onward_m: the waypoint behind that; None where the leg ends at rest.
    """

    def __init__(self, start_m: Array, target_m: Array, onward_m: Array | None) -> None:
        self._start_m, self._target_m = start_m, target_m
        self._length_m, self._direction = _way(start_m, target_m)
        self.ends_at_rest = onward_m is None
        self._onward_length_m, self._onward = (0.0, self._direction) if onward_m is None else _way(target_m, onward_m)
        self._cosine = float(self._direction @ self._onward)
        self._is_sharp = self._cosine < _SHARPEST_COSINE

    def follow(self, airframe: Airframe, limits: FlightLimits) -> None:
        """Lead the vehicle on, no faster than this leg is flown, and across the waypoint no faster than the next."""
        speed = min(leg_speed_m_s(self._length_m, limits.jerk_m_s3), limits.horizontal_m_s)
        slowed = replace(
            limits,
            horizontal_m_s=speed,
            climb_m_s=min(speed, limits.climb_m_s),
            descent_m_s=min(speed, limits.descent_m_s),
        )
        airframe.set_limits(slowed)
        ahead = airframe.braking_way_m(_MARGIN * speed, self._direction)
        along = float((airframe.reference_m - self._start_m) @ self._direction)
        beyond = min(max(along, 0.0), self._length_m) + ahead - self._length_m
        if beyond <= 0.0:
            airframe.go_to(self._target_m + beyond * self._direction)
            return
        across = 0.0
        if not self._is_sharp:
            onward_speed = _MARGIN * leg_speed_m_s(self._onward_length_m, limits.jerk_m_s3)
            across = min(beyond, self._onward_length_m, airframe.braking_way_m(onward_speed, self._onward))
        airframe.go_to(self._target_m + across * self._cosine * self._onward)

    def is_passed(self, reference_m: Array) -> bool:
        """Whether the next leg begins here."""
        past = reference_m - self._target_m
        if self._is_sharp:
            return float(np.linalg.norm(past)) < _PASSED_M
        return float(past @ (self._direction + self._onward)) >= 0.0


def _way(start_m: Array, end_m: Array) -> tuple[float, Array]:
    """Length and direction; straight up where the two are one point."""
    way = end_m - start_m
    length = float(np.linalg.norm(way))
    return (length, way / length) if length > _LEAST_LEG_M else (0.0, np.array([0.0, 0.0, 1.0]))
