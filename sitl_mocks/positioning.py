"""The receiver of a vehicle whose satellites may be hidden, and what it flies by meanwhile.

Inside a hidden box the receiver has no fix. The position is then dead reckoning (`position_estimator`), corrected by
what a station sends: GPS_INPUT to ArduPilot, where its second receiver is of that type (GPS2_TYPE 14), and
VISION_POSITION_ESTIMATE to PX4, where EKF2_EV_CTRL has it used. Without either for too long the vehicle gives its
position up.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from sitl_mocks.dialect import Message, mavlink
from sitl_mocks.position_estimator import PositionEstimator

if TYPE_CHECKING:
    from sitl_mocks.vehicle import SimulatedVehicle

Array = NDArray[np.float64]
Box = tuple[tuple[float, float, float], tuple[float, float, float]]
"""Low and high corner, scene ENU."""

OWN_FIX_M, OWN_FIX_M_S = 0.02, 0.03
"""Deviations of the receiver's own fix, with corrections."""
_OWN_FIX_EVERY_S = 0.2
_HIDDEN_SATELLITES = 3
_MAVLINK_RECEIVER = 14
_USUAL_LAG_S = 0.2
"""How late ArduPilot takes a receiver's fix to be, unless it is set."""
_FROM_RECEIVER = 3
_NO_HORIZONTAL_VELOCITY = int(mavlink.GPS_INPUT_IGNORE_FLAG_VEL_HORIZ)
_HORIZONTAL, _VERTICAL = 1, 2
"""Bits of EKF2_EV_CTRL."""


class Positioning:
    """What a vehicle knows of its place.

    Args:
        vehicle: it.
        hidden: boxes in which no satellites are received.
        seed: of the errors.
    """

    def __init__(self, vehicle: SimulatedVehicle, hidden: Sequence[Box], seed: int) -> None:
        self._vehicle = vehicle
        self._hidden = tuple((np.array(low), np.array(high)) for low, high in hidden)
        self._estimator = PositionEstimator(seed)
        self._own_fix_s = -math.inf
        self._aided_s = 0.0
        self.blocked = False
        self.positions_taken = 0
        """Positions from outside that were used."""

    @property
    def satellites(self) -> int:
        """How many are received."""
        return _HIDDEN_SATELLITES if self.blocked else 14

    @property
    def unaided_s(self) -> float:
        """Time since the position was last corrected."""
        return self._vehicle.time_s - self._aided_s

    def tick(self, dt_s: float) -> None:
        """Let time pass."""
        vehicle, estimator = self._vehicle, self._estimator
        true_m = vehicle.airframe.true_position_m
        estimator.advance(dt_s, true_m, vehicle.airframe.true_velocity_m_s)
        blocked = any(bool(np.all((low <= true_m) & (true_m <= high))) for low, high in self._hidden)
        if blocked != self.blocked:
            self.blocked = blocked
            lost, back = vehicle.fix_texts
            vehicle.say(mavlink.MAV_SEVERITY_WARNING, lost if blocked else back)
        if not blocked and vehicle.time_s - self._own_fix_s >= _OWN_FIX_EVERY_S:
            self._own_fix_s = self._aided_s = vehicle.time_s
            estimator.take_own_fix(OWN_FIX_M, OWN_FIX_M_S)
        vehicle.airframe.believe(estimator.error_m, estimator.error_m_s)

    def handle(self, message: Message) -> bool:
        """Take a position from outside; False for other messages."""
        kind, name = message.get_type(), self._vehicle.kind
        if kind not in {"GPS_INPUT", "VISION_POSITION_ESTIMATE"}:
            return False
        if self.blocked and (kind == "GPS_INPUT") == (name == "ardupilot"):
            (self._take_receiver if kind == "GPS_INPUT" else self._take_vision)(message)
        return True

    def _take_receiver(self, message: Message) -> None:
        p = self._vehicle.parameters
        if p["GPS2_TYPE"] != _MAVLINK_RECEIVER or message.gps_id != 1 or message.fix_type < mavlink.GPS_FIX_TYPE_3D_FIX:
            return
        lag_s = p["GPS2_DELAY_MS"] * 1e-3 or _USUAL_LAG_S
        place = self._vehicle.frame.scene_e7(message.lat, message.lon, message.alt)
        self._take(0, place, lag_s, max(message.horiz_accuracy, p["EK3_POSNE_M_NSE"]), (0, 1))
        if p["EK3_SRC1_POSZ"] == _FROM_RECEIVER:
            self._take(0, place, lag_s, message.vert_accuracy, (2,))
        # A velocity that is left out is taken for standing still, as by the real one.
        velocity = np.array([message.ve, message.vn, 0.0])
        if message.ignore_flags & _NO_HORIZONTAL_VELOCITY:
            velocity[:] = 0.0
        if p["EK3_SRC1_VELXY"] == _FROM_RECEIVER:
            self._take(1, velocity, lag_s, max(message.speed_accuracy, p["EK3_VELNE_M_NSE"]), (0, 1))

    def _take_vision(self, message: Message) -> None:
        p = self._vehicle.parameters
        control = int(p["EKF2_EV_CTRL"])
        lag_s = p["EKF2_EV_DELAY"] * 1e-3
        place = self._vehicle.frame.scene_from_local_ned(message.x, message.y, message.z)
        least = p["EKF2_EVP_NOISE"]
        north, east, down = (max(least, math.sqrt(message.covariance[i])) for i in (0, 6, 11))
        if control & _HORIZONTAL:
            self._take(0, place, lag_s, east, (0,))
            self._take(0, place, lag_s, north, (1,))
        if control & _VERTICAL:
            self._take(0, place, lag_s, down, (2,))

    def _take(self, part: int, measured: Array, lag_s: float, deviation: float, axes: tuple[int, ...]) -> None:
        for axis in axes:
            self._estimator.take(axis, part, float(measured[axis]), lag_s, deviation)
        if axes[0] < 2 and part == 0:
            self._aided_s = self._vehicle.time_s
            self.positions_taken += 1
