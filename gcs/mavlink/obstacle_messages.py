"""OBSTACLE_DISTANCE and OBSTACLE_DISTANCE_3D in metres and radians; every field is untrusted."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs.core.errors import InputError
from gcs.mavlink.dialect import Message, mavlink

UNKNOWN_CM = 65535
CENTIMETRES = 0.01
SECTORS_FRAMES = frozenset({mavlink.MAV_FRAME_BODY_FRD, mavlink.MAV_FRAME_GLOBAL, mavlink.MAV_FRAME_LOCAL_NED})


@dataclass(frozen=True, eq=False)
class ObstacleSectors:
    """The least range in each of evenly spaced sectors round the vehicle.

    Attributes:
        ranges_m: shape (N,); infinity where nothing is within reach.
        known: which sectors were measured, shape (N,).
        first_rad: middle of sector 0, counter-clockwise from the vehicle's nose, or from east for `northward`.
        step_rad: from each sector to the next, counter-clockwise.
        least_m: what is nearer cannot be measured.
        most_m: reach of the sensor.
        northward: whether angles are about the scene's axes, and not about the vehicle's nose.
        at_us: the sender's time stamp (since its boot, or since 1970).
    """

    ranges_m: NDArray[np.float64]
    known: NDArray[np.bool_]
    first_rad: float
    step_rad: float
    least_m: float
    most_m: float
    northward: bool
    at_us: int


def obstacle_sectors(message: Message) -> ObstacleSectors:
    """Read an OBSTACLE_DISTANCE.

    Raises:
        InputError: it cannot be one; it names the field.
    """
    if message.frame not in SECTORS_FRAMES:
        raise InputError(f"frame {message.frame} is not one that sectors lie in", field="frame")
    step_deg = message.increment_f if message.increment_f != 0 else float(message.increment)
    if not (math.isfinite(step_deg) and math.isfinite(message.angle_offset)) or step_deg == 0:
        raise InputError(
            f"sectors of {step_deg:g} degrees from {message.angle_offset:g} are impossible", field="increment"
        )
    if not 0 <= message.min_distance < message.max_distance:
        span = f"{message.min_distance} to {message.max_distance} cm"
        raise InputError(f"a reach of {span} is impossible", field="max_distance")
    distances = np.array(message.distances, dtype=np.float64)
    sectors = min(len(distances), math.floor(360.0 / abs(step_deg) + 1e-6))
    if (distances[sectors:] != UNKNOWN_CM).any():
        raise InputError(f"{len(distances)} sectors of {step_deg:g} degrees are more than a circle", field="increment")
    distances = distances[:sectors]
    northward = message.frame != mavlink.MAV_FRAME_BODY_FRD
    offset = -math.radians(message.angle_offset)
    return ObstacleSectors(
        ranges_m=np.where(distances > message.max_distance, np.inf, distances * CENTIMETRES),
        known=distances != UNKNOWN_CM,
        first_rad=offset + (math.pi / 2 if northward else 0.0),
        step_rad=-math.radians(step_deg),
        least_m=message.min_distance * CENTIMETRES,
        most_m=message.max_distance * CENTIMETRES,
        northward=northward,
        at_us=int(message.time_usec),
    )


@dataclass(frozen=True, eq=False)
class ObstaclePoint:
    """One obstacle of an OBSTACLE_DISTANCE_3D.

    Attributes:
        offset_m: forward, left and up of the vehicle's body (its attitude not taken out), shape (3,).
        least_m: what is nearer cannot be measured.
        most_m: reach of the sensor.
        time_boot_s: the sender's clock; all of one scan carry the same.
    """

    offset_m: NDArray[np.float64]
    least_m: float
    most_m: float
    time_boot_s: float


def obstacle_point(message: Message) -> ObstaclePoint:
    """Read an OBSTACLE_DISTANCE_3D.

    Raises:
        InputError: it cannot be one; it names the field.
    """
    offset = np.array([message.x, -message.y, -message.z], dtype=np.float64)
    if message.frame != mavlink.MAV_FRAME_BODY_FRD:
        raise InputError(f"frame {message.frame} is not about the vehicle's body", field="frame")
    if not np.isfinite(offset).all() or not offset.any():
        raise InputError("an obstacle on the vehicle itself, or nowhere, is not used", field="x")
    if not 0 <= message.min_distance < message.max_distance < math.inf:
        span = f"{message.min_distance:g} to {message.max_distance:g} m"
        raise InputError(f"a reach of {span} is impossible", field="max_distance")
    return ObstaclePoint(offset, float(message.min_distance), float(message.max_distance), message.time_boot_ms * 1e-3)
