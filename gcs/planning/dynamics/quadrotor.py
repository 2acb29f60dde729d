"""Rigid-body dynamics of a quadrotor with four lagging, saturating motors.

The equations of motion are eqs 3 and 4 of Tang, Gu, Zhu, Claramunt and Zhou, "HD Camera-Equipped UAV Trajectory
Planning for Gantry Crane Inspection", Remote Sensing 2022, 14, 1658, with linear air drag added:

    m r'' = u_1 z_B - m g z_W - D (r' - wind)
    I w'  = -w x I w + (u_2, u_3, u_4)

World frame: ENU (z up). Body frame: x forward, y left, z up along the thrust. A state is a row of `STATE_SIZE` numbers:
position (3, m), velocity (3, m/s), attitude quaternion world_from_body (4; w, x, y, z), body rates (3, rad/s), and the
thrust of each motor (4, N). Motors: 0 front left, 1 rear left, 2 rear right, 3 front right.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gcs.planning.numerics.compiled import compiled

Array = NDArray[np.float64]

STATE_SIZE = 17
GRAVITY_M_S2 = 9.80665
_SUBSTEP_LIMIT_S = 0.01


@dataclass(frozen=True)
class QuadrotorParameters:
    """Physical properties of a quadrotor.

    Attributes:
        mass_kg: all-up mass.
        inertia_kg_m2: principal moments about body x, y, z.
        arm_m: distance of each motor from the centre.
        torque_per_thrust_m: yaw moment of a motor per newton of its thrust.
        max_motor_thrust_n: of each motor.
        motor_time_constant_s: of the first-order lag between commanded and real thrust.
        drag_n_s_m: linear drag along world x, y, z.
    """

    mass_kg: float = 3.0
    inertia_kg_m2: tuple[float, float, float] = (0.055, 0.055, 0.095)
    arm_m: float = 0.32
    torque_per_thrust_m: float = 0.02
    max_motor_thrust_n: float = 16.0
    motor_time_constant_s: float = 0.03
    drag_n_s_m: tuple[float, float, float] = (0.35, 0.35, 0.45)

    def packed(self) -> Array:
        """The numbers as the kernels take them, shape (12,)."""
        numbers = [
            self.mass_kg,
            *self.inertia_kg_m2,
            self.arm_m / math.sqrt(2.0),
            self.torque_per_thrust_m,
            self.max_motor_thrust_n,
            self.motor_time_constant_s,
            *self.drag_n_s_m,
            GRAVITY_M_S2,
        ]
        return np.array(numbers, dtype=np.float64)

    @property
    def hover_thrust_n(self) -> float:
        """Thrust of each motor in hover."""
        return self.mass_kg * GRAVITY_M_S2 / 4.0


def resting_state(position_m: ArrayLike, yaw_rad: float = 0.0, motor_thrust_n: float = 0.0) -> Array:
    """A level state at rest.

    Args:
        position_m: ENU, shape (..., 3).
        yaw_rad: of the body's x axis, from east counter-clockwise.
        motor_thrust_n: of each motor; the hover thrust for a state in the air.

    Returns:
        Shape (..., 17).
    """
    position = np.asarray(position_m, dtype=np.float64)
    state = np.zeros((*position.shape[:-1], STATE_SIZE))
    state[..., 0:3] = position
    state[..., 6] = math.cos(yaw_rad / 2.0)
    state[..., 9] = math.sin(yaw_rad / 2.0)
    state[..., 13:17] = motor_thrust_n
    return state


def rotation_of(state: ArrayLike) -> Array:
    """Rotation matrices world_from_body, shape (..., 3, 3), of states of shape (..., 17)."""
    q = np.asarray(state, dtype=np.float64)[..., 6:10]
    w, x, y, z = np.moveaxis(q, -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def simulate(
    state: ArrayLike,
    motor_commands_n: ArrayLike,
    duration_s: float,
    *,
    parameters: QuadrotorParameters,
    wind_m_s: ArrayLike = (0.0, 0.0, 0.0),
    dt_s: float = 0.002,
) -> Array:
    """Let vehicles fly with constant motor commands.

    Args:
        state: shape (..., 17).
        motor_commands_n: commanded thrust of each motor, clipped to what a motor can give, shape (..., 4).
        duration_s: how long.
        parameters: of all vehicles.
        wind_m_s: velocity of the air, ENU.
        dt_s: step of the Runge-Kutta integration, at most 0.01 s.

    Returns:
        The states after the duration, shape (..., 17).

    Raises:
        ValueError: `dt_s` is out of range.
    """
    if not 0.0 < dt_s <= _SUBSTEP_LIMIT_S:
        raise ValueError(f"dt_s must be above 0 and at most {_SUBSTEP_LIMIT_S}")
    states = np.array(state, dtype=np.float64)
    flat = states.reshape(-1, STATE_SIZE)
    commands = np.broadcast_to(np.asarray(motor_commands_n, dtype=np.float64), (*states.shape[:-1], 4))
    steps = max(1, math.ceil(duration_s / dt_s - 1e-9))
    _simulate(
        flat,
        np.ascontiguousarray(commands).reshape(-1, 4),
        steps,
        duration_s / steps,
        np.asarray(wind_m_s, dtype=np.float64),
        parameters.packed(),
    )
    return flat.reshape(states.shape)


@compiled
def _derivative(state: Array, commands: Array, wind: Array, p: Array, out: Array) -> None:
    mass, tau = p[0], p[7]
    f0, f1, f2, f3 = state[13], state[14], state[15], state[16]
    thrust = f0 + f1 + f2 + f3
    w, x, y, z = state[6], state[7], state[8], state[9]
    out[0] = state[3]
    out[1] = state[4]
    out[2] = state[5]
    out[3] = (2.0 * (x * z + w * y) * thrust - p[8] * (state[3] - wind[0])) / mass
    out[4] = (2.0 * (y * z - w * x) * thrust - p[9] * (state[4] - wind[1])) / mass
    out[5] = ((1.0 - 2.0 * (x * x + y * y)) * thrust - p[10] * (state[5] - wind[2])) / mass - p[11]
    wx, wy, wz = state[10], state[11], state[12]
    out[6] = 0.5 * (-x * wx - y * wy - z * wz)
    out[7] = 0.5 * (w * wx + y * wz - z * wy)
    out[8] = 0.5 * (w * wy + z * wx - x * wz)
    out[9] = 0.5 * (w * wz + x * wy - y * wx)
    torque_x = p[4] * (f0 + f1 - f2 - f3)
    torque_y = p[4] * (-f0 + f1 + f2 - f3)
    torque_z = p[5] * (-f0 + f1 - f2 + f3)
    out[10] = (torque_x - (p[3] - p[2]) * wy * wz) / p[1]
    out[11] = (torque_y - (p[1] - p[3]) * wz * wx) / p[2]
    out[12] = (torque_z - (p[2] - p[1]) * wx * wy) / p[3]
    for i in range(4):
        command = min(max(commands[i], 0.0), p[6])
        out[13 + i] = (command - state[13 + i]) / tau


@compiled
def step_quadrotor(state: Array, commands: Array, wind: Array, dt: float, p: Array) -> None:
    """Advance one state in place by one step of the classical fourth-order Runge-Kutta method."""
    start = np.empty(STATE_SIZE)
    slope = np.empty(STATE_SIZE)
    total = np.zeros(STATE_SIZE)
    for i in range(STATE_SIZE):
        start[i] = state[i]
    for stage in range(4):
        _derivative(state, commands, wind, p, slope)
        weight = 2.0 if stage in (1, 2) else 1.0
        reach = dt if stage == 2 else 0.5 * dt
        for i in range(STATE_SIZE):
            total[i] += weight * slope[i]
            state[i] = start[i] + (reach * slope[i] if stage < 3 else dt / 6.0 * total[i])
    norm = math.sqrt(state[6] ** 2 + state[7] ** 2 + state[8] ** 2 + state[9] ** 2)
    for i in range(6, 10):
        state[i] /= norm


@compiled
def _simulate(states: Array, commands: Array, steps: int, dt: float, wind: Array, p: Array) -> None:
    for n in range(states.shape[0]):
        for _ in range(steps):
            step_quadrotor(states[n], commands[n], wind, dt, p)


@compiled
def allocate_motors(thrust: float, torque: Array, p: Array, out: Array) -> None:
    """Motor thrusts for a wrench; yaw gives way first where a motor would saturate, then everything is clipped.

    Args:
        thrust: along body z, N.
        torque: about body x, y, z, N m, shape (3,).
        p: packed parameters.
        out: commands, N, shape (4,).
    """
    a, limit = 4.0 * p[4], p[6]
    roll, pitch, yaw = torque[0] / a, torque[1] / a, torque[2] / (4.0 * p[5])
    base = min(max(thrust / 4.0, 0.0), limit)
    out[0] = base + roll - pitch
    out[1] = base + roll + pitch
    out[2] = base - roll + pitch
    out[3] = base - roll - pitch
    room = limit
    for i in range(4):
        room = min(room, max(0.0, min(out[i], limit - out[i])))
    yaw = min(max(yaw, -room), room)
    out[0] -= yaw
    out[1] += yaw
    out[2] -= yaw
    out[3] += yaw
    for i in range(4):
        out[i] = min(max(out[i], 0.0), limit)
