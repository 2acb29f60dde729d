"""What the companion's own sensors say: scans of the lidar, and the odometry that is computed from them."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from gcs.core.errors import InputError
from gcs.services.companion.lidar_reading import PointGathering, scan_of_sectors
from gcs.services.companion.odometry_check import OdometryCheck

if TYPE_CHECKING:
    from collections.abc import Callable

    from gcs.mavlink.dialect import Message
    from gcs.planning.local.lidar_scan import LidarScan
    from gcs.services.companion.own_vehicle import OwnVehicle

SENSOR_MESSAGES = frozenset({"OBSTACLE_DISTANCE", "OBSTACLE_DISTANCE_3D", "ODOMETRY"})
SAME_CLOCK_S = 1.0
"""A time stamp that is no further from the vehicle's clock is of this clock; others say nothing."""


class Senses:
    """Reads the sensors' messages; what cannot be used is said once, and dropped.

    Args:
        slab_half_m: points in space count within this of the vehicle's height.
        say: takes what the operator should read.

    Attributes:
        odometry: beside the estimator.
    """

    def __init__(self, slab_half_m: float, say: Callable[[str], None]) -> None:
        self.odometry = OdometryCheck()
        self._points = PointGathering(slab_half_m)
        self._say = say
        self._refused: set[str] = set()
        self._scanned_s = -math.inf

    def lidar_age_s(self, vehicle_s: float) -> float | None:
        """Since the last good scan, on the vehicle's clock; None when there was none."""
        return None if math.isinf(self._scanned_s) else max(vehicle_s - self._scanned_s, 0.0)

    def take(self, message: Message, vehicle: OwnVehicle) -> tuple[LidarScan, float] | None:
        """Take one of `SENSOR_MESSAGES`; returns the scan it completes and when (vehicle's clock) that was."""
        now = vehicle.now_s()
        if now is None:
            return None
        try:
            return self._take(message, vehicle, now)
        except InputError as error:
            self.refuse(error)
            return None

    def refuse(self, error: InputError) -> None:
        """Something of the sensors cannot be used: say so, each kind once."""
        kind = error.field or error.message
        if kind not in self._refused:
            self._refused.add(kind)
            self._say(f"lidar: {error.message}")

    def _take(self, message: Message, vehicle: OwnVehicle, now_s: float) -> tuple[LidarScan, float] | None:
        kind = message.get_type()
        if kind == "OBSTACLE_DISTANCE_3D":
            attitude = vehicle.poses.attitude(now_s) or (0.0, 0.0, 0.0)
            gathered = self._points.take(message, attitude[0], attitude[1])
            return None if gathered is None else (gathered[0], self._measured(gathered[1], now_s))
        at_s = _stamp(message.time_usec * 1e-6, now_s)
        attitude = vehicle.poses.attitude(at_s) or (0.0, 0.0, 0.0)
        if kind == "ODOMETRY":
            self.odometry.take(message, at_s, vehicle.poses.position(at_s), attitude[2])
            return None
        scan = scan_of_sectors(message, attitude[2])
        return scan, self._measured(at_s, now_s)

    def _measured(self, at_s: float, now_s: float) -> float:
        self._scanned_s = at_s = _stamp(at_s, now_s)
        self._refused.clear()  # it sees again: what goes wrong next is worth a word again
        return at_s


def _stamp(stamp_s: float, now_s: float) -> float:
    """When something was measured, if its stamp is of the vehicle's clock; otherwise now."""
    return min(stamp_s, now_s) if abs(stamp_s - now_s) <= SAME_CLOCK_S else now_s
