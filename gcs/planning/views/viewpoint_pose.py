"""A place to photograph from: position, view direction and the angles that give it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

STRAIGHT = 1e-9
"""A direction with less than this of a level part is straight up or down; its azimuth means nothing."""


@dataclass(frozen=True, eq=False)
class ViewpointPose:
    """Where the vehicle stands and where the camera looks; not yet a place in a tour.

    Attributes:
        name: the named point's name, or `S0001`, ... for surface viewpoints.
        position_m: vehicle centre, scene ENU, shape (3,).
        direction: unit view direction, shape (3,).
        up: unit upward direction of the image, square to `direction`, in the vertical plane, shape (3,).
        gsd_m: ground sampling distance (m a pixel) at the target, along the axis.
        yaw_rad: azimuth of the direction from east, counter-clockwise.
        gimbal_pitch_rad: elevation of the direction.
        hold_s: how long the vehicle is asked to stand there at least.
    """

    name: str
    position_m: NDArray[np.float64]
    direction: NDArray[np.float64]
    up: NDArray[np.float64]
    gsd_m: float
    yaw_rad: float
    gimbal_pitch_rad: float
    hold_s: float = 0.0


def camera_axes(yaw_rad: ArrayLike, pitch_rad: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """View and image-up directions of a camera that does not roll.

    Args:
        yaw_rad: azimuth from east, counter-clockwise, shape (...).
        pitch_rad: elevation, shape (...).

    Returns:
        Unit vectors, each of shape (..., 3). Straight down the image's upward direction is the yaw's.
    """
    yaw, pitch = np.broadcast_arrays(np.asarray(yaw_rad, dtype=np.float64), np.asarray(pitch_rad, dtype=np.float64))
    level = np.stack([np.cos(yaw), np.sin(yaw), np.zeros(yaw.shape)], axis=-1)
    direction = np.cos(pitch)[..., None] * level
    direction[..., 2] = np.sin(pitch)
    up = -np.sin(pitch)[..., None] * level
    up[..., 2] = np.cos(pitch)
    return direction, up


def camera_angles(direction: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Yaw and pitch (rad) of view directions, shape (..., 3), not zero; straight up or down has yaw 0."""
    d = np.asarray(direction, dtype=np.float64)
    level = np.hypot(d[..., 0], d[..., 1])
    yaw = np.where(level > STRAIGHT, np.arctan2(d[..., 1], d[..., 0]), 0.0)
    return yaw, np.arctan2(d[..., 2], level)


def pose_towards(name: str, position_m: ArrayLike, direction: ArrayLike, gsd_m: float) -> ViewpointPose:
    """The pose at a position (3,) that looks along a direction (3,)."""
    yaw, pitch = camera_angles(direction)
    view, up = camera_axes(yaw, pitch)
    position = np.array(position_m, dtype=np.float64)
    return ViewpointPose(name, position, view, up, float(gsd_m), float(yaw), float(pitch))


def gimbal_pitch_range_rad(pitch_min_deg: float, pitch_max_deg: float) -> tuple[float, float]:
    """Limits of the camera's pitch (rad), wide enough for rounding."""
    return math.radians(pitch_min_deg) - 1e-9, math.radians(pitch_max_deg) + 1e-9
