"""Geometric tracking controller of a quadrotor, and how well it would track a given reference.

Eqs 5 and 6 of Tang, Gu, Zhu, Claramunt and Zhou, Remote Sensing 2022, 14, 1658 (after Lee, Leok and McClamroch), read
as

    F = m r''_ref + m g z_W - k_p e_p - k_v e_v,   u_1 = F . z_B
    (u_2, u_3, u_4) = -k_R e_R - k_w e_w

where eq 5 is printed as a product: the thrust is the projection of the desired force on the body z axis. The desired
attitude has its z axis along F and its x axis above the yaw reference, which closes it;
`e_R = 1/2 vee(R_d' R - R' R_d)`, `e_w = w - R' R_d w_d`. The desired rates `w_d` follow from the reference's jerk and
yaw rate by differential flatness (zero jerk is a good answer where it is not known).

A reference is a row of `REFERENCE_SIZE` numbers: position, velocity, acceleration, jerk (3 each, ENU), yaw (rad) and
yaw rate (rad/s).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gcs.planning.dynamics.quadrotor import (
    STATE_SIZE,
    QuadrotorParameters,
    allocate_motors,
    resting_state,
    step_quadrotor,
)
from gcs.planning.numerics.compiled import compiled

Array = NDArray[np.float64]

REFERENCE_SIZE = 14


@dataclass(frozen=True)
class ControllerGains:
    """Gains per unit of mass and inertia, so that they need not change with the vehicle.

    Attributes:
        position_s2: `k_p / m`, 1/s^2.
        velocity_s: `k_v / m`, 1/s.
        attitude_s2: `k_R / I`, 1/s^2.
        rate_s: `k_w / I`, 1/s.
        max_tilt_rad: the desired thrust never leans further than this.
    """

    position_s2: float = 6.0
    velocity_s: float = 4.5
    attitude_s2: float = 160.0
    rate_s: float = 20.0
    max_tilt_rad: float = 0.75

    def packed(self) -> Array:
        """The numbers as the kernels take them, shape (5,)."""
        numbers = [self.position_s2, self.velocity_s, self.attitude_s2, self.rate_s, math.tan(self.max_tilt_rad)]
        return np.array(numbers, dtype=np.float64)


def track_reference(
    reference: ArrayLike,
    dt_s: float,
    *,
    parameters: QuadrotorParameters,
    gains: ControllerGains,
    wind_m_s: ArrayLike = (0.0, 0.0, 0.0),
    start: ArrayLike | None = None,
) -> Array:
    """Fly sampled references under the controller.

    Args:
        reference: references at multiples of `dt_s`, shape (..., T, 14); each is held for one step.
        dt_s: spacing of the samples and step of the integration, s; 0.005 or less is stable with the default gains.
        parameters: of the vehicle.
        gains: of the controller.
        wind_m_s: velocity of the air, ENU, shape (3,), or (T, 3) where it changes with time.
        start: first states, shape (..., 17); at rest on the first reference with hovering motors when None.

    Returns:
        The states at the sample times, shape (..., T, 17).
    """
    samples = np.ascontiguousarray(reference, dtype=np.float64)
    batch = samples.shape[:-2]
    flat = samples.reshape(-1, samples.shape[-2], REFERENCE_SIZE)
    if start is None:
        states = np.stack([resting_state(r[0, :3], float(r[0, 12]), parameters.hover_thrust_n) for r in flat])
    else:
        states = np.array(np.broadcast_to(np.asarray(start, dtype=np.float64), (*batch, STATE_SIZE)))
        states = states.reshape(-1, STATE_SIZE)
    wind = np.broadcast_to(np.asarray(wind_m_s, dtype=np.float64), (samples.shape[-2], 3))
    flown = _track(flat, states, dt_s, np.ascontiguousarray(wind), parameters.packed(), gains.packed())
    return flown.reshape(*batch, samples.shape[-2], STATE_SIZE)


@compiled
def control(state: Array, reference: Array, p: Array, gains: Array, commands: Array) -> None:
    """Motor commands for one state and one reference.

    Args:
        state: shape (17,).
        reference: shape (14,).
        p: packed parameters of the quadrotor.
        gains: packed gains.
        commands: receives the four motor thrusts, N.
    """
    mass, gravity = p[0], p[11]
    force = np.empty(3)
    for i in range(3):
        force[i] = mass * (
            reference[6 + i] + gains[0] * (reference[i] - state[i]) + gains[1] * (reference[3 + i] - state[3 + i])
        )
    # The vertical axis keeps some thrust in all cases: a rotor cannot pull, and attitude needs something to act with.
    force[2] = max(force[2] + mass * gravity, 0.2 * mass * gravity)
    lean = math.sqrt(force[0] ** 2 + force[1] ** 2)
    if lean > gains[4] * force[2]:
        shrink = gains[4] * force[2] / lean
        force[0] *= shrink
        force[1] *= shrink
    w, x, y, z = state[6], state[7], state[8], state[9]
    r = np.empty((3, 3))
    r[0, 0], r[0, 1], r[0, 2] = 1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)
    r[1, 0], r[1, 1], r[1, 2] = 2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)
    r[2, 0], r[2, 1], r[2, 2] = 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)
    thrust = force[0] * r[0, 2] + force[1] * r[1, 2] + force[2] * r[2, 2]

    # Desired attitude, columns x, y, z: z along the force, y level and across the heading.
    size = math.sqrt(force[0] ** 2 + force[1] ** 2 + force[2] ** 2)
    rd = np.empty((3, 3))
    for i in range(3):
        rd[i, 2] = force[i] / size
    c, s = math.cos(reference[12]), math.sin(reference[12])
    rd[0, 1], rd[1, 1], rd[2, 1] = -rd[2, 2] * s, rd[2, 2] * c, rd[0, 2] * s - rd[1, 2] * c
    norm = math.sqrt(rd[0, 1] ** 2 + rd[1, 1] ** 2 + rd[2, 1] ** 2)
    for i in range(3):
        rd[i, 1] /= norm
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        rd[i, 0] = rd[j, 1] * rd[k, 2] - rd[k, 1] * rd[j, 2]

    # By flatness: the jerk across the thrust axis turns it; u_1 is what the desired force says.
    across_x, across_y = 0.0, 0.0
    for i in range(3):
        across_x += reference[9 + i] * rd[i, 0] * mass / size
        across_y += reference[9 + i] * rd[i, 1] * mass / size
    # The body's y axis stays level and across the heading, so the body also turns about the thrust axis as it leans.
    onto_x, onto_z = c * rd[0, 0] + s * rd[1, 0], c * rd[0, 2] + s * rd[1, 2]
    turn = (-across_y * onto_z + reference[13] * (c * rd[1, 1] - s * rd[0, 1])) / onto_x
    rate_d = (-across_y, across_x, turn)

    error = np.zeros((3, 3))  # R_d' R
    for i in range(3):
        for j in range(3):
            for k in range(3):
                error[i, j] += rd[k, i] * r[k, j]
    torque = np.empty(3)
    lever = (error[2, 1] - error[1, 2], error[0, 2] - error[2, 0], error[1, 0] - error[0, 1])
    for i in range(3):
        rate_in_body = error[0, i] * rate_d[0] + error[1, i] * rate_d[1] + error[2, i] * rate_d[2]
        torque[i] = p[1 + i] * (-gains[2] * 0.5 * lever[i] - gains[3] * (state[10 + i] - rate_in_body))
    allocate_motors(thrust, torque, p, commands)


@compiled
def _track(references: Array, states: Array, dt: float, wind: Array, p: Array, gains: Array) -> Array:
    flown = np.empty((references.shape[0], references.shape[1], STATE_SIZE))
    commands = np.empty(4)
    for n in range(references.shape[0]):
        state = states[n]
        for k in range(references.shape[1]):
            flown[n, k] = state
            control(state, references[n, k], p, gains, commands)
            step_quadrotor(state, commands, wind[k], dt, p)
    return flown
