"""Where the vehicle was, and where it looked, at a moment of its own clock: from the stamped messages about it."""

from __future__ import annotations

import math
from collections import deque
from typing import TYPE_CHECKING, NamedTuple, TypeVar

import numpy as np

from gcs.core.frames import enu_from_ned, wrap_angle, yaw_from_heading

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from gcs.mavlink.dialect import Message

KEPT = 100
CARRIED_ON_S = 1.0
"""A pose is carried on by its velocity and turn for no longer than this."""

POSE_MESSAGES = frozenset({"LOCAL_POSITION_NED", "ATTITUDE"})


class Place(NamedTuple):
    """Position and velocity, local ENU about the estimator's origin, shape (3,) each, at a vehicle time (s)."""

    at_s: float
    position_m: NDArray[np.float64]
    velocity_m_s: NDArray[np.float64]


class Turn(NamedTuple):
    """Roll, pitch (rad) and yaw (rad, from east, counter-clockwise) with the yaw's rate, at a vehicle time (s)."""

    at_s: float
    roll_rad: float
    pitch_rad: float
    yaw_rad: float
    yaw_rate_rad_s: float


Entry = TypeVar("Entry", Place, Turn)


class PoseHistory:
    """The last seconds of LOCAL_POSITION_NED and ATTITUDE."""

    def __init__(self) -> None:
        self._places: deque[Place] = deque(maxlen=KEPT)
        self._turns: deque[Turn] = deque(maxlen=KEPT)

    def take(self, message: Message) -> None:
        """Take one of `POSE_MESSAGES` of the autopilot; what is not finite is left out."""
        at_s = message.time_boot_ms * 1e-3
        if message.get_type() == "LOCAL_POSITION_NED":
            numbers = np.array([message.x, message.y, message.z, message.vx, message.vy, message.vz])
            if np.isfinite(numbers).all():
                _add(self._places, Place(at_s, enu_from_ned(numbers[:3]), enu_from_ned(numbers[3:])))
        elif all(math.isfinite(angle) for angle in (message.roll, message.pitch, message.yaw, message.yawspeed)):
            yaw = yaw_from_heading(message.yaw)
            _add(self._turns, Turn(at_s, message.roll, message.pitch, yaw, -message.yawspeed))

    @property
    def newest(self) -> Place | None:
        """The last place."""
        return self._places[-1] if self._places else None

    def position(self, at_s: float) -> NDArray[np.float64] | None:
        """Place (3,) at a vehicle time; None when nothing was heard near it."""
        place = _nearest(self._places, at_s)
        return None if place is None else place.position_m + (at_s - place.at_s) * place.velocity_m_s

    def attitude(self, at_s: float) -> tuple[float, float, float] | None:
        """Roll, pitch and yaw (rad) at a vehicle time; None when nothing was heard near it."""
        turn = _nearest(self._turns, at_s)
        if turn is None:
            return None
        return turn.roll_rad, turn.pitch_rad, wrap_angle(turn.yaw_rad + (at_s - turn.at_s) * turn.yaw_rate_rad_s)


def _add(history: deque[Entry], entry: Entry) -> None:
    if history and entry.at_s < history[-1].at_s - CARRIED_ON_S:
        history.clear()  # the vehicle's clock began anew
    if not history or entry.at_s > history[-1].at_s:
        history.append(entry)


def _nearest(history: deque[Entry], at_s: float) -> Entry | None:
    if not history:
        return None
    nearest = min(reversed(history), key=lambda entry: abs(entry.at_s - at_s))
    return nearest if abs(nearest.at_s - at_s) <= CARRIED_ON_S else None
