"""How the two autopilots follow a stream of setpoints (GUIDED and OFFBOARD).

PX4 gives position, velocity and acceleration to its position control as they come (`position_control`), which bounds
the speeds: a setpoint that climbs faster than MPC_Z_VEL_MAX_UP is left behind.

ArduPilot moves the newest setpoint on with its own velocity and acceleration, and shapes a desired state after it,
which the position control then follows. With a_m WPNAV_ACCEL and j PSC_JERK, a velocity
`sqrt_law(error; j / 2 a_m, a_m / 2)` is added to the setpoint's velocity, and an acceleration
`sqrt_law(velocity error; j / a_m, j)`, bounded by a_m, to its acceleration. The desired acceleration moves towards the
sum by at most j. Vertical speeds that are fed forward are not bounded.
`sqrt_law(x; p, a)` is p x for small x and `sqrt(2 a (|x| - a / 2 p^2))` beyond a / p^2.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from gcs.planning.dynamics.ardupilot_mission import ardupilot_gains
from gcs.planning.dynamics.position_control import STATE_SIZE, follow
from gcs.planning.dynamics.predicted_flight import SAMPLE_S, PredictedFlight, require_positive, sample_times
from gcs.planning.dynamics.px4_mission import px4_gains
from gcs.planning.numerics.compiled import compiled

if TYPE_CHECKING:
    from gcs.core.flight_law import Airframe, ArduPilotLaw, Px4Law
    from gcs.planning.dynamics.predicted_flight import SetpointStream

Floats = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

_STEP_S = 0.005
_STEPS_A_SAMPLE = round(SAMPLE_S / _STEP_S)
_CROSS_SHARE = 1.0 / math.sqrt(2.0)
_UNBOUNDED_M_S = 1e6


def predict_px4_stream(stream: SetpointStream, law: Px4Law, airframe: Airframe) -> PredictedFlight:
    """Predict OFFBOARD flight; see `StreamModel`."""
    require_positive(
        {
            "max_speed_m_s": law.max_speed_m_s,
            "max_climb_m_s": law.max_climb_m_s,
            "max_descent_m_s": law.max_descent_m_s,
        }
    )
    return _predicted(stream, px4_gains(law, airframe), np.zeros(0))


def predict_ardupilot_stream(stream: SetpointStream, law: ArduPilotLaw, airframe: Airframe) -> PredictedFlight:
    """Predict GUIDED flight with position, velocity and acceleration; see `StreamModel`."""
    shaping = {
        "acceleration_m_s2": law.acceleration_m_s2,
        "stream_jerk_m_s3": law.stream_jerk_m_s3,
        "vertical_acceleration_m_s2": law.vertical_acceleration_m_s2,
        "stream_vertical_jerk_m_s3": law.stream_vertical_jerk_m_s3,
        "speed_m_s": law.speed_m_s,
        "climb_m_s": law.climb_m_s,
        "descent_m_s": law.descent_m_s,
    }
    require_positive(shaping)
    gains = ardupilot_gains(law, airframe, _UNBOUNDED_M_S, _UNBOUNDED_M_S, _UNBOUNDED_M_S)
    return _predicted(stream, gains, np.array(list(shaping.values())))


def _predicted(stream: SetpointStream, gains: Floats, shaping: Floats) -> PredictedFlight:
    duration = float(stream.time_s[-1] - stream.time_s[0])
    samples = np.empty((math.ceil(duration / SAMPLE_S) + 1, 3))
    _fly(np.ascontiguousarray(stream.time_s - stream.time_s[0]), stream.packed(), gains, shaping, samples)
    return PredictedFlight(sample_times(len(samples)), samples)


@compiled
def _sqrt_law(error: float, gain: float, second: float, dt: float) -> float:
    """What closes a positive error without overshoot; never more than closes it within one step."""
    bend = second / (gain * gain)
    wanted = gain * error if error <= bend else math.sqrt(2.0 * second * (error - bend / 2.0))
    return min(wanted, error / dt)


@compiled
def _signed_sqrt_law(error: float, gain: float, second: float, dt: float) -> float:
    size = _sqrt_law(abs(error), gain, second, dt)
    return size if error >= 0.0 else -size


@compiled
def _shortened(x: float, y: float, most: float) -> tuple[float, float]:
    size = math.hypot(x, y)
    return (x * most / size, y * most / size) if size > most else (x, y)


@compiled
def _shape_level(target: Floats, desired: Floats, shaping: Floats, dt: float) -> None:
    """Move the desired level acceleration towards what brings the desired state to the target."""
    most, jerk, fastest = shaping[0], shaping[1], shaping[4]
    ex, ey = target[0] - desired[0], target[1] - desired[1]
    size = math.hypot(ex, ey)
    vx, vy = 0.0, 0.0
    if size > 1e-12:
        pull = min(_sqrt_law(size, jerk / (2.0 * most), most / 2.0, dt), fastest)
        vx, vy = ex / size * pull, ey / size * pull
    vx, vy = vx + target[3], vy + target[4]
    ex, ey = vx - desired[3], vy - desired[4]
    size, speed = math.hypot(ex, ey), math.hypot(vx, vy)
    ax, ay = 0.0, 0.0
    if size > 1e-12:
        pull = _sqrt_law(size, jerk / most, jerk, dt)
        ax, ay = ex / size * pull, ey / size * pull
    if speed < 1e-9:
        ax, ay = _shortened(ax, ay, most)
    else:
        ux, uy = vx / speed, vy / speed
        along = ax * ux + ay * uy
        cx, cy = ax - along * ux, ay - along * uy
        if along * along <= cx * cx + cy * cy:
            ax, ay = _shortened(ax, ay, most)
        else:
            # Across the way comes first, up to its share.
            cx, cy = _shortened(cx, cy, _CROSS_SHARE * most)
            room = math.sqrt(max(most * most - cx * cx - cy * cy, 0.0))
            along = min(max(along, -room), room)
            ax, ay = cx + along * ux, cy + along * uy
    x, y = _shortened(ax + target[6] - desired[6], ay + target[7] - desired[7], jerk * dt)
    desired[6] += x
    desired[7] += y


@compiled
def _shape_vertical(target: Floats, desired: Floats, shaping: Floats, dt: float) -> None:
    most, jerk = shaping[2], shaping[3]
    speed = _signed_sqrt_law(target[2] - desired[2], jerk / (2.0 * most), most / 2.0, dt)
    speed = min(max(speed, -shaping[6]), shaping[5]) + target[5]
    pull = _signed_sqrt_law(speed - desired[5], jerk / most, jerk, dt)
    wanted = min(max(pull, -most), most) + target[8]
    desired[8] += min(max(wanted - desired[8], -jerk * dt), jerk * dt)


@compiled
def _fly(times: Floats, setpoints: Floats, gains: Floats, shaping: Floats, samples: Floats) -> None:
    """Follow the setpoints from rest on the first; `shaping` is empty where they are followed as they come."""
    state = np.zeros(STATE_SIZE)
    state[:3] = setpoints[0, :3]
    target, desired = setpoints[0].copy(), np.zeros(9)
    desired[:3] = setpoints[0, :3]
    newest = 0
    for step in range(samples.shape[0] * _STEPS_A_SAMPLE):
        if step % _STEPS_A_SAMPLE == 0:
            samples[step // _STEPS_A_SAMPLE] = state[:3]
        while newest + 1 < times.shape[0] and times[newest + 1] <= step * _STEP_S + 1e-9:
            newest += 1
            target[:] = setpoints[newest]
        if shaping.shape[0] == 0:
            follow(state, target, gains, _STEP_S)
            continue
        for k in range(3):
            desired[k] += desired[3 + k] * _STEP_S + desired[6 + k] * _STEP_S * _STEP_S / 2.0
            desired[3 + k] += desired[6 + k] * _STEP_S
        _shape_level(target, desired, shaping, _STEP_S)
        _shape_vertical(target, desired, shaping, _STEP_S)
        for k in range(3):
            target[k] += target[3 + k] * _STEP_S + target[6 + k] * _STEP_S * _STEP_S / 2.0
            target[3 + k] += target[6 + k] * _STEP_S
        follow(state, desired, gains, _STEP_S)
