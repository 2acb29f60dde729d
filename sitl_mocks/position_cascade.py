"""PX4's position controller: position errors ask for speed, speed errors for acceleration, acceleration for tilt.

`v = v_setpoint + P_x (x_setpoint - x)`, bounded, then `a = a_setpoint + P_v (v - v_now) + I integral(v - v_now) - D
dv/dt`, the derivative behind a low-pass filter; the tilt follows the horizontal part alone, as with MPC_ACC_DECOUPLE.
What a setpoint does not ask for in advance, drag above all, has to build up as an error first: that is what makes the
real one late and cut corners. With the parameters' default values, drag and attitude bandwidth as below it flies as
the recorded one does.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import NDArray

from gcs.planning.dynamics.quadrotor import GRAVITY_M_S2
from gcs.planning.numerics.compiled import compiled

if TYPE_CHECKING:
    from sitl_mocks.parameters import ParameterServer

Array = NDArray[np.float64]

# Layout of the gains array.
ENABLED = 0
POSITION_P, POSITION_Z_P = 1, 2
VELOCITY_P, VELOCITY_I, VELOCITY_D = 3, 4, 5
VELOCITY_Z_P, VELOCITY_Z_I, VELOCITY_Z_D = 6, 7, 8
ATTITUDE_S2, RATE_S, TAN_TILT = 9, 10, 11
GAINS_SIZE = 12

# Layout of the memory array.
INTEGRAL, LAST_VELOCITY, SLOPE = 0, 3, 6
MEMORY_SIZE = 9

_DERIVATIVE_HZ = 5.0
_ATTITUDE_BANDWIDTH_RAD_S = 4.0
"""Attitude and rate loops together answer like a first-order lag of this rate; fitted to the recorded flights."""
_RATE_S = 20.0


@dataclass(frozen=True)
class CascadeGains:
    """Gains as PX4's parameters MPC_XY_P, MPC_XY_VEL_P_ACC and so on name them."""

    position: float
    position_z: float
    velocity: float
    velocity_i: float
    velocity_d: float
    velocity_z: float
    velocity_z_i: float
    velocity_z_d: float
    max_tilt_rad: float

    @classmethod
    def of(cls, parameters: ParameterServer) -> Self:
        """The gains that a vehicle's parameters ask for."""
        return cls(
            position=parameters["MPC_XY_P"],
            position_z=parameters["MPC_Z_P"],
            velocity=parameters["MPC_XY_VEL_P_ACC"],
            velocity_i=parameters["MPC_XY_VEL_I_ACC"],
            velocity_d=parameters["MPC_XY_VEL_D_ACC"],
            velocity_z=parameters["MPC_Z_VEL_P_ACC"],
            velocity_z_i=parameters["MPC_Z_VEL_I_ACC"],
            velocity_z_d=parameters["MPC_Z_VEL_D_ACC"],
            max_tilt_rad=math.radians(parameters["MPC_TILTMAX_AIR"]),
        )

    def packed(self) -> Array:
        """The numbers as the kernel takes them."""
        g = np.empty(GAINS_SIZE)
        g[ENABLED] = 1.0
        g[POSITION_P], g[POSITION_Z_P] = self.position, self.position_z
        g[VELOCITY_P], g[VELOCITY_I], g[VELOCITY_D] = self.velocity, self.velocity_i, self.velocity_d
        g[VELOCITY_Z_P], g[VELOCITY_Z_I], g[VELOCITY_Z_D] = self.velocity_z, self.velocity_z_i, self.velocity_z_d
        g[ATTITUDE_S2], g[RATE_S] = _ATTITUDE_BANDWIDTH_RAD_S * _RATE_S, _RATE_S
        g[TAN_TILT] = math.tan(self.max_tilt_rad)
        return g


@compiled
def settle(state: Array, holding: Array, memory: Array) -> None:
    """Keep the memory as it would be if the cascade had flown so far, so that it takes over without a jerk.

    Args:
        state: of the quadrotor.
        holding: acceleration that the integrators would hold against wind and drag, shape (3,).
        memory: shape (`MEMORY_SIZE`,).
    """
    for i in range(3):
        memory[INTEGRAL + i] = holding[i]
        memory[LAST_VELOCITY + i] = state[3 + i]
        memory[SLOPE + i] = 0.0


@compiled
def cascade(state: Array, wish: Array, limits: Array, gains: Array, memory: Array, dt: float, reference: Array) -> None:
    """One step of the controller.

    Args:
        state: of the quadrotor.
        wish: position, velocity and acceleration of the setpoint, shape (9,).
        limits: largest horizontal speed, climb and descent, m/s, shape (3,).
        gains: packed.
        memory: shape (`MEMORY_SIZE`,).
        dt: length of the step, s.
        reference: receives in its first 12 numbers what the attitude controller is to follow.
    """
    speed = np.empty(3)
    for i in range(3):
        stiffness = gains[POSITION_P] if i < 2 else gains[POSITION_Z_P]
        speed[i] = wish[3 + i] + stiffness * (wish[i] - state[i])
    across = math.sqrt(speed[0] ** 2 + speed[1] ** 2)
    if across > limits[0]:
        speed[0] *= limits[0] / across
        speed[1] *= limits[0] / across
    speed[2] = min(max(speed[2], -limits[2]), limits[1])
    blend = dt / (dt + 1.0 / (2.0 * math.pi * _DERIVATIVE_HZ))
    asked = np.empty(3)
    for i in range(3):
        base = VELOCITY_P if i < 2 else VELOCITY_Z_P
        slope = (state[3 + i] - memory[LAST_VELOCITY + i]) / dt
        memory[LAST_VELOCITY + i] = state[3 + i]
        memory[SLOPE + i] += blend * (slope - memory[SLOPE + i])
        error = speed[i] - state[3 + i]
        asked[i] = wish[6 + i] + gains[base] * error + memory[INTEGRAL + i] - gains[base + 2] * memory[SLOPE + i]
        memory[INTEGRAL + i] += gains[base + 1] * error * dt
        memory[INTEGRAL + i] = min(max(memory[INTEGRAL + i], -GRAVITY_M_S2), GRAVITY_M_S2)
    # The tilt is chosen as if the vehicle kept its height; the thrust then scales the horizontal part along.
    share = max(GRAVITY_M_S2 + asked[2], 0.2 * GRAVITY_M_S2) / GRAVITY_M_S2
    for i in range(3):
        reference[i] = state[i]
        reference[3 + i] = state[3 + i]
        reference[6 + i] = asked[i] * (share if i < 2 else 1.0)
        reference[9 + i] = 0.0
