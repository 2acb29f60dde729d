"""ATTITUDE, ATTITUDE_TARGET and LOCAL_POSITION_NED of one vehicle, brought to the same moments of its clock."""

from __future__ import annotations

import math
from collections import deque
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from gcs.core.frames import enu_from_ned, yaw_from_heading
from gcs.core.motion import MotionSample, thrust_axis
from gcs.mavlink.dialect import Message

MOTION_MESSAGES = frozenset({"ATTITUDE", "ATTITUDE_TARGET", "LOCAL_POSITION_NED"})
"""All that `MotionSampler.take` has a use for."""
_MOST_APART_S = 0.3
_REBOOT_S = 2.0
_KEPT = 5


class _AxisTrack:
    """The last few directions of a thrust axis by time, interpolated between two of them."""

    def __init__(self) -> None:
        self._axes: deque[tuple[float, NDArray[np.float64]]] = deque(maxlen=_KEPT)

    def add(self, at_s: float, axis: NDArray[np.float64]) -> None:
        """One more; one that is no later than the last is passed over, but after a reboot all begins anew."""
        if self._axes and at_s <= self._axes[-1][0]:
            if at_s > self._axes[-1][0] - _REBOOT_S:
                return
            self._axes.clear()
        self._axes.append((at_s, axis))

    def at(self, at_s: float) -> NDArray[np.float64] | None:
        """Unit vector of a moment; None when none were heard close about it."""
        if self._axes and self._axes[-1][0] == at_s:
            return self._axes[-1][1]
        for (t0, before), (t1, after) in pairwise(self._axes):
            if t0 <= at_s < t1 and t1 - t0 <= _MOST_APART_S:
                axis = before + (at_s - t0) / (t1 - t0) * (after - before)
                return np.asarray(axis / np.linalg.norm(axis))
        return None


class MotionSampler:
    """Makes a `MotionSample` of each local position, when the next one comes in.

    A position about which no attitude was heard is passed over, and so is one that is no later than the last. Every
    number is untrusted.
    """

    def __init__(self) -> None:
        self._flown, self._asked = _AxisTrack(), _AxisTrack()
        self._waiting: tuple[float, NDArray[np.float64], NDArray[np.float64]] | None = None

    def take(self, message: Message) -> MotionSample | None:
        """A message of the vehicle's autopilot; the sample that it completes, if any."""
        kind = message.get_type()
        if kind == "ATTITUDE":
            if all(math.isfinite(angle) for angle in (message.roll, message.pitch, message.yaw)):
                axis = thrust_axis(message.roll, message.pitch, yaw_from_heading(message.yaw))
                self._flown.add(message.time_boot_ms * 1e-3, axis)
        elif kind == "ATTITUDE_TARGET":
            axis_asked = _axis_of_quaternion(message.q)
            if axis_asked is not None:
                self._asked.add(message.time_boot_ms * 1e-3, axis_asked)
        elif kind == "LOCAL_POSITION_NED":
            return self._take_place(message)
        return None

    def _take_place(self, m: Message) -> MotionSample | None:
        at_s, last = m.time_boot_ms * 1e-3, self._waiting
        numbers = np.array([m.x, m.y, m.z, m.vx, m.vy, m.vz], dtype=np.float64)
        if not np.all(np.isfinite(numbers)) or (last is not None and last[0] - _REBOOT_S < at_s <= last[0]):
            return None
        self._waiting = (at_s, enu_from_ned(numbers[:3]), enu_from_ned(numbers[3:]))
        axis = None if last is None else self._flown.at(last[0])
        if last is None or axis is None:
            return None
        return MotionSample(*last, axis, self._asked.at(last[0]))


def _axis_of_quaternion(q: list[float]) -> NDArray[np.float64] | None:
    """Thrust axis (ENU) of an attitude as MAVLink sends it, from north, east, down to the body; None if it is none."""
    w, x, y, z = (float(part) for part in q)
    size = w * w + x * x + y * y + z * z
    if not math.isfinite(size) or size < 0.25:
        return None
    body_down = np.array([2 * (x * z + w * y), 2 * (y * z - w * x), w * w - x * x - y * y + z * z]) / size
    return -enu_from_ned(body_down)
