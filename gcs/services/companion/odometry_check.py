"""The lidar's own odometry beside the estimator that is flown by: two that go apart mean that one of them is wrong.

Both ways of the last seconds are compared, turned to the same heading, so that neither the odometry's own origin nor
its slow drift matters. The odometry does not correct anything: when it fails or disagrees, the companion hovers.
"""

from __future__ import annotations

import math
from collections import deque
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from gcs.core.frames import enu_from_ned, wrap_angle, yaw_from_heading
from gcs.mavlink.dialect import mavlink

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from gcs.mavlink.dialect import Message

WINDOW_S = 4.0
APART_M = 1.0
"""So far the two ways may differ, besides `SIGMAS` standard deviations of the odometry's own."""

SIGMAS = 3.0
LEAST_QUALITY = 10
"""Percent; 0 is "not told" and counts as good, what is negative has failed."""

SILENT_S = 1.5
LOCAL_FRAMES = frozenset({mavlink.MAV_FRAME_LOCAL_FRD, mavlink.MAV_FRAME_LOCAL_NED})


class _Sample(NamedTuple):
    at_s: float
    own_m: NDArray[np.float64]
    own_yaw_rad: float
    variance_m2: float
    place_m: NDArray[np.float64]
    yaw_rad: float


class OdometryCheck:
    """Follows ODOMETRY messages.

    Attributes:
        quality: last told, 0 to 100, -1 when it has failed or tells none; None before the first.
    """

    def __init__(self) -> None:
        self.quality: int | None = None
        self._samples: deque[_Sample] = deque()
        self._heard_s = -math.inf
        self._apart: str | None = None

    def take(self, message: Message, vehicle_s: float, place_m: NDArray[np.float64] | None, yaw_rad: float) -> None:
        """Take an ODOMETRY.

        Args:
            message: as received.
            vehicle_s: the vehicle's clock when it was measured.
            place_m: the estimator's place then, local ENU, shape (3,); None when not known.
            yaw_rad: the estimator's yaw then, from east.
        """
        self._heard_s = vehicle_s
        own = enu_from_ned([message.x, message.y, message.z])
        variance = _variance(message)
        quality = int(message.quality)
        usable = np.isfinite(own).all() and message.frame_id in LOCAL_FRAMES and math.isfinite(variance)
        self.quality = quality if usable else -1
        if not usable or quality < 0 or place_m is None:
            self._samples.clear()
            return
        self._samples.append(_Sample(vehicle_s, own, _yaw(message), variance, place_m, yaw_rad))
        while self._samples[0].at_s < vehicle_s - WINDOW_S:
            self._samples.popleft()
        self._apart = self._compare(self._samples[0], self._samples[-1])

    @staticmethod
    def _compare(first: _Sample, last: _Sample) -> str | None:
        turn = wrap_angle(first.yaw_rad - first.own_yaw_rad)
        c, s = math.cos(turn), math.sin(turn)
        way = last.own_m - first.own_m
        turned = np.array([c * way[0] - s * way[1], s * way[0] + c * way[1], way[2]])
        apart_m = float(np.linalg.norm(turned - (last.place_m - first.place_m)))
        grown_m2 = max(last.variance_m2 - first.variance_m2, 0.0)
        if apart_m <= APART_M + SIGMAS * math.sqrt(grown_m2):
            return None
        return f"odometry {apart_m:.1f} m off the estimator"

    def problem(self, vehicle_s: float) -> str | None:
        """What is wrong with it, in plain words; None when it is well, or was never heard."""
        if self.quality is None:
            return None
        if vehicle_s - self._heard_s > SILENT_S:
            return "odometry is silent"
        if self.quality < 0 or 0 < self.quality < LEAST_QUALITY:
            return "odometry has failed"
        return self._apart


def _variance(message: Message) -> float:
    """The largest of the place's variances; 0 where the first entry says that it is not known."""
    x, y, z = (float(message.pose_covariance[k]) for k in (0, 6, 11))
    return 0.0 if math.isnan(x) else max(x, y, z)


def _yaw(message: Message) -> float:
    """Yaw from east that the attitude says in the odometry's own frame, read as north-east-down."""
    w, x, y, z = (float(part) for part in message.q)
    return yaw_from_heading(math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)))
