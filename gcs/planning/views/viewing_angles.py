"""Where the vehicle and its camera look over time, and how long the vehicle dwells at each viewpoint.

The vehicle's yaw and the gimbal's pitch turn while a leg is flown and are at rest for a while before each exposure,
and so is the vehicle where it stops. A leg that is too short to turn in lengthens the dwell at its end; a leg to a
viewpoint that is flown through has to last long enough.
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
"""Rest after an exposure, for a trigger that comes late; of yaw and gimbal alone where the vehicle flies on."""

STEADY_S = 0.5
"""Rest of yaw and gimbal before an exposure in flight."""

_BRIEF_S = 1e-3
"""Knots are at least this far apart, also between two viewpoints at one place."""

_STEP_PEAK = 1.5
"""A smooth step's largest rate over its mean rate."""

_NO_TURN_S = 1e-9


@dataclass(frozen=True, eq=False)
class ViewingSchedule:
    """Dwells, exposures and angles on the trajectory's time.

    Attributes:
        dwells_s: how long the vehicle rests at each viewpoint, 0 where it flies through, shape (V,).
        exposures_s: when each picture is taken, shape (V,).
        yaw: vehicle yaw from east, counter-clockwise.
        gimbal_pitch: camera pitch, 0 level, negative down.
    """

    dwells_s: NDArray[np.float64]
    exposures_s: NDArray[np.float64]
    yaw: AngleProfile
    gimbal_pitch: AngleProfile


@dataclass(frozen=True)
class ViewingRates:
    """How fast views may follow each other.

    Attributes:
        gimbal_rad_s: largest pitch rate.
        yaw_rad_s: largest yaw rate.
        min_interval_s: least time between two exposures.
    """

    gimbal_rad_s: float
    yaw_rad_s: float = YAW_RATE_RAD_S
    min_interval_s: float = 0.0

    def turns_s(self, yaw_rad: NDArray[np.float64], gimbal_pitch_rad: NDArray[np.float64]) -> NDArray[np.float64]:
        """How long the turn from each viewpoint to the next takes, shape (V - 1,)."""
        yaw, pitch = np.abs(np.diff(np.unwrap(yaw_rad))), np.abs(np.diff(gimbal_pitch_rad))
        return np.asarray(_STEP_PEAK * np.maximum(yaw / self.yaw_rad_s, pitch / self.gimbal_rad_s))


def least_leg_times_s(
    yaw_rad: NDArray[np.float64],
    gimbal_pitch_rad: NDArray[np.float64],
    stops: NDArray[np.bool_],
    rates: ViewingRates,
) -> NDArray[np.float64]:
    """How long legs last at least, so that what is flown through can be looked at; shape (V + 1,).

    Args:
        yaw_rad: as of `schedule_views`.
        gimbal_pitch_rad: as of `schedule_views`.
        stops: where the vehicle rests, shape (V,).
        rates: how fast views may follow each other.
    """
    turns = rates.turns_s(yaw_rad, gimbal_pitch_rad)
    after = np.where(stops, 0.0, HOLD_S)
    turning = np.where(turns > _NO_TURN_S, after[:-1] + turns + STEADY_S, 0.0)
    between = np.maximum(turning, rates.min_interval_s - np.where(stops[:-1], HOLD_S, 0.0))
    last = 0.0 if stops[-1] else HOLD_S + _BRIEF_S
    return np.concatenate([[0.0], np.where(stops[1:], 0.0, between), [last]])


def schedule_views(
    leg_durations_s: NDArray[np.float64],
    yaw_rad: NDArray[np.float64],
    gimbal_pitch_rad: NDArray[np.float64],
    rates: ViewingRates,
    *,
    stops: NDArray[np.bool_] | None = None,
    holds_s: NDArray[np.float64] | None = None,
) -> ViewingSchedule:
    """Turn on the legs, settle, expose.

    Args:
        leg_durations_s: flight times of the legs: home to the first viewpoint, ..., the last viewpoint to home,
            shape (V + 1,), V >= 1; 0 between two viewpoints at one place, at least `least_leg_times_s`.
        yaw_rad: vehicle yaw at each viewpoint, any multiple of a turn off, shape (V,).
        gimbal_pitch_rad: camera pitch at each viewpoint, shape (V,).
        rates: how fast views may follow each other.
        stops: where the vehicle rests, shape (V,); everywhere when not given.
        holds_s: how long it rests and looks where it stops at least, shape (V,).

    Returns:
        The schedule. The first viewpoint's angles are taken on the ground, the last one's are kept to the end.
    """
    yaw = np.unwrap(np.asarray(yaw_rad, dtype=np.float64))
    pitch = np.asarray(gimbal_pitch_rad, dtype=np.float64)
    turns = rates.turns_s(yaw, pitch)
    rests = np.ones(len(yaw), dtype=np.bool_) if stops is None else stops
    holds = np.zeros(len(yaw)) if holds_s is None else holds_s
    knots = [0.0]
    dwells: list[float] = []
    exposures: list[float] = []
    arrival = float(leg_durations_s[0])
    turned = arrival
    for index in range(len(yaw)):
        if rests[index]:
            exposure = max(arrival, turned) + SETTLE_S
            if exposures:
                exposure = max(exposure, exposures[-1] + rates.min_interval_s)
            leave = steady_until = exposure + max(HOLD_S, float(holds[index]) - SETTLE_S)
        else:
            exposure = leave = arrival
            steady_until = exposure + HOLD_S
        exposures.append(exposure)
        dwells.append(leave - arrival)
        knots.append(steady_until)
        arrival = leave + float(leg_durations_s[index + 1])
        if index + 1 < len(yaw):
            steady_from = arrival - (0.0 if rests[index + 1] else STEADY_S)
            turned = max(steady_until + max(float(turns[index]), _BRIEF_S), steady_from)
            knots.append(turned)
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
