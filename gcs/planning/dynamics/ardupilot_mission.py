"""How ArduCopter flies a mission of straight legs (its AC_WPNav and SCurve, as documented and published).

Every leg is planned from rest to rest (`s_curve`), and neighbours are laid over each other: once a leg brakes and the
rest of its braking fits into the next leg's acceleration, the next one starts at the same time, if at the middle of the
turn the sum of both is within WPNAV_RADIUS of the waypoint, no faster than either leg, and within the corner's
acceleration. The place that is flown to is the sum of both legs' ways. The leg changes when half of the turn is over.
At a hold, and at the last waypoint, the leg ends at rest.

The snap is half of what leaning takes, `S = pi J / (4 max(t_c, 0.1 s))`, t_c being ATC_INPUT_TC. The target's clock
runs slower while the vehicle lags behind it. The position is then followed as `position_control` says. Spline waypoints
are another matter (`ardupilot_spline`).
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from gcs.planning.dynamics.ardupilot_spline import fly_splines, target_pace
from gcs.planning.dynamics.position_control import STATE_SIZE, follow, packed_gains
from gcs.planning.dynamics.predicted_flight import SAMPLE_S, PredictedFlight, require_positive, sample_times
from gcs.planning.dynamics.s_curve import PROFILE_SIZE, leg_profile, leg_state, limit_along
from gcs.planning.numerics.compiled import compiled

if TYPE_CHECKING:
    from gcs.core.flight_law import Airframe, ArduPilotLaw
    from gcs.planning.dynamics.predicted_flight import MissionRoute

Floats = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

_STEP_S = 0.01
_STEPS_A_SAMPLE = round(SAMPLE_S / _STEP_S)
_SETTLE_S = 3.0
_LEAST_LEG_M = 1e-3


def predict_ardupilot_mission(route: MissionRoute, law: ArduPilotLaw, airframe: Airframe) -> PredictedFlight:
    """Predict a mission; see `MissionModel`.

    Args:
        route: the mission; its radii do not count, WPNAV_RADIUS does.
        law: the vehicle's settings.
        airframe: its drag and lag.

    Raises:
        InputError: a limit is not positive.
    """
    speed = law.speed_m_s if route.speed_m_s is None else route.speed_m_s
    climb = law.climb_m_s if route.climb_m_s is None else route.climb_m_s
    descent = law.descent_m_s if route.descent_m_s is None else route.descent_m_s
    level, vertical = law.acceleration_m_s2, law.vertical_acceleration_m_s2
    require_positive(
        {
            "speed_m_s": speed,
            "climb_m_s": climb,
            "descent_m_s": descent,
            "acceleration_m_s2": level,
            "vertical_acceleration_m_s2": vertical,
            "jerk_m_s3": law.jerk_m_s3,
            "radius_m": law.radius_m,
        }
    )
    keep = np.concatenate([[True], np.linalg.norm(np.diff(route.points_m, axis=0), axis=1) > _LEAST_LEG_M])
    points = np.ascontiguousarray(route.points_m[keep])
    if len(points) < 2:
        return PredictedFlight(np.zeros(1), points.copy())
    # A hold at a repeated place belongs to the place.
    holds = np.zeros(len(points))
    np.maximum.at(holds, np.cumsum(keep) - 1, route.hold_s)
    snap = math.pi * law.jerk_m_s3 / (4.0 * max(law.input_time_s, 0.1))
    profiles, directions = np.empty((len(points) - 1, PROFILE_SIZE)), np.empty((len(points) - 1, 3))
    for k, leg in enumerate(np.diff(points, axis=0)):
        x, y, z = leg
        length = float(np.linalg.norm(leg))
        directions[k] = leg / length
        leg_profile(
            length,
            snap,
            law.jerk_m_s3,
            limit_along(x, y, z, level, vertical, vertical),
            limit_along(x, y, z, speed, climb, descent),
            profiles[k],
        )
    gains = ardupilot_gains(law, airframe, speed, climb, descent)
    pacing = np.array([level / law.jerk_m_s3, law.position_gain_s])
    if route.curved:
        samples, finished = fly_splines(points, np.array([speed, climb, descent, level, vertical]), pacing, gains)
        return PredictedFlight(sample_times(len(samples)), samples, finished)
    corner = law.corner_acceleration_m_s2 if law.corner_acceleration_m_s2 > 0 else 2.0 * level
    most = float(profiles[:, 8].sum() * 2.0 + holds.sum() + 60.0)
    samples = np.empty((math.ceil(most / SAMPLE_S) + 2, 3))
    used, finished = _fly(
        points,
        holds,
        profiles,
        directions,
        np.array([law.radius_m, corner, vertical]),
        pacing,
        gains,
        samples,
    )
    return PredictedFlight(sample_times(used), samples[:used].copy(), finished)


def ardupilot_gains(law: ArduPilotLaw, airframe: Airframe, speed: float, climb: float, descent: float) -> Floats:
    """The cascade's numbers; corrections may exceed the speeds of the mission by half."""
    return packed_gains(
        level=(law.position_gain_s, *law.velocity_gains_s),
        vertical=(law.vertical_position_gain_s, law.vertical_velocity_gain_s, 0.0, 0.0),
        derivative_of_error=True,
        max_speed_m_s=1.5 * speed,
        max_climb_m_s=1.5 * climb,
        max_descent_m_s=1.5 * descent,
        max_tilt_rad=law.max_tilt_rad,
        tilt_lag_s=airframe.tilt_lag_s,
        drag_1_s=airframe.drag_1_s,
    )


@compiled
def _may_turn(
    this: Floats, along: Floats, left: float, elapsed: float, following: Floats, onward: Floats, bounds: Floats
) -> bool:
    """Whether the next leg may start: looks at the middle of the turn that this would make."""
    a1, v1, p1 = leg_state(this, elapsed + left / 2.0)
    a2, v2, p2 = leg_state(following, left / 2.0)
    way, fast = 0.0, 0.0
    acceleration = np.empty(3)
    for k in range(3):
        way += (along[k] * (p1 - this[9]) + onward[k] * p2) ** 2
        fast += (along[k] * v1 + onward[k] * v2) ** 2
        acceleration[k] = along[k] * a1 + onward[k] * a2
    slowest = min(this[4], following[4])
    return bool(
        way < bounds[0] ** 2
        and fast < slowest**2
        and math.hypot(acceleration[0], acceleration[1]) < bounds[1]
        and abs(acceleration[2]) < bounds[2]
    )


@compiled
def _add(reference: Floats, profile: Floats, along: Floats, t: float, origin: float) -> None:
    a, v, p = leg_state(profile, t)
    for k in range(3):
        reference[k] += along[k] * (p - origin)
        reference[3 + k] += along[k] * v
        reference[6 + k] += along[k] * a


@compiled
def _fly(
    points: Floats,
    holds: Floats,
    profiles: Floats,
    directions: Floats,
    bounds: Floats,
    pacing: Floats,
    gains: Floats,
    samples: Floats,
) -> tuple[int, bool]:
    """Fly it step by step; returns how many samples were written and whether the mission came to its end."""
    state = np.zeros(STATE_SIZE)
    state[:3] = points[0]
    reference = np.zeros(9)
    reference[:3] = points[0]
    legs = profiles.shape[0]
    leg, elapsed, before, onward = 0, 0.0, 0.0, 0.0
    turning, waited, pace = False, -1.0, 1.0
    steps = (samples.shape[0] - 1) * _STEPS_A_SAMPLE
    settled = 0.0
    for step in range(steps):
        if step % _STEPS_A_SAMPLE == 0:
            samples[step // _STEPS_A_SAMPLE] = state[:3]
            if leg == legs:
                return step // _STEPS_A_SAMPLE + 1, True
        pace = target_pace(state, reference, pacing, pace, _STEP_S)
        dt = _STEP_S * pace
        for k in range(3):
            reference[k] = points[min(leg, legs), k]
            reference[3 + k], reference[6 + k] = 0.0, 0.0
        if waited >= 0.0:
            # At rest on a waypoint, until its hold is over.
            waited += _STEP_S
            for k in range(3):
                reference[k] = points[leg + 1, k]
            if waited >= holds[leg + 1]:
                leg += 1
                elapsed, before, onward, turning, waited = 0.0, math.inf, 0.0, False, -1.0
            follow(state, reference, gains, _STEP_S)
            continue
        if leg == legs:
            follow(state, reference, gains, _STEP_S)
            continue
        this = profiles[leg]
        if leg > 0:
            before = min(before + dt, profiles[leg - 1, 8])
            _add(reference, profiles[leg - 1], directions[leg - 1], before, profiles[leg - 1, 9])
        elapsed = min(elapsed + dt, this[8])
        _add(reference, this, directions[leg], elapsed, 0.0)
        over = elapsed >= this[8]
        through = leg + 1 < legs and holds[leg + 1] == 0.0
        if through:
            left = this[8] - elapsed
            following = profiles[leg + 1]
            if turning:
                onward += dt
                _add(reference, following, directions[leg + 1], onward, 0.0)
                over = over or onward >= left
            elif (
                elapsed >= this[5] + this[7]
                and left <= following[5]
                and _may_turn(this, directions[leg], left, elapsed, following, directions[leg + 1], bounds)
            ):
                turning, onward = True, dt
                _add(reference, following, directions[leg + 1], onward, 0.0)
        follow(state, reference, gains, _STEP_S)
        if not over:
            continue
        if through:
            leg, before, elapsed, onward, turning = leg + 1, elapsed, onward, 0.0, False
            continue
        gap = 0.0
        for k in range(3):
            gap += (state[k] - points[leg + 1, k]) ** 2
        settled += _STEP_S
        if gap <= bounds[0] ** 2 or settled > _SETTLE_S:
            waited, settled = 0.0, 0.0
    return samples.shape[0] - 1, False
