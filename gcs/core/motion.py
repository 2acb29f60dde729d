"""How a vehicle moves, as it tells: place, velocity and attitude of one moment of its own clock."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class MotionSample:
    """One moment of a flight.

    Attributes:
        vehicle_s: the vehicle's clock, s since boot.
        position_m: local ENU about the estimator's origin, shape (3,).
        velocity_m_s: ENU, shape (3,).
        thrust_axis: unit vector of the rotors' axis, upward in the body, ENU, shape (3,).
        asked_axis: where its position controller wants that axis to be; None when it does not tell.
    """

    vehicle_s: float
    position_m: NDArray[np.float64]
    velocity_m_s: NDArray[np.float64]
    thrust_axis: NDArray[np.float64]
    asked_axis: NDArray[np.float64] | None = None


def thrust_axis(roll_rad: float, pitch_rad: float, yaw_rad: float) -> NDArray[np.float64]:
    """The rotors' axis of a multirotor in ENU, shape (3,).

    Args:
        roll_rad: right side down is positive.
        pitch_rad: nose up is positive.
        yaw_rad: from east, counter-clockwise.
    """
    # Nose down leans the axis forward, right side down leans it to the right.
    forward = -math.cos(roll_rad) * math.sin(pitch_rad)
    right = math.sin(roll_rad)
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    return np.array([forward * c + right * s, forward * s - right * c, math.cos(roll_rad) * math.cos(pitch_rad)])
