"""Where the vehicle and its camera look over time, and how long the vehicle dwells at each viewpoint.

The vehicle's yaw and the gimbal's pitch turn while a leg is flown and are at rest, with the vehicle at rest too, for a
settling time before each exposure. A leg that is too short to turn in lengthens the dwell at its end.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.trajectory import AngleProfile

if TYPE_CHECKING:
    from numpy.typing import NDArray

YAW_RATE_RAD_S = math.radians(45.0)
"""Largest planned yaw rate: what both autopilots follow with their default gains while they fly a path."""

SETTLE_S = 1.0
"""Rest of vehicle, yaw and gimbal before an exposure."""

HOLD_S = 0.2
"""Rest after an exposure, for a trigger that comes late."""

_BRIEF_S = 1e-3
"""Knots are at least this far apart, also between two viewpoints at one place."""

_STEP_PEAK = 1.5
"""A smooth step's largest rate over its mean rate."""


@dataclass(frozen=True, eq=False)
class ViewingSchedule:
    """Dwells, exposures and angles on the trajectory's time.

    Attributes:
        dwells_s: how long the vehicle rests at each viewpoint, shape (V,).
        exposures_s: when each picture is taken, shape (V,).
        yaw: vehicle yaw from east, counter-clockwise.
        gimbal_pitch: camera pitch, 0 level, negative down.
    """

    dwells_s: NDArray[np.float64]
    exposures_s: NDArray[np.float64]
    yaw: AngleProfile
    gimbal_pitch: AngleProfile


def schedule_views(
    leg_durations_s: NDArray[np.float64],
    yaw_rad: NDArray[np.float64],
    gimbal_pitch_rad: NDArray[np.float64],
    *,
    gimbal_rate_rad_s: float,
    yaw_rate_rad_s: float = YAW_RATE_RAD_S,
    min_interval_s: float = 0.0,
) -> ViewingSchedule:
    """Turn on the legs, settle, expose.

    Args:
        leg_durations_s: flight times of the legs: home to the first viewpoint, ..., the last viewpoint to home,
            shape (V + 1,), V >= 1; 0 between two viewpoints at one place.
        yaw_rad: vehicle yaw at each viewpoint, any multiple of a turn off, shape (V,).
        gimbal_pitch_rad: camera pitch at each viewpoint, shape (V,).
        gimbal_rate_rad_s: largest pitch rate.
        yaw_rate_rad_s: largest yaw rate.
        min_interval_s: least time between two exposures.

    Returns:
        The schedule. The first viewpoint's angles are taken on the ground, the last one's are kept to the end.
    """
    yaw = np.unwrap(np.asarray(yaw_rad, dtype=np.float64))
    pitch = np.asarray(gimbal_pitch_rad, dtype=np.float64)
    turns = _STEP_PEAK * np.maximum(np.abs(np.diff(yaw)) / yaw_rate_rad_s, np.abs(np.diff(pitch)) / gimbal_rate_rad_s)
    knots = [0.0]
    dwells: list[float] = []
    exposures: list[float] = []
    arrival = float(leg_durations_s[0])
    turned = arrival
    for index in range(len(yaw)):
        exposure = max(arrival, turned) + SETTLE_S
        if exposures:
            exposure = max(exposure, exposures[-1] + min_interval_s)
        leave = exposure + HOLD_S
        exposures.append(exposure)
        dwells.append(leave - arrival)
        knots.append(leave)
        flight = float(leg_durations_s[index + 1])
        if index + 1 < len(yaw):
            turned = leave + max(float(turns[index]), flight, _BRIEF_S)
            knots.append(turned)
        arrival = leave + flight
    times = np.array([*knots, arrival])
    return ViewingSchedule(
        dwells_s=np.array(dwells),
        exposures_s=np.array(exposures),
        yaw=AngleProfile(times, _at_knots(yaw)),
        gimbal_pitch=AngleProfile(times, _at_knots(pitch)),
    )


def _at_knots(angles: NDArray[np.float64]) -> NDArray[np.float64]:
    """Start, then each angle when it is left and the next when it is reached, then the end."""
    return np.concatenate([np.repeat(angles, 2), angles[-1:]])
