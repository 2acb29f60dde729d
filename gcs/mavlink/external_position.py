"""A position that the station knows better than the vehicle, told to it, and the parameters with which it uses one.

ArduPilot takes GPS_INPUT, PX4 VISION_POSITION_ESTIMATE.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.errors import RefusedError
from gcs.core.frames import GeoPoint, geodetic_from_enu, ned_from_enu
from gcs.core.vehicle import Autopilot
from gcs.mavlink.dialect import Message, mavlink

if TYPE_CHECKING:
    from numpy.typing import NDArray

RECEIVER = 1
"""gps_id of ArduPilot's second receiver: its own one stays the first, and tells whether it has a fix."""

_MAVLINK_RECEIVER = 14
_SWITCHES_TO_BEST = (1, 4)
_USUAL_LAG_MS = 200.0
"""For so late ArduPilot takes a fix of such a receiver when GPS2_DELAY_MS is 0."""

_SATELLITES = 10
"""ArduPilot's estimator does not begin with fewer than 6."""

_SETTINGS = {
    Autopilot.ARDUPILOT: ("GPS2_TYPE", "GPS_AUTO_SWITCH", "GPS2_DELAY_MS"),
    Autopilot.PX4: ("EKF2_EV_CTRL", "EKF2_EV_DELAY"),
}
_UNIX_OF_GPS_S = 315_964_800
_LEAP_S = 18
_WEEK_S = 604_800


@dataclass(frozen=True, eq=False)
class ExternalPosition:
    """Where a vehicle is, as somebody else knows.

    Attributes:
        position_m: ENU about the vehicle's origin, shape (3,).
        velocity_m_s: ENU, shape (3,).
        position_covariance_m2: shape (3, 3).
        velocity_covariance_m2_s2: shape (3, 3).
        origin: the vehicle's origin (GPS_GLOBAL_ORIGIN).
        at_vehicle_s: when it was there, by the vehicle's clock (s since boot).
        unix_s: when it is told, UTC; with it ArduPilot takes out the jitter of the link.
        resets: how often the positions began anew, which may come with a jump.
    """

    position_m: NDArray[np.float64]
    velocity_m_s: NDArray[np.float64]
    position_covariance_m2: NDArray[np.float64]
    velocity_covariance_m2_s2: NDArray[np.float64]
    origin: GeoPoint
    at_vehicle_s: float
    unix_s: float
    resets: int


def external_position_parameters(autopilot: Autopilot) -> tuple[str, ...]:
    """Names of the parameters that decide whether and how such positions are used.

    Raises:
        RefusedError: this flight stack is told no positions.
    """
    if autopilot not in _SETTINGS:
        raise RefusedError("positions from outside are told to PX4 and ArduPilot only")
    return _SETTINGS[autopilot]


def external_position_lag(autopilot: Autopilot, values: Mapping[str, float | None]) -> float:
    """How old the vehicle takes such a position to be when it comes (s).

    Args:
        autopilot: its flight stack.
        values: its parameters by name; None for those it did not tell.

    Raises:
        RefusedError: its parameters do not let it use one; says what to set.
    """
    if autopilot is Autopilot.PX4:
        if not int(values["EKF2_EV_CTRL"] or 0) & 1:
            raise RefusedError(
                f"it would not use positions from outside (EKF2_EV_CTRL is {_told(values['EKF2_EV_CTRL'])}): set "
                "EKF2_EV_CTRL 3, for place and height"
            )
        return (values["EKF2_EV_DELAY"] or 0.0) * 1e-3
    if values["GPS2_TYPE"] != _MAVLINK_RECEIVER or values["GPS_AUTO_SWITCH"] not in _SWITCHES_TO_BEST:
        raise RefusedError(
            f"it would not use positions from outside (GPS2_TYPE is {_told(values['GPS2_TYPE'])}, GPS_AUTO_SWITCH "
            f"{_told(values['GPS_AUTO_SWITCH'])}): set GPS2_TYPE 14 and GPS_AUTO_SWITCH 1, and start it again"
        )
    return (values["GPS2_DELAY_MS"] or _USUAL_LAG_MS) * 1e-3


def external_position_message(autopilot: Autopilot, fix: ExternalPosition) -> Message:
    """The message that tells a vehicle where it is."""
    return vision_position(fix) if autopilot is Autopilot.PX4 else gps_input(fix)


def gps_input(fix: ExternalPosition) -> Message:
    """GPS_INPUT for ArduPilot's second receiver; accuracies are those of the worst horizontal direction."""
    latitude, longitude, altitude = geodetic_from_enu(fix.position_m, fix.origin)
    north, east, down = (float(v) for v in ned_from_enu(fix.velocity_m_s))
    week, in_week_s = divmod(fix.unix_s - _UNIX_OF_GPS_S + _LEAP_S, _WEEK_S)
    return mavlink.MAVLink_gps_input_message(
        round(fix.at_vehicle_s * 1e6),
        RECEIVER,
        0,
        int(in_week_s * 1e3),
        int(week),
        mavlink.GPS_FIX_TYPE_3D_FIX,
        round(float(latitude) * 1e7),
        round(float(longitude) * 1e7),
        float(altitude),
        1.0,
        1.0,
        north,
        east,
        down,
        _widest(fix.velocity_covariance_m2_s2),
        _widest(fix.position_covariance_m2[:2, :2]),
        math.sqrt(fix.position_covariance_m2[2, 2]),
        _SATELLITES,
    )


def vision_position(fix: ExternalPosition) -> Message:
    """VISION_POSITION_ESTIMATE in the vehicle's local frame, without an attitude."""
    north, east, down = (float(v) for v in ned_from_enu(fix.position_m))
    swap = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    pose = np.full((6, 6), math.nan)
    pose[:3, :3] = swap @ fix.position_covariance_m2 @ swap.T
    return mavlink.MAVLink_vision_position_estimate_message(
        round(fix.at_vehicle_s * 1e6),
        north,
        east,
        down,
        math.nan,
        math.nan,
        math.nan,
        [float(value) for value in pose[np.triu_indices(6)]],
        fix.resets % 256,
    )


def _widest(covariance: NDArray[np.float64]) -> float:
    """Standard deviation along the axis on which it is largest."""
    return math.sqrt(float(np.linalg.eigvalsh(covariance)[-1]))


def _told(value: float | None) -> str:
    return "not told" if value is None else f"{value:g}"
