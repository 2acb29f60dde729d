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
QUIET_S = 10.0
"""What was wrong is said again only after it was well for so long."""
COVERED_S = 2.0
"""What is on the vehicle or its lidar for so long makes it blind there."""
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
        self._refused: dict[str, float] = {}
        self._scanned_s = self._heard_s = -math.inf
        self._covered: tuple[float, int] | None = None

    def lidar_age_s(self, vehicle_s: float) -> float | None:
        """Since the last good scan, or point in space, on the vehicle's clock; None when there was none."""
        return None if math.isinf(self._heard_s) else max(vehicle_s - self._heard_s, 0.0)

    def covered(self, vehicle_s: float) -> str | None:
        """Says so when something has been on the vehicle or its lidar for long."""
        if self._covered is None or vehicle_s - self._covered[0] < COVERED_S:
            return None
        return f"something is on the vehicle or its lidar, {self._covered[1]} degrees left of the nose"

    def take(self, message: Message, vehicle: OwnVehicle, hull_m: float) -> tuple[LidarScan, float] | None:
        """Take one of `SENSOR_MESSAGES`; returns the scan it completes and when (vehicle's clock) that was.

        Args:
            message: of the vehicle.
            vehicle: whose clock and attitude are meant.
            hull_m: what a lidar at its middle sees nearer than this is on the vehicle itself.
        """
        now = vehicle.now_s()
        if now is None:
            return None
        try:
            return self._take(message, vehicle, now, hull_m)
        except InputError as error:
            self.refuse(error, now)
            return None

    def refuse(self, error: InputError, vehicle_s: float) -> None:
        """Something of the sensors cannot be used: say so, each kind once until it is over."""
        kind = error.field or error.message
        if vehicle_s - self._refused.get(kind, -math.inf) > QUIET_S:
            self._say(f"lidar: {error.message}")
        self._refused[kind] = vehicle_s

    def _take(
        self, message: Message, vehicle: OwnVehicle, now_s: float, hull_m: float
    ) -> tuple[LidarScan, float] | None:
        kind = message.get_type()
        if kind == "OBSTACLE_DISTANCE_3D":
            attitude = vehicle.poses.attitude(now_s) or (0.0, 0.0, 0.0)
            gathered = self._points.take(message, attitude[0], attitude[1])
            self._heard_s = max(self._heard_s, _stamp(message.time_boot_ms * 1e-3, now_s))
            if gathered is None or _stamp(gathered[1], now_s) < self._scanned_s:
                return None  # sectors have come since: they tell of free air, too
            return gathered[0], self._measured(gathered[1], now_s)
        at_s = _stamp(message.time_usec * 1e-6, now_s)
        attitude = vehicle.poses.attitude(at_s) or (0.0, 0.0, 0.0)
        if kind == "ODOMETRY":
            self.odometry.take(message, at_s, vehicle.poses.position(at_s), attitude[2])
            return None
        scan, touched_rad = scan_of_sectors(message, attitude[2], hull_m)
        at_s = self._measured(at_s, now_s)
        self._notice_cover(touched_rad, at_s)
        return scan, at_s

    def _notice_cover(self, touched_rad: float | None, at_s: float) -> None:
        if touched_rad is None:
            self._covered = None
        elif self._covered is None:
            self._covered = (at_s, round(math.degrees(touched_rad)) % 360)

    def _measured(self, at_s: float, now_s: float) -> float:
        self._scanned_s = at_s = _stamp(at_s, now_s)
        self._heard_s = max(self._heard_s, at_s)
        return at_s


def _stamp(stamp_s: float, now_s: float) -> float:
    """When something was measured, if its stamp is of the vehicle's clock; otherwise now."""
    return min(stamp_s, now_s) if abs(stamp_s - now_s) <= SAME_CLOCK_S else now_s
