"""What the lidar's messages say, as scans for the navigator; points in space become sectors of the vehicle's slab."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from gcs.mavlink.obstacle_messages import obstacle_point, obstacle_sectors
from gcs.planning.local.lidar_scan import LidarScan

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from gcs.mavlink.dialect import Message

POINT_SECTORS = 72


def scan_of_sectors(message: Message, yaw_rad: float, hull_m: float) -> tuple[LidarScan, float | None]:
    """The scan of an OBSTACLE_DISTANCE: each beam is the least range within its step.

    What is nearer than the sensor can measure, or inside the hull, is on the vehicle or the sensor itself: nothing is
    known of what lies behind it.

    Args:
        message: as received.
        yaw_rad: of the vehicle's nose, from east; for sectors that are told about north.
        hull_m: radius of the vehicle about the sensor.

    Returns:
        The scan, and the bearing (rad, left of the nose) of something on the vehicle; None when there is nothing.

    Raises:
        InputError: the message, or the scan in it, cannot be used; it says why.
    """
    sectors = obstacle_sectors(message)
    first = sectors.first_rad - (yaw_rad if sectors.northward else 0.0)
    scan = LidarScan(sectors.ranges_m, first, sectors.step_rad, sectors.most_m, sectors.known)
    touching = sectors.known & (sectors.ranges_m < max(hull_m, sectors.least_m))
    if not touching.any():
        return scan, None
    return replace(scan, known=sectors.known & ~touching), first + sectors.step_rad * int(touching.argmax())


class PointGathering:
    """Gathers the points of one OBSTACLE_DISTANCE_3D scan, which come in a message each.

    Sectors without a point are unknown, not free: the messages tell obstacles alone.

    Args:
        half_m: points so far above and below the vehicle count.
    """

    def __init__(self, half_m: float) -> None:
        self._half_m = half_m
        self._points: list[NDArray[np.float64]] = []
        self._at_s = -math.inf
        self._most_m = 0.0

    def take(self, message: Message, roll_rad: float, pitch_rad: float) -> tuple[LidarScan, float] | None:
        """Take a point; returns the scan before it and its time (s, the sender's clock) when a new one begins.

        Args:
            message: as received.
            roll_rad: of the vehicle, right side down is positive.
            pitch_rad: of the vehicle, nose up is positive.

        Raises:
            InputError: it cannot be a point; it says why.
        """
        point = obstacle_point(message)
        before = None
        if point.time_boot_s != self._at_s:
            before = self._scan()
            self._points, self._at_s, self._most_m = [], point.time_boot_s, point.most_m
        self._points.append(_levelled(point.offset_m, roll_rad, pitch_rad))
        return before

    def _scan(self) -> tuple[LidarScan, float] | None:
        near = [point for point in self._points if abs(point[2]) <= self._half_m]
        if not near:
            return None
        step = 2 * math.pi / POINT_SECTORS
        ranges = np.full(POINT_SECTORS, np.inf)
        for point in near:
            sector = round(math.atan2(point[1], point[0]) / step) % POINT_SECTORS
            ranges[sector] = min(ranges[sector], math.hypot(point[0], point[1]))
        return LidarScan(ranges, 0.0, step, self._most_m, np.isfinite(ranges)), self._at_s


def _levelled(offset_m: NDArray[np.float64], roll_rad: float, pitch_rad: float) -> NDArray[np.float64]:
    """Forward, left and up in the body to the same about the horizon."""
    forward, left, up = offset_m
    c, s = math.cos(roll_rad), math.sin(roll_rad)
    left, up = c * left - s * up, c * up + s * left
    c, s = math.cos(pitch_rad), math.sin(pitch_rad)
    return np.array([c * forward - s * up, left, c * up + s * forward])
