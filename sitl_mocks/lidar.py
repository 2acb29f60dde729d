"""A simulated 2D lidar at the vehicle's middle, and the odometry that it computes from its scans.

The lidar turns level at the vehicle's height: the few degrees of the vehicle's tilt are left out. It sees the simulated
obstacles that cross this plane, and nothing else: neither the structure nor the ground.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sitl_mocks.airframe import Airframe
from sitl_mocks.dialect import Message, mavlink
from sitl_mocks.obstacles import Obstacles

Array = NDArray[np.float64]

SCAN_S = 0.1
SECTORS = 72
BEAMS_PER_SECTOR = 10
REACH_M = 30.0
LEAST_M = 0.2
NOISE_M = 0.02
UNKNOWN = 65535
DRIFT_PER_SQRT_M = 0.02
"""Standard deviation of the odometry's error on each axis after a metre; it grows with the root of the way."""
QUALITY = 90
FAILED_QUALITY = -1

CLEAR, COVERED, SILENT = "clear", "covered", "silent"
LIDAR_STATES = (CLEAR, COVERED, SILENT)
"""Covered: every range is zero. Silent: no messages."""
TRACKING, FAILED = "tracking", "failed"
ODOMETRY_STATES = (TRACKING, FAILED, SILENT)
"""Failed: messages that say so."""


@dataclass(frozen=True)
class LidarOptions:
    """How the lidar is set up.

    Attributes:
        tells_3d: whether it sends OBSTACLE_DISTANCE_3D, one for each sector with something in it, too.
        noise_m: standard deviation of each beam's range.
        seed: of noise and drift.
    """

    tells_3d: bool = False
    noise_m: float = NOISE_M
    seed: int = 0


class Lidar:
    """Scans, and sends what it finds.

    Args:
        airframe: that carries it.
        obstacles: that it may see.
        options: how it is set up.
        send: takes its messages.
    """

    def __init__(
        self, airframe: Airframe, obstacles: Obstacles, options: LidarOptions, send: Callable[[Message], None]
    ) -> None:
        self._airframe = airframe
        self._obstacles = obstacles
        self._options = options
        self._send = send
        self._rng = np.random.default_rng([options.seed, 7])
        count = SECTORS * BEAMS_PER_SECTOR
        # Bearings from the nose, clockwise; the first sector's middle is straight ahead.
        self._beams = ((np.arange(count) + 0.5) / BEAMS_PER_SECTOR - 0.5) * (2.0 * math.pi / SECTORS)
        self._next_s = 0.0
        self._start_m = airframe.true_position_m
        self._start_yaw_rad = airframe.yaw_rad
        self._last_m = airframe.true_position_m
        self._drift_m = np.zeros(3)
        self._way_m = 0.0
        self.state = CLEAR
        self.odometry_state = TRACKING

    def tick(self, now_s: float) -> None:
        """Scan when it is time to; the time is the vehicle's clock."""
        if now_s < self._next_s - 1e-9:
            return
        self._next_s = max(self._next_s + SCAN_S, now_s)
        self._wander()
        if self.state != SILENT:
            sectors = self.scan(now_s) if self.state == CLEAR else np.zeros(SECTORS)
            self._send(_distances(sectors, now_s))
            if self._options.tells_3d:
                for number in np.flatnonzero(np.isfinite(sectors)):
                    self._send(_point(float(sectors[number]), int(number), now_s))
        if self.odometry_state != SILENT:
            self._send(self._odometry(now_s))

    def scan(self, now_s: float) -> Array:
        """Least range of each sector, clockwise from the nose; infinite where nothing is within reach."""
        bearings = self._airframe.yaw_rad - self._beams
        ranges = self._obstacles.sweep(self._airframe.true_position_m, bearings, REACH_M, now_s)
        measured = np.maximum(ranges + self._options.noise_m * self._rng.standard_normal(len(ranges)), 0.0)
        return np.asarray(measured.reshape(SECTORS, BEAMS_PER_SECTOR).min(axis=1))

    def _wander(self) -> None:
        way_m = float(np.linalg.norm(self._airframe.true_position_m - self._last_m))
        self._last_m = self._airframe.true_position_m
        self._way_m += way_m
        self._drift_m += DRIFT_PER_SQRT_M * math.sqrt(way_m) * self._rng.standard_normal(3)

    def _odometry(self, now_s: float) -> Message:
        """ODOMETRY in a frame that looked ahead, right and down where the lidar started."""
        airframe = self._airframe
        place = _forward_right_down(airframe.true_position_m + self._drift_m - self._start_m, self._start_yaw_rad)
        velocity = _forward_right_down(airframe.true_velocity_m_s, airframe.yaw_rad)
        turned = self._start_yaw_rad - airframe.yaw_rad
        failed = self.odometry_state == FAILED
        variance = math.nan if failed else 1e-4 + DRIFT_PER_SQRT_M**2 * self._way_m
        return mavlink.MAVLink_odometry_message(
            round(now_s * 1e6),
            mavlink.MAV_FRAME_LOCAL_FRD,
            mavlink.MAV_FRAME_BODY_FRD,
            *place,
            [math.cos(turned / 2.0), 0.0, 0.0, math.sin(turned / 2.0)],
            *velocity,
            0.0,
            0.0,
            float(-airframe.state[12]),
            _covariance(variance, 1e-4),
            _covariance(1e-3, 1e-3),
            0,
            mavlink.MAV_ESTIMATOR_TYPE_LIDAR,
            FAILED_QUALITY if failed else QUALITY,
        )


def _distances(sectors: Array, now_s: float) -> Message:
    reach_cm = round(REACH_M * 100.0)
    centimetres = np.where(np.isfinite(sectors), np.minimum(sectors * 100.0, reach_cm), reach_cm + 1)
    return mavlink.MAVLink_obstacle_distance_message(
        round(now_s * 1e6),
        mavlink.MAV_DISTANCE_SENSOR_LASER,
        [round(float(value)) for value in centimetres],
        360 // SECTORS,
        round(LEAST_M * 100.0),
        reach_cm,
        360.0 / SECTORS,
        0.0,
        mavlink.MAV_FRAME_BODY_FRD,
    )


def _point(range_m: float, number: int, now_s: float) -> Message:
    bearing = number * 2.0 * math.pi / SECTORS
    return mavlink.MAVLink_obstacle_distance_3d_message(
        round(now_s * 1e3) % 2**32,
        mavlink.MAV_DISTANCE_SENSOR_LASER,
        mavlink.MAV_FRAME_BODY_FRD,
        UNKNOWN,
        range_m * math.cos(bearing),
        range_m * math.sin(bearing),
        0.0,
        LEAST_M,
        REACH_M,
    )


def _forward_right_down(enu: Array, yaw_rad: float) -> tuple[float, float, float]:
    east, north, up = (float(c) for c in enu)
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    return east * c + north * s, east * s - north * c, -up


def _covariance(place: float, angle: float) -> list[float]:
    """Upper right triangle, row by row, of a diagonal matrix of six rows."""
    rows = [[(place if i < 3 else angle) if i == j else 0.0 for j in range(i, 6)] for i in range(6)]
    return [value for row in rows for value in row]
