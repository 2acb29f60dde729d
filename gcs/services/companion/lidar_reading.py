"""What the lidar's messages say, as scans for the navigator; points in space become sectors of the vehicle's slab.

What is nearer than the sensor can measure, or inside the hull, is on the vehicle or the sensor itself. It is nothing to
fly away from, and hides what is behind it: such a sector is unknown.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from gcs.mavlink.obstacle_messages import obstacle_point, obstacle_sectors
from gcs.planning.local.lidar_scan import LidarScan

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from gcs.mavlink.dialect import Message

POINT_SECTORS = 72


class Reading(NamedTuple):
    """What one scan says.

    Attributes:
        scan: None when nothing of it is in the vehicle's slab.
        touched_rad: bearing, left of the nose, of something on the vehicle or its lidar; None when there is nothing.
    """

    scan: LidarScan | None
    touched_rad: float | None


def sectors_reading(message: Message, yaw_rad: float, hull_m: float) -> Reading:
    """Read an OBSTACLE_DISTANCE: each beam is the least range within its step.

    Args:
        message: as received.
        yaw_rad: of the vehicle's nose, from east; for sectors that are told about north.
        hull_m: radius of the vehicle about the sensor.

    Raises:
        InputError: the message, or the scan in it, cannot be used; it says why.
    """
    sectors = obstacle_sectors(message)
    first = sectors.first_rad - (yaw_rad if sectors.northward else 0.0)
    scan = LidarScan(sectors.ranges_m, first, sectors.step_rad, sectors.most_m, sectors.known)
    touching = sectors.known & (sectors.ranges_m < max(hull_m, sectors.least_m))
    if not touching.any():
        return Reading(scan, None)
    touched = first + sectors.step_rad * int(touching.argmax())
    return Reading(replace(scan, known=sectors.known & ~touching), touched)


class PointGathering:
    """Gathers the points of one OBSTACLE_DISTANCE_3D scan, which come in a message each and carry the same time.

    Sectors without a point are unknown, not free: the messages tell obstacles alone.

    Args:
        half_m: points so far above and below the vehicle count.

    Attributes:
        at_s: time of the scan that is gathered (the sender's clock); None when there is none.
    """

    at_s: float | None
    _touched_rad: float | None

    def __init__(self, half_m: float) -> None:
        self._half_m = half_m
        self._start()

    def take(self, message: Message, roll_rad: float, pitch_rad: float, hull_m: float) -> None:
        """Add a point of the scan that is gathered.

        Args:
            message: as received.
            roll_rad: of the vehicle, right side down is positive.
            pitch_rad: of the vehicle, nose up is positive.
            hull_m: radius of the vehicle about the sensor.

        Raises:
            InputError: it cannot be a point; it says why.
        """
        point = obstacle_point(message)
        self.at_s, self._most_m = point.time_boot_s, point.most_m
        forward, left, up = _levelled(point.offset_m, roll_rad, pitch_rad)
        if abs(up) > self._half_m:
            return
        range_m, bearing = math.hypot(forward, left), math.atan2(left, forward)
        if range_m < max(hull_m, point.least_m):
            self._touched_rad = bearing
            return
        sector = round(bearing / (2 * math.pi / POINT_SECTORS)) % POINT_SECTORS
        self._ranges_m[sector] = min(self._ranges_m[sector], range_m)

    def finish(self) -> Reading:
        """What was gathered; from now on points are of another scan."""
        known = np.isfinite(self._ranges_m)
        step = 2 * math.pi / POINT_SECTORS
        scan = LidarScan(self._ranges_m, 0.0, step, self._most_m, known) if known.any() else None
        reading = Reading(scan, self._touched_rad)
        self._start()
        return reading

    def _start(self) -> None:
        self.at_s, self._most_m = None, 0.0
        self._ranges_m = np.full(POINT_SECTORS, np.inf)
        self._touched_rad = None


def _levelled(offset_m: NDArray[np.float64], roll_rad: float, pitch_rad: float) -> tuple[float, float, float]:
    """Forward, left and up in the body to the same about the horizon."""
    forward, left, up = (float(part) for part in offset_m)
    c, s = math.cos(roll_rad), math.sin(roll_rad)
    left, up = c * left - s * up, c * up + s * left
    c, s = math.cos(pitch_rad), math.sin(pitch_rad)
    return c * forward - s * up, left, c * up + s * forward
