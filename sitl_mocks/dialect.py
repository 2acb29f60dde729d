"""MAVLink as the simulated vehicles use it: the one place here that names the untyped pymavlink module."""

from __future__ import annotations

from typing import Any, TypeAlias

from pymavlink.dialects.v20 import ardupilotmega as mavlink

Message: TypeAlias = Any
"""A decoded or a new `MAVLink_message`."""

AUTOPILOT_COMPONENT = 1
CAMERA_COMPONENT = 100
LIDAR_COMPONENT = int(mavlink.MAV_COMP_ID_OBSTACLE_AVOIDANCE)

__all__ = ["AUTOPILOT_COMPONENT", "CAMERA_COMPONENT", "LIDAR_COMPONENT", "Message", "mavlink"]
