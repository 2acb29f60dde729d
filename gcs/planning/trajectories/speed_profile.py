"""First segment times: a profile of speed along a leg that keeps the acceleration limit and slows for its corners.

It also slows for the places that are to be passed slowly, and takes its time from one of them to the next.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from gcs.planning.numerics.compiled import compiled

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from gcs.planning.trajectories.flight_limits import FlightLimits
    from gcs.planning.trajectories.safe_corridor import LegCorridor

Floats = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

_PROFILE_SAMPLES = 400

_SHORTEST_SHARE = 0.03
"""Segments get at least this share of the leg's mean segment time."""


def initial_times(leg: LegCorridor, limits: FlightLimits, window_s: float) -> NDArray[np.float64]:
    """Segment times (s, shape (n,)) from a profile of speed along the leg.

    Args:
        leg: the corridor.
        limits: kept by the profile on straights.
        window_s: the profile is averaged four times over a quarter of this.
    """
    top_speeds = np.full(len(leg.joints_m), limits.speed_m_s)
    if leg.passing is not None:
        top_speeds[leg.passing.joints] = np.minimum(leg.passing.speeds_m_s, limits.speed_m_s)
    times = _times(leg.joints_m, leg.joint_room_m, top_speeds, limits.acceleration_m_s2, window_s)
    return times if leg.passing is None else leg.passing.lengthened(times)


@compiled
def _times(joints: Floats, rooms: Floats, top_speeds: Floats, acceleration: float, window: float) -> Floats:
    """See `initial_times`; the top speeds are those at the joints, the first's that of the whole leg."""
    count = len(joints) - 1
    lengths = np.empty(count)
    for k in range(count):
        lengths[k] = math.sqrt(((joints[k + 1] - joints[k]) ** 2).sum())
    speeds = _joint_speeds(joints, rooms, lengths, top_speeds, acceleration)
    at = np.zeros(count + 1)
    at[1:] = np.cumsum(lengths)
    way, speed, times = np.empty(_PROFILE_SAMPLES), np.empty(_PROFILE_SAMPLES), np.zeros(_PROFILE_SAMPLES)
    segment, gain = 0, 2 * acceleration
    for i in range(_PROFILE_SAMPLES):
        way[i] = (1 - math.cos(math.pi * i / (_PROFILE_SAMPLES - 1))) / 2 * at[count]
        while segment < count - 1 and at[segment + 1] <= way[i]:
            segment += 1
        after = speeds[segment] ** 2 + gain * max(way[i] - at[segment], 0.0)
        before = speeds[segment + 1] ** 2 + gain * max(at[segment + 1] - way[i], 0.0)
        speed[i] = min(math.sqrt(min(after, before)), top_speeds[0])
        if i > 0:
            times[i] = times[i - 1] + 2 * (way[i] - way[i - 1]) / max(speed[i] + speed[i - 1], 1e-9)
    end = times[-1] + window
    grid = np.linspace(0.0, end, _PROFILE_SAMPLES)
    averaged = np.interp(grid, times, speed)
    averaged[grid > times[-1]] = 0.0
    width = max(1, round(window / 4 / grid[1]))
    total = np.zeros(_PROFILE_SAMPLES + 1)
    for _ in range(4):
        total[1:] = np.cumsum(averaged)
        for i in range(_PROFILE_SAMPLES):
            averaged[i] = (total[i + 1] - total[max(i + 1 - width, 0)]) / width
    flown = np.zeros(_PROFILE_SAMPLES)
    flown[1:] = np.cumsum((averaged[1:] + averaged[:-1]) / 2)
    at_joints = np.interp(at, flown * (at[count] / flown[-1]), grid)
    at_joints[0], at_joints[count] = 0.0, end
    shortest = _SHORTEST_SHARE * end / count
    result = np.empty(count)
    for k in range(count):
        result[k] = max(at_joints[k + 1] - at_joints[k], shortest)
    return result


@compiled
def _joint_speeds(joints: Floats, rooms: Floats, lengths: Floats, top_speeds: Floats, acceleration: float) -> Floats:
    """Speeds at the joints that corners and the limits allow, shape (n + 1,); at rest at both ends.

    A turn by the angle theta that may leave its corner by m can be flown on a radius `m / (1 / cos(theta / 2) - 1)`; m
    is the joint's room, shape (n - 1,).
    """
    count = len(lengths)
    speeds, gain = np.zeros(count + 1), 2 * acceleration
    for k in range(1, count):
        along = 0.0
        for d in range(3):
            along += (joints[k, d] - joints[k - 1, d]) * (joints[k + 1, d] - joints[k, d])
        half = math.sqrt((1 + min(max(along / (lengths[k - 1] * lengths[k]), -1.0), 1.0)) / 2)
        radius = max(rooms[k - 1], 0.0) * half / max(1 - half, 1e-9)
        speeds[k] = min(
            top_speeds[k], math.sqrt(acceleration * radius), math.sqrt(speeds[k - 1] ** 2 + gain * lengths[k - 1])
        )
    for k in range(count - 1, -1, -1):
        speeds[k] = min(speeds[k], math.sqrt(speeds[k + 1] ** 2 + gain * lengths[k]))
    return speeds
