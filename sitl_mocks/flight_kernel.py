"""One compiled loop of the simulated flight: reference, controller, motors, rigid body, ground.

The reference is made by one of two sources. The *governor* leads it to a target with bounded speed, acceleration and
jerk, as the autopilots' own position modes do. The *setpoint* source takes it from the stream of an offboard
controller. A detour may lift either by a smooth bump. The governor's reference is flown by the geometric controller,
which is told drag and mean wind, as an autopilot's integrators know them in the long run. Setpoints are flown by the
same controller, or by the autopilots' cascade, which has to find out.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from gcs.planning.dynamics.geometric_controller import control
from gcs.planning.dynamics.quadrotor import GRAVITY_M_S2, step_quadrotor
from gcs.planning.numerics.compiled import compiled
from sitl_mocks.position_cascade import ATTITUDE_S2, ENABLED, TAN_TILT, cascade, settle

Array = NDArray[np.float64]

STEP_S = 0.004
"""Simulated time of one step (250 Hz)."""

# Layout of the guidance array.
POSITION, VELOCITY, ACCELERATION, JERK = 0, 3, 6, 9
YAW, YAW_RATE = 12, 13
SOURCE = 14
TARGET, TARGET_YAW = 15, 18
SETPOINT_AGE = 19
SETPOINT_POSITION, SETPOINT_VELOCITY, SETPOINT_ACCELERATION, SETPOINT_YAW = 20, 23, 26, 29
SETPOINT_YAW_RATE = 30
DETOUR_PHASE, DETOUR_TIME, DETOUR_HEIGHT, DETOUR_RISE_S = 31, 32, 33, 34
ASKED_FORCE = 35
GUIDANCE_SIZE = 38

SOURCE_NONE, SOURCE_GOVERNOR, SOURCE_SETPOINT = 0.0, 1.0, 2.0
DETOUR_OFF, DETOUR_RISING, DETOUR_HOLDING, DETOUR_FALLING = 0.0, 1.0, 2.0, 3.0

# Layout of the limits array.
MAX_HORIZONTAL, MAX_CLIMB, MAX_DESCENT = 0, 1, 2
MAX_ACCELERATION, MAX_VERTICAL_ACCELERATION, MAX_JERK = 3, 4, 5
MAX_YAW_RATE, MAX_YAW_ACCELERATION = 6, 7
CLIP_SETPOINT_SPEED, EXTRAPOLATE_SETPOINT = 8, 9
LIMITS_SIZE = 10

BRAKING_SHARE = 0.67
"""Of the acceleration that is allowed; the rest is for corrections."""
POSITION_GAIN = 2.0
"""Speed of the governor for each metre that is left."""
_VELOCITY_GAIN = 5.0
_MAX_CORRECTION_M_S = 6.0


@compiled
def fly(
    steps: int,
    state: Array,
    guidance: Array,
    limits: Array,
    wind: Array,
    mean_wind: Array,
    ground: float,
    p: Array,
    g: Array,
    cascade_gains: Array,
    memory: Array,
) -> float:
    """Advance one vehicle in place.

    Args:
        steps: number of steps of `STEP_S`.
        state: of the quadrotor, shape (17,).
        guidance: shape (`GUIDANCE_SIZE`,), laid out as above.
        limits: shape (`LIMITS_SIZE`,), laid out as above.
        wind: velocity of the air, ENU.
        mean_wind: the same without gusts, which is what the governor's controller is told.
        ground: height of the ground, m.
        p: packed parameters of the quadrotor.
        g: packed gains of the geometric controller.
        cascade_gains: packed gains of the autopilots' cascade; setpoints are flown by the geometric one if it is off.
        memory: of the cascade.

    Returns:
        Integral of the sum of `thrust**1.5` over the motors, N^1.5 s, from which the battery's use follows.
    """
    reference = np.zeros(14)
    commands = np.zeros(4)
    holding = np.zeros(3)
    inner = g.copy()
    inner[2:5] = cascade_gains[ATTITUDE_S2 : TAN_TILT + 1]
    effort = 0.0
    for _ in range(steps):
        if guidance[SOURCE] == SOURCE_NONE:
            commands[:] = 0.0
        elif guidance[SOURCE] == SOURCE_SETPOINT and cascade_gains[ENABLED] > 0.0:
            _follow_setpoint(guidance, limits)
            wish = _lifted(guidance)
            clips = limits[CLIP_SETPOINT_SPEED] > 0.0
            cascade(state, wish, limits, clips, cascade_gains, memory, STEP_S, reference)
            _set_yaw(guidance, reference)
            _note_asked(state, reference, inner, guidance)
            control(state, reference, p, inner, commands)
        else:
            if guidance[SOURCE] == SOURCE_GOVERNOR:
                _govern(guidance, limits)
            else:
                _follow_setpoint(guidance, limits)
            wish = _lifted(guidance)
            _make_reference(state, guidance, wish, limits, g, reference)
            if guidance[SOURCE] == SOURCE_GOVERNOR:
                for i in range(3):
                    holding[i] = p[8 + i] / p[0] * (wish[3 + i] - mean_wind[i])
                    reference[6 + i] += holding[i]
            settle(state, wish, cascade_gains, holding, memory)
            _note_asked(state, reference, g, guidance)
            control(state, reference, p, g, commands)
        step_quadrotor(state, commands, wind, STEP_S, p)
        if state[2] <= ground:
            _rest_on_ground(state, ground)
        for i in range(13, 17):
            effort += max(state[i], 0.0) ** 1.5 * STEP_S
    return effort


@compiled
def _rest_on_ground(state: Array, ground: float) -> None:
    state[2] = ground
    state[5] = max(state[5], 0.0)
    state[3] = 0.0
    state[4] = 0.0
    yaw = math.atan2(2.0 * (state[6] * state[9] + state[7] * state[8]), 1.0 - 2.0 * (state[8] ** 2 + state[9] ** 2))
    state[6] = math.cos(yaw / 2.0)
    state[7] = 0.0
    state[8] = 0.0
    state[9] = math.sin(yaw / 2.0)
    state[10:13] = 0.0


@compiled
def _turn_yaw(guidance: Array, limits: Array, target: float) -> None:
    error = (target - guidance[YAW] + math.pi) % (2.0 * math.pi) - math.pi
    # The rate from which a stop is still possible, softened near the target.
    brake = math.sqrt(2.0 * limits[MAX_YAW_ACCELERATION] * abs(error))
    wanted = min(limits[MAX_YAW_RATE], 0.9 * brake, 4.0 * abs(error))
    wanted = math.copysign(wanted, error)
    most = limits[MAX_YAW_ACCELERATION] * STEP_S
    guidance[YAW_RATE] += min(max(wanted - guidance[YAW_RATE], -most), most)
    guidance[YAW] += guidance[YAW_RATE] * STEP_S


@compiled
def _govern(guidance: Array, limits: Array) -> None:
    _turn_yaw(guidance, limits, guidance[TARGET_YAW])
    way = np.empty(3)
    for i in range(3):
        way[i] = guidance[TARGET + i] - guidance[POSITION + i]
    distance = math.sqrt(way[0] ** 2 + way[1] ** 2 + way[2] ** 2)
    direction = np.zeros(3)
    if distance > 1e-9:
        direction = way / distance
    across = math.sqrt(direction[0] ** 2 + direction[1] ** 2)
    climb = limits[MAX_CLIMB] if direction[2] > 0.0 else limits[MAX_DESCENT]
    top = 1e9
    brake = 1e9
    if across > 1e-6:
        top = limits[MAX_HORIZONTAL] / across
        brake = limits[MAX_ACCELERATION] / across
    if abs(direction[2]) > 1e-6:
        top = min(top, climb / abs(direction[2]))
        brake = min(brake, limits[MAX_VERTICAL_ACCELERATION] / abs(direction[2]))
    if distance <= 1e-9:
        top = 0.0
        brake = limits[MAX_VERTICAL_ACCELERATION]
    brake *= BRAKING_SHARE
    closing = 0.0
    pushing = 0.0
    for i in range(3):
        closing += guidance[VELOCITY + i] * direction[i]
        pushing += guidance[ACCELERATION + i] * direction[i]
    # An acceleration has to be taken back first, at the limited jerk: until then the vehicle gains speed and way.
    pushing = max(pushing, 0.0)
    jerk = limits[MAX_JERK]
    gained = pushing**2 / (2.0 * jerk)
    left = max(distance - closing * pushing / jerk - pushing**3 / (3.0 * jerk**2), 0.0)
    # From speed v a stop with deceleration b, built up at jerk j, takes v^2 / (2 b) + v b / (2 j).
    delay = brake**2 / (2.0 * jerk)
    root = math.sqrt(delay**2 + 2.0 * brake * left)
    speed = root - delay - gained
    slope = brake / max(root, 1e-9)
    if POSITION_GAIN * distance < speed:
        speed = POSITION_GAIN * distance
        slope = POSITION_GAIN
    if speed >= top:
        speed = top
        slope = 0.0
    off = np.empty(3)
    for i in range(3):
        off[i] = speed * direction[i] - guidance[VELOCITY + i]
    # No more acceleration than can be taken back, at the limited jerk, while the speed comes right.
    gain = min(_VELOCITY_GAIN, math.sqrt(2.0 * jerk / max(math.sqrt(off[0] ** 2 + off[1] ** 2 + off[2] ** 2), 1e-9)))
    wanted = gain * off - slope * closing * direction
    # Shortened as a whole, so that a straight way stays straight.
    lean = math.sqrt(wanted[0] ** 2 + wanted[1] ** 2)
    wanted *= min(
        1.0,
        limits[MAX_ACCELERATION] / max(lean, 1e-9),
        limits[MAX_VERTICAL_ACCELERATION] / max(abs(wanted[2]), 1e-9),
    )
    change = 0.0
    for i in range(3):
        change += (wanted[i] - guidance[ACCELERATION + i]) ** 2
    change = math.sqrt(change)
    share = 1.0
    if change > limits[MAX_JERK] * STEP_S:
        share = limits[MAX_JERK] * STEP_S / change
    for i in range(3):
        guidance[JERK + i] = share * (wanted[i] - guidance[ACCELERATION + i]) / STEP_S
        guidance[ACCELERATION + i] += guidance[JERK + i] * STEP_S
        guidance[VELOCITY + i] += guidance[ACCELERATION + i] * STEP_S
        guidance[POSITION + i] += guidance[VELOCITY + i] * STEP_S


@compiled
def _follow_setpoint(guidance: Array, limits: Array) -> None:
    guidance[SETPOINT_AGE] += STEP_S
    if limits[EXTRAPOLATE_SETPOINT] > 0.0:
        for i in range(3):
            guidance[SETPOINT_POSITION + i] += guidance[SETPOINT_VELOCITY + i] * STEP_S
        if guidance[SETPOINT_AGE] > 0.5:
            guidance[SETPOINT_ACCELERATION : SETPOINT_ACCELERATION + 3] = 0.0
    guidance[POSITION : POSITION + 9] = guidance[SETPOINT_POSITION : SETPOINT_POSITION + 9]
    guidance[JERK : JERK + 3] = 0.0
    if math.isnan(guidance[SETPOINT_YAW]):
        rate = 0.0 if math.isnan(guidance[SETPOINT_YAW_RATE]) else guidance[SETPOINT_YAW_RATE]
        guidance[YAW_RATE] = min(max(rate, -limits[MAX_YAW_RATE]), limits[MAX_YAW_RATE])
        guidance[YAW] += guidance[YAW_RATE] * STEP_S
    else:
        _turn_yaw(guidance, limits, guidance[SETPOINT_YAW])


@compiled
def _detour(guidance: Array) -> tuple[float, float, float]:
    """Height, vertical speed and acceleration of the detour, after a step of its time."""
    phase = guidance[DETOUR_PHASE]
    if phase == DETOUR_OFF:
        return 0.0, 0.0, 0.0
    height, rise = guidance[DETOUR_HEIGHT], guidance[DETOUR_RISE_S]
    guidance[DETOUR_TIME] += STEP_S
    if phase == DETOUR_HOLDING:
        return height, 0.0, 0.0
    s = min(guidance[DETOUR_TIME] / rise, 1.0)
    step = s**3 * (10.0 - 15.0 * s + 6.0 * s * s)
    speed = 30.0 * s * s * (1.0 - s) ** 2 / rise
    acceleration = 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s) / rise**2
    if phase == DETOUR_FALLING:
        return height * (1.0 - step), -height * speed, -height * acceleration
    return height * step, height * speed, height * acceleration


@compiled
def _lifted(guidance: Array) -> Array:
    """Position, velocity and acceleration of the reference, lifted by the detour."""
    height, speed, acceleration = _detour(guidance)
    wish = guidance[POSITION : POSITION + 9].copy()
    wish[2] += height
    wish[5] += speed
    wish[8] += acceleration
    return wish


@compiled
def _make_reference(state: Array, guidance: Array, wish: Array, limits: Array, g: Array, reference: Array) -> None:
    # The position error enters as a correction of the speed, which is how the autopilots bound it.
    stiffness = g[0] / g[1]
    correction = np.empty(3)
    for i in range(3):
        correction[i] = stiffness * (wish[i] - state[i])
    lean = math.sqrt(correction[0] ** 2 + correction[1] ** 2)
    if lean > _MAX_CORRECTION_M_S:
        correction[0] *= _MAX_CORRECTION_M_S / lean
        correction[1] *= _MAX_CORRECTION_M_S / lean
    correction[2] = min(max(correction[2], -_MAX_CORRECTION_M_S), _MAX_CORRECTION_M_S)
    for i in range(3):
        reference[i] = state[i]
        reference[3 + i] = wish[3 + i] + correction[i]
        reference[6 + i] = wish[6 + i]
        reference[9 + i] = guidance[JERK + i]
    if limits[CLIP_SETPOINT_SPEED] > 0.0:
        lean = math.sqrt(reference[3] ** 2 + reference[4] ** 2)
        if lean > limits[MAX_HORIZONTAL]:
            reference[3] *= limits[MAX_HORIZONTAL] / lean
            reference[4] *= limits[MAX_HORIZONTAL] / lean
        reference[5] = min(max(reference[5], -limits[MAX_DESCENT]), limits[MAX_CLIMB])
    _set_yaw(guidance, reference)


@compiled
def _note_asked(state: Array, reference: Array, g: Array, guidance: Array) -> None:
    """Keep, for whoever asks, the thrust per mass that the position controller wants now."""
    for i in range(3):
        correction = g[0] * (reference[i] - state[i]) + g[1] * (reference[3 + i] - state[3 + i])
        guidance[ASKED_FORCE + i] = reference[6 + i] + correction
    guidance[ASKED_FORCE + 2] += GRAVITY_M_S2


@compiled
def _set_yaw(guidance: Array, reference: Array) -> None:
    reference[12] = guidance[YAW]
    reference[13] = guidance[YAW_RATE]
