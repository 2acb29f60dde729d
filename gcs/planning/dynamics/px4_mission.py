"""How PX4 flies a mission (its FlightTaskAuto and PositionSmoothing, releases 1.13 to 1.16).

A point runs ahead towards the current waypoint with bounded acceleration and jerk (`velocity_smoothing`), and the
vehicle follows it (`position_control`). The point's speed looks two waypoints ahead: the one after the next is
approached as if it were the end, and at the next waypoint the speed is what a circle tangent to both legs allows that
touches them one acceptance radius before and after it: `v^2 = c a r tan(alpha / 2)`, alpha the angle between the legs,
c MPC_XY_TRAJ_P. Waypoints nearer to each other than that radius, and those with a hold, are approached as ends.
Vertical speeds follow the same idea on their own; a common direction is kept by shortening the longer part.

The waypoint changes when the vehicle, not the point, is within the acceptance radius (level) and NAV_MC_ALT_RAD
(vertical). While the point turns (more than 11 degrees off its target, outside the radius) it is led along the leg by a
point at least 5 m ahead, and does not become faster. A vehicle that has passed the waypoint flies straight to it; one
that is further from the leg than the radius flies back to the leg first. So small radii make it wander.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from gcs.planning.dynamics.position_control import STATE_SIZE, follow, packed_gains
from gcs.planning.dynamics.predicted_flight import SAMPLE_S, PredictedFlight, require_positive, sample_times
from gcs.planning.dynamics.velocity_smoothing import advance, brakable_speed, in_time, quickest
from gcs.planning.numerics.compiled import compiled

if TYPE_CHECKING:
    from gcs.core.flight_law import Airframe, Px4Law
    from gcs.planning.dynamics.predicted_flight import MissionRoute

Floats = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

_STEP_S = 0.01
_STEPS_A_SAMPLE = round(SAMPLE_S / _STEP_S)
_NAVIGATOR_STEPS = 5
"""The navigator looks at the position less often than the controller runs."""

_SLOWEST_M_S = 0.1
_PATIENCE_S = 120.0
"""A mission is taken for stuck when a leg takes longer than at this speed, and two minutes."""

_SETTLE_S = 3.0
"""How long the flight is followed after the last waypoint counts as reached."""

_TURN_COSINE = 0.98
_TURN_SPEED_M_S = 0.2
_LEAD_M = 5.0
_SAME_M = 1e-3
_EASED_M_S = 0.5
"""Parts of the speed below this are not shortened to keep the direction."""


def predict_px4_mission(route: MissionRoute, law: Px4Law, airframe: Airframe) -> PredictedFlight:
    """Predict a mission; see `MissionModel`.

    Args:
        route: the mission; its vertical speeds do not count, those of the law do.
        law: the vehicle's settings.
        airframe: its drag and lag.

    Raises:
        InputError: a limit is not positive.
    """
    cruise = min(law.cruise_m_s if route.speed_m_s is None else route.speed_m_s, law.max_speed_m_s)
    bounds = {
        "cruise_m_s": cruise,
        "acceleration_m_s2": law.acceleration_m_s2,
        "climb_acceleration_m_s2": law.climb_acceleration_m_s2,
        "descent_acceleration_m_s2": law.descent_acceleration_m_s2,
        "climb_m_s": min(law.climb_m_s, law.max_climb_m_s),
        "descent_m_s": min(law.descent_m_s, law.max_descent_m_s),
        "jerk_m_s3": law.jerk_m_s3,
        "turn_gain": law.turn_gain,
        "height_radius_m": law.height_radius_m,
        "max_lag_m": law.max_lag_m,
        "radius_m": law.radius_m,
        "max_speed_m_s": law.max_speed_m_s,
    }
    require_positive(bounds)
    points = np.ascontiguousarray(route.points_m)
    radius = np.where(route.radius_m > 0, route.radius_m, law.radius_m)
    length = float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
    most = length / _SLOWEST_M_S + float(route.hold_s.sum()) + _PATIENCE_S
    samples = np.empty((math.ceil(most / SAMPLE_S) + 2, 3))
    used, finished = _fly(
        points,
        radius,
        np.ascontiguousarray(route.hold_s),
        np.array(list(bounds.values())),
        px4_gains(law, airframe),
        samples,
    )
    return PredictedFlight(sample_times(used), samples[:used].copy(), finished)


def px4_gains(law: Px4Law, airframe: Airframe) -> Floats:
    """The cascade's numbers; setpoints cannot ask for more than MPC_XY_VEL_MAX and MPC_Z_VEL_MAX_UP / DN."""
    return packed_gains(
        level=(law.position_gain_s, *law.velocity_gains_s),
        vertical=(law.vertical_position_gain_s, *law.vertical_velocity_gains_s),
        derivative_of_error=False,
        max_speed_m_s=law.max_speed_m_s,
        max_climb_m_s=law.max_climb_m_s,
        max_descent_m_s=law.max_descent_m_s,
        max_tilt_rad=law.max_tilt_rad,
        tilt_lag_s=airframe.tilt_lag_s,
        drag_1_s=airframe.drag_1_s,
    )


@compiled
def _angle(ax: float, ay: float, bx: float, by: float) -> float:
    """Angle between two plane vectors; a right one when either has no length. Never quite pi."""
    size = math.hypot(ax, ay) * math.hypot(bx, by)
    cosine = (ax * bx + ay * by) / size if size > 1e-12 else 0.0
    return min(math.acos(min(max(cosine, -1.0), 1.0)), math.pi - 1.2e-7)


@compiled
def _level_speed(start: Floats, target: Floats, after: Floats, leaving: float, radius: float, bounds: Floats) -> float:
    """Level speed towards a target that is left for another one at no more than the speed `leaving`."""
    cruise, acceleration, jerk = bounds[0], bounds[1], bounds[6]
    apart = math.hypot(after[0] - target[0], after[1] - target[1])
    at_target = 0.0
    if apart > _SAME_M and apart >= radius:
        angle = _angle(target[0] - start[0], target[1] - start[1], target[0] - after[0], target[1] - after[1])
        at_target = min(math.sqrt(bounds[7] * acceleration * radius * math.tan(angle / 2.0)), leaving, cruise)
    distance = math.hypot(target[0] - start[0], target[1] - start[1])
    return float(min(cruise, brakable_speed(jerk, acceleration, distance, at_target)))


@compiled
def _vertical_speed(start: Floats, target: Floats, after: Floats, acceleration: float, most: float, b: Floats) -> float:
    """Vertical speed towards a target. Distances from the origin stand for level ones, as in the autopilot."""
    arriving = 0.0
    if abs(target[2] - after[2]) > _SAME_M:
        here = math.hypot(target[0], target[1])
        angle = _angle(
            here - math.hypot(start[0], start[1]),
            target[2] - start[2],
            here - math.hypot(after[0], after[1]),
            target[2] - after[2],
        )
        arriving = min(math.sqrt(acceleration * b[8] * math.tan(angle / 2.0)), most)
    return min(most, brakable_speed(b[6], acceleration, abs(target[2] - start[2]), arriving))


@compiled
def _lead_point(point: Floats, start: Floats, target: Floats, radius: float, out: Floats) -> None:
    """The point on the leg's line that is at least 5 m from a point beside it."""
    length, along, beside = 0.0, 0.0, 0.0
    for k in range(3):
        length += (target[k] - start[k]) ** 2
    length = max(math.sqrt(length), 1e-9)
    for k in range(3):
        along += (point[k] - start[k]) * (target[k] - start[k]) / length
    for k in range(3):
        out[k] = start[k] + (target[k] - start[k]) / length * along
        beside += (out[k] - point[k]) ** 2
    lead = math.sqrt(max(max(radius, _LEAD_M) ** 2 - beside, 0.0))
    for k in range(3):
        out[k] += (target[k] - start[k]) / length * lead


@compiled
def _triplet(state: Floats, before: Floats, target: Floats, after: Floats, radius: float, out: Floats) -> int:
    """Where it flies from, to and on to, shape (3, 3), and why: 0 as planned, 1 past it, 2 before the leg, 3 beside."""
    ux, uy = target[0] - before[0], target[1] - before[1]
    length = math.hypot(ux, uy)
    case = 0
    out[0], out[1], out[2] = before, target, after
    if length < 1e-7:
        return case
    ux, uy = ux / length, uy / length
    along = (state[0] - before[0]) * ux + (state[1] - before[1]) * uy
    x, y = before[0] + along * ux, before[1] + along * uy
    if along > length:
        case = 1
        out[0] = state[:3]
    elif along < 0.0 and math.hypot(state[0] - before[0], state[1] - before[1]) > radius:
        case = 2
        out[0], out[1], out[2] = state[:3], before, target
    elif math.hypot(state[0] - x, state[1] - y) > radius:
        case = 3
        out[0], out[2] = state[:3], target
        out[1, 0], out[1, 1], out[1, 2] = x, y, target[2]
    return case


@compiled
def _wanted_velocity(axes: Floats, way: Floats, radius: float, bounds: Floats, climbing: bool, memory: Floats) -> None:
    """The velocity that the point is to have; `memory` is velocity (3) and the level speed before a turn."""
    point = axes[:, 0].copy()
    vertical = bounds[2] if climbing else bounds[3]
    fastest = bounds[4] if climbing else bounds[5]
    gx, gy = way[1, 0] - point[0], way[1, 1] - point[1]
    gap, speed = math.hypot(gx, gy), math.hypot(axes[0, 1], axes[1, 1])
    turning = speed > _TURN_SPEED_M_S and gap > radius
    if turning:
        turning = (axes[0, 1] * gx + axes[1, 1] * gy) / (speed * gap) < _TURN_COSINE
    aim = way[1].copy()
    if turning:
        _lead_point(point, way[0], way[1], radius, aim)
    leaving = _level_speed(way[1], way[2], way[2], 0.0, radius, bounds)
    level = _level_speed(point, way[1], way[2], leaving, radius, bounds)
    upright = _vertical_speed(point, way[1], way[2], vertical, fastest, bounds)
    if turning:
        level = min(memory[3], level)
    else:
        memory[3] = level
    distance = math.sqrt((aim[0] - point[0]) ** 2 + (aim[1] - point[1]) ** 2 + (aim[2] - point[2]) ** 2)
    whole = math.hypot(level, upright)
    for k in range(3):
        memory[k] = (aim[k] - point[k]) / distance * whole if distance > 1e-9 else 0.0
    size = math.hypot(memory[0], memory[1])
    if size > max(level, _EASED_M_S):
        for k in range(3):
            memory[k] *= level / size
    size = abs(memory[2])
    if size > max(upright, _EASED_M_S):
        for k in range(3):
            memory[k] *= upright / size


@compiled
def _move_point(axes: Floats, plans: Floats, state: Floats, memory: Floats, bounds: Floats, climbing: bool) -> None:
    """Move the point on, slower while the vehicle is behind it, and plan anew."""
    jerk = bounds[6]
    x, y = axes[0, 0] - state[0], axes[1, 0] - state[1]
    stretch = 1.0
    if x * axes[0, 1] + y * axes[1, 1] >= 0.0:
        stretch = 1.0 - min(math.hypot(x, y) / bounds[9], 1.0)
    longest, slowest = 0.0, 0
    for k in range(3):
        advance(axes[k], plans[k], jerk, _STEP_S * stretch)
    for k in range(3):
        most = bounds[1] if k < 2 else (bounds[2] if climbing else bounds[3])
        fastest = bounds[11] if k < 2 else (bounds[4] if climbing else bounds[5])
        memory[k] = min(max(memory[k], -fastest), fastest)
        quickest(axes[k, 2], axes[k, 1], memory[k], jerk, most, plans[k])
        total = plans[k, 1] + plans[k, 2] + plans[k, 3]
        if total > longest:
            longest, slowest = total, k
    for k in range(3):
        if k != slowest and plans[k, 1] + plans[k, 2] + plans[k, 3] < longest:
            most = bounds[1] if k < 2 else (bounds[2] if climbing else bounds[3])
            in_time(axes[k, 2], axes[k, 1], memory[k], jerk, most, longest, plans[k])


@compiled
def _fly(
    points: Floats, radius: Floats, holds: Floats, bounds: Floats, gains: Floats, samples: Floats
) -> tuple[int, bool]:
    """Fly it step by step; returns how many samples were written and whether the mission came to its end."""
    state = np.zeros(STATE_SIZE)
    state[:3] = points[0]
    axes, plans = np.zeros((3, 3)), np.zeros((3, 4))
    axes[:, 0] = points[0]
    reference, way, memory = np.zeros(9), np.zeros((3, 3)), np.zeros(4)
    last = points.shape[0] - 1
    current, inside, case = 1, -1.0, -1
    used, step, changed = 0, 0, True
    timed, give_up_s = 0, 0.0
    while True:
        t = step * _STEP_S
        if current != timed:
            timed, gap = current, 0.0
            for k in range(3):
                gap += (points[current, k] - points[current - 1, k]) ** 2
            give_up_s = t + math.sqrt(gap) / _SLOWEST_M_S + holds[current] + _PATIENCE_S
        elif t > give_up_s:
            return used, False
        if step % _STEPS_A_SAMPLE == 0:
            samples[used] = state[:3]
            used += 1
            if used == samples.shape[0]:
                return used, False
        if step % _NAVIGATOR_STEPS == 0:
            near = math.hypot(state[0] - points[current, 0], state[1] - points[current, 1]) <= radius[current]
            if inside < 0.0 and near and abs(state[2] - points[current, 2]) <= bounds[8]:
                inside = t
            if inside >= 0.0 and t - inside >= holds[current]:
                if current < last:
                    current, inside, changed = current + 1, -1.0, True
                elif t - inside >= holds[last] + _SETTLE_S:
                    return used, True
        after = current if holds[current] > 0.0 else min(current + 1, last)
        fresh = np.zeros((3, 3))
        now = _triplet(state, points[current - 1], points[current], points[after], radius[current], fresh)
        if changed or now != case or now == 3:
            way[:] = fresh
            case, changed = now, False
        climbing = memory[2] > 0.0
        _wanted_velocity(axes, way, radius[current], bounds, climbing, memory)
        _move_point(axes, plans, state, memory, bounds, climbing)
        for k in range(3):
            for order in range(3):
                reference[3 * order + k] = axes[k, order]
        follow(state, reference, gains, _STEP_S)
        step += 1
