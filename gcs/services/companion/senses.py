"""What the companion's own sensors say: scans of the lidar, and the odometry that is computed from them."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from gcs.core.errors import InputError
from gcs.core.frames import wrap_angle
from gcs.services.companion.lidar_reading import PointGathering, sectors_reading
from gcs.services.companion.odometry_check import OdometryCheck

if TYPE_CHECKING:
    from collections.abc import Callable

    from gcs.mavlink.dialect import Message
    from gcs.planning.local.lidar_scan import LidarScan
    from gcs.services.companion.own_vehicle import OwnVehicle

    Measured = tuple[LidarScan, float]
    """A scan, and when it was measured (vehicle's clock)."""

SENSOR_MESSAGES = frozenset({"OBSTACLE_DISTANCE", "OBSTACLE_DISTANCE_3D", "ODOMETRY"})
QUIET_S = 10.0
"""What was wrong is said again only after it was well for so long."""

COVERED_S, UNCOVERED_S = 2.0, 1.0
"""What is on the vehicle or its lidar for so long makes it blind there, until it is gone for so long."""

SAME_CLOCK_S = 1.0
"""A time stamp that is no further from the vehicle's clock is of this clock; others say nothing."""

GATHERED_S = 0.02
"""No further point for so long: the scan is whole."""

SAME_SCAN_S = 0.005
"""Points so near in time to sectors are of the same scan, which has been taken."""


class Senses:
    """Reads the sensors' messages; what cannot be used is said once, and dropped.

    Args:
        slab_half_m: points in space count within this of the vehicle's height.
        say: takes what the operator should read.

    Attributes:
        odometry: beside the estimator.
        hears_sectors: whether OBSTACLE_DISTANCE was heard; where nothing is within reach, points in space are silent.
        hull_m: what a lidar at the vehicle's middle sees nearer than this is on the vehicle itself.
        deadline: clock time at which `on_time` wants to be called next.
    """

    def __init__(self, slab_half_m: float, say: Callable[[str], None]) -> None:
        self.odometry = OdometryCheck()
        self.hears_sectors = False
        self.hull_m = 0.0
        self.deadline = math.inf
        self._points = PointGathering(slab_half_m)
        self._say = say
        self._refused: dict[str, float] = {}
        self._sectors_s = self._points_s = -math.inf
        self._touched_since_s = self._touched_s = -math.inf
        self._touched_deg = 0

    def lidar_age_s(self, vehicle_s: float) -> float | None:
        """Since the last good scan, or point in space, on the vehicle's clock; None when there was none."""
        heard_s = max(self._sectors_s, self._points_s)
        return None if math.isinf(heard_s) else max(vehicle_s - heard_s, 0.0)

    def covered(self, vehicle_s: float) -> str | None:
        """Says so when something has been on the vehicle or its lidar for long."""
        lasts = self._touched_s - self._touched_since_s >= COVERED_S
        if not lasts or vehicle_s - self._touched_s > UNCOVERED_S:
            return None
        side = "left" if self._touched_deg > 0 else "right"
        return f"something is on the vehicle or its lidar, {abs(self._touched_deg)} degrees {side} of the nose"

    def take(self, message: Message, vehicle: OwnVehicle) -> Measured | None:
        """Take one of `SENSOR_MESSAGES`; returns the scan that it completes."""
        now = vehicle.now_s()
        if now is None:
            return None
        if message.get_type() == "OBSTACLE_DISTANCE_3D":
            return self._take_point(message, vehicle, now)
        at_s = _stamp(message.time_usec * 1e-6, now)
        attitude = vehicle.poses.attitude(at_s) or (0.0, 0.0, 0.0)
        if message.get_type() == "ODOMETRY":
            self.odometry.take(message, at_s, vehicle.poses.position(at_s), attitude[2])
            return None
        self.hears_sectors = True
        try:
            scan, touched_rad = sectors_reading(message, attitude[2], self.hull_m)
        except InputError as error:
            self.refuse(error, now)
            return None
        self._sectors_s = at_s
        self._notice_touch(touched_rad, at_s)
        return None if scan is None else (scan, at_s)

    def on_time(self, vehicle: OwnVehicle) -> Measured | None:
        """Returns the scan of which no further point comes."""
        now = vehicle.now_s()
        return None if now is None else self._gathered(now)

    def refuse(self, error: InputError, vehicle_s: float) -> None:
        """Something of the sensors cannot be used: say so, each kind once until it is over."""
        kind = error.field or error.message
        if vehicle_s - self._refused.get(kind, -math.inf) > QUIET_S:
            self._say(f"lidar: {error.message}")
        self._refused[kind] = vehicle_s

    def _take_point(self, message: Message, vehicle: OwnVehicle, now_s: float) -> Measured | None:
        began_s = message.time_boot_ms * 1e-3
        before = None if self._points.at_s in (None, began_s) else self._gathered(now_s)
        attitude = vehicle.poses.attitude(now_s) or (0.0, 0.0, 0.0)
        try:
            self._points.take(message, attitude[0], attitude[1], self.hull_m)
        except InputError as error:
            self.refuse(error, now_s)
        else:
            self._points_s = _stamp(began_s, now_s)
            self.deadline = vehicle.channel.clock() + GATHERED_S
        return before

    def _gathered(self, now_s: float) -> Measured | None:
        """End a scan of points; None when it says nothing that is not known."""
        self.deadline = math.inf
        if self._points.at_s is None:
            return None
        at_s = _stamp(self._points.at_s, now_s)
        scan, touched_rad = self._points.finish()
        self._notice_touch(touched_rad, at_s)
        return None if scan is None or abs(at_s - self._sectors_s) <= SAME_SCAN_S else (scan, at_s)

    def _notice_touch(self, touched_rad: float | None, at_s: float) -> None:
        if touched_rad is None:
            return
        if at_s - self._touched_s > UNCOVERED_S:
            self._touched_since_s = at_s
        self._touched_s = at_s
        self._touched_deg = round(math.degrees(wrap_angle(touched_rad)))


def _stamp(stamp_s: float, now_s: float) -> float:
    """When something was measured, if its stamp is of the vehicle's clock; otherwise now."""
    return min(stamp_s, now_s) if abs(stamp_s - now_s) <= SAME_CLOCK_S else now_s
