"""Setpoints as they arrive in SET_POSITION_TARGET_LOCAL_NED and SET_POSITION_TARGET_GLOBAL_INT."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from gcs.core.frames import GeoPoint, yaw_from_heading
from sitl_mocks.airframe import Airframe, FlightSetpoint
from sitl_mocks.dialect import Message, mavlink
from sitl_mocks.scene_frame import Array, SceneFrame

NO_POSITION, NO_VELOCITY, NO_ACCELERATION = 0x007, 0x038, 0x1C0
FORCE_FLAG, NO_YAW, NO_YAW_RATE = 0x200, 0x400, 0x800


@dataclass(frozen=True)
class Setpoint:
    """What was asked for, in scene ENU; None for what the mask leaves out.

    Attributes:
        yaw_rad: NaN when left out.
        yaw_rate_rad_s: NaN when left out.
    """

    position_m: Array | None
    velocity_m_s: Array | None
    acceleration_m_s2: Array | None
    yaw_rad: float
    yaw_rate_rad_s: float


def setpoint_of_message(message: Message, frame: SceneFrame, home: GeoPoint) -> Setpoint | None:
    """The setpoint in a message; None when its frame or mask is not supported.

    Supported are LOCAL_NED, and the global frames above mean sea level and above home.
    """
    mask = message.type_mask
    if mask & FORCE_FLAG:
        return None
    position = velocity = acceleration = None
    if mask & NO_POSITION != NO_POSITION:
        position = _position(message, frame, home)
        if position is None:
            return None
    elif message.get_type() == "SET_POSITION_TARGET_LOCAL_NED" and message.coordinate_frame != 1:
        return None
    if mask & NO_VELOCITY != NO_VELOCITY:
        velocity = _enu(message.vx, message.vy, message.vz)
    if mask & NO_ACCELERATION != NO_ACCELERATION:
        acceleration = _enu(message.afx, message.afy, message.afz)
    if position is None and velocity is None and acceleration is None:
        return None
    numbers = [part for part in (position, velocity, acceleration) if part is not None]
    if not all(np.all(np.isfinite(part)) for part in numbers):
        return None
    yaw = math.nan if mask & NO_YAW or not math.isfinite(message.yaw) else yaw_from_heading(message.yaw)
    yaw_rate = math.nan if mask & NO_YAW_RATE or not math.isfinite(message.yaw_rate) else -message.yaw_rate
    return Setpoint(position, velocity, acceleration, yaw, yaw_rate)


def _enu(north: float, east: float, down: float) -> Array:
    return np.array([east, north, -down], dtype=np.float64)


def _position(message: Message, frame: SceneFrame, home: GeoPoint) -> Array | None:
    if message.get_type() == "SET_POSITION_TARGET_LOCAL_NED":
        if message.coordinate_frame != mavlink.MAV_FRAME_LOCAL_NED:
            return None
        return frame.scene_from_local_ned(message.x, message.y, message.z)
    altitude = message.alt
    if message.coordinate_frame in {mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT, mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT}:
        altitude += home.altitude_m
    elif message.coordinate_frame not in {mavlink.MAV_FRAME_GLOBAL, mavlink.MAV_FRAME_GLOBAL_INT}:
        return None
    return frame.scene_e7(message.lat_int, message.lon_int, altitude)


def lead_by_setpoint(airframe: Airframe, setpoint: Setpoint) -> None:
    """Have an airframe fly what a setpoint says: to a bare position as to a waypoint, anything else as it comes."""
    if setpoint.velocity_m_s is None and setpoint.acceleration_m_s2 is None and setpoint.position_m is not None:
        airframe.go_to(setpoint.position_m, setpoint.yaw_rad if math.isfinite(setpoint.yaw_rad) else None)
        return
    zero = np.zeros(3)
    airframe.follow(
        FlightSetpoint(
            airframe.position_m if setpoint.position_m is None else setpoint.position_m,
            zero if setpoint.velocity_m_s is None else setpoint.velocity_m_s,
            zero if setpoint.acceleration_m_s2 is None else setpoint.acceleration_m_s2,
            setpoint.yaw_rad,
            setpoint.yaw_rate_rad_s,
        )
    )
