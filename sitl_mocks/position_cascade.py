"""Both autopilots' position control: position errors ask for speed, speed errors for acceleration, that for tilt.

`v = v_setpoint + P_x (x_setpoint - x)`, then `a = a_setpoint + P_v (v - v_now) + I integral(v - v_now) - D d/dt v_now`,
the derivative behind a low-pass filter; the tilt follows the horizontal part alone. PX4 bounds v; ArduPilot only what
the position adds to it, and takes the derivative of `v_now - v`. What a setpoint does not ask for in advance, drag
above all, has to build up as an error first: that is what makes the real ones late and cut corners. With PX4's default
parameters, drag and attitude bandwidth as below it flies as the recorded PX4 does.
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
DERIVATIVE_OF_ERROR = 12
GAINS_SIZE = 13

# Layout of the memory array.
INTEGRAL, LAST, SLOPE = 0, 3, 6
MEMORY_SIZE = 9

_DERIVATIVE_HZ = 5.0
_ATTITUDE_BANDWIDTH_RAD_S = 4.0
"""Attitude and rate loops together answer like a first-order lag of this rate; fitted to the recorded flights."""
_RATE_S = 20.0
_LEAST_INPUT_TIME_S = 0.05


@dataclass(frozen=True)
class CascadeGains:
    """Gains as MPC_XY_P, MPC_XY_VEL_P_ACC, ... of PX4 and PSC_POSXY_P, PSC_VELXY_P, ... of ArduPilot name them.

    Attributes:
        derivative_of_error: whether the derivative is that of the speed's error (ArduPilot), not of the speed.
        attitude_s2: stiffness of the attitude loop over the moment of inertia.
    """

    position: float
    position_z: float
    velocity: float
    velocity_i: float
    velocity_d: float
    velocity_z: float
    velocity_z_i: float
    velocity_z_d: float
    max_tilt_rad: float
    derivative_of_error: bool = False
    attitude_s2: float = _ATTITUDE_BANDWIDTH_RAD_S * _RATE_S

    @classmethod
    def of_px4(cls, parameters: ParameterServer) -> Self:
        """The gains that PX4's parameters ask for."""
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

    @classmethod
    def of_ardupilot(cls, parameters: ParameterServer) -> Self:
        """The gains that ArduPilot's parameters ask for; it leans in a time of ATC_INPUT_TC."""
        tilt_deg = parameters["PSC_ANGLE_MAX"] or parameters["ANGLE_MAX"] * 0.01
        return cls(
            position=parameters["PSC_POSXY_P"],
            position_z=parameters["PSC_POSZ_P"],
            velocity=parameters["PSC_VELXY_P"],
            velocity_i=parameters["PSC_VELXY_I"],
            velocity_d=parameters["PSC_VELXY_D"],
            velocity_z=parameters["PSC_VELZ_P"],
            velocity_z_i=0.0,
            velocity_z_d=0.0,
            max_tilt_rad=math.radians(tilt_deg),
            derivative_of_error=True,
            attitude_s2=_RATE_S / max(parameters["ATC_INPUT_TC"], _LEAST_INPUT_TIME_S),
        )

    def packed(self) -> Array:
        """The numbers as the kernel takes them."""
        g = np.empty(GAINS_SIZE)
        g[ENABLED] = 1.0
        g[POSITION_P], g[POSITION_Z_P] = self.position, self.position_z
        g[VELOCITY_P], g[VELOCITY_I], g[VELOCITY_D] = self.velocity, self.velocity_i, self.velocity_d
        g[VELOCITY_Z_P], g[VELOCITY_Z_I], g[VELOCITY_Z_D] = self.velocity_z, self.velocity_z_i, self.velocity_z_d
        g[ATTITUDE_S2], g[RATE_S] = self.attitude_s2, _RATE_S
        g[TAN_TILT] = math.tan(self.max_tilt_rad)
        g[DERIVATIVE_OF_ERROR] = float(self.derivative_of_error)
        return g


@compiled
def settle(state: Array, wish: Array, gains: Array, holding: Array, memory: Array) -> None:
    """Keep the memory as it would be if the cascade had flown so far, so that it takes over without a jerk.

    Args:
        state: of the quadrotor.
        wish: position, velocity and acceleration of the setpoint, shape (9,).
        gains: packed.
        holding: acceleration that the integrators would hold against wind and drag, shape (3,).
        memory: shape (`MEMORY_SIZE`,).
    """
    for i in range(3):
        memory[INTEGRAL + i] = holding[i]
        memory[LAST + i] = state[3 + i] - gains[DERIVATIVE_OF_ERROR] * wish[3 + i]
        memory[SLOPE + i] = 0.0


@compiled
def cascade(
    state: Array, wish: Array, limits: Array, clips: bool, gains: Array, memory: Array, dt: float, reference: Array
) -> None:
    """One step of the controller.

    Args:
        state: of the quadrotor.
        wish: position, velocity and acceleration of the setpoint, shape (9,).
        limits: largest horizontal speed, climb and descent, m/s, shape (3,).
        clips: whether the speed that is asked for is held to the limits.
        gains: packed.
        memory: shape (`MEMORY_SIZE`,).
        dt: length of the step, s.
        reference: receives in its first 12 numbers what the attitude controller is to follow.
    """
    speed, correction = np.empty(3), np.empty(3)
    for i in range(3):
        stiffness = gains[POSITION_P] if i < 2 else gains[POSITION_Z_P]
        correction[i] = stiffness * (wish[i] - state[i])
    if not clips:
        across = math.sqrt(correction[0] ** 2 + correction[1] ** 2)
        if across > limits[0]:
            correction[0] *= limits[0] / across
            correction[1] *= limits[0] / across
        correction[2] = min(max(correction[2], -limits[2]), limits[1])
    for i in range(3):
        speed[i] = wish[3 + i] + correction[i]
    if clips:
        across = math.sqrt(speed[0] ** 2 + speed[1] ** 2)
        if across > limits[0]:
            speed[0] *= limits[0] / across
            speed[1] *= limits[0] / across
        speed[2] = min(max(speed[2], -limits[2]), limits[1])
    blend = dt / (dt + 1.0 / (2.0 * math.pi * _DERIVATIVE_HZ))
    asked, error = np.empty(3), np.empty(3)
    for i in range(3):
        base = VELOCITY_P if i < 2 else VELOCITY_Z_P
        followed = state[3 + i] - gains[DERIVATIVE_OF_ERROR] * speed[i]
        slope = (followed - memory[LAST + i]) / dt
        memory[LAST + i] = followed
        memory[SLOPE + i] += blend * (slope - memory[SLOPE + i])
        error[i] = speed[i] - state[3 + i]
        asked[i] = wish[6 + i] + gains[base] * error[i] + memory[INTEGRAL + i] - gains[base + 2] * memory[SLOPE + i]
    # No integrator fills up while more is asked for than the tilt can give.
    gives_all = math.hypot(asked[0], asked[1]) > gains[TAN_TILT] * GRAVITY_M_S2
    for i in range(3):
        if i == 2 or not gives_all:
            grown = memory[INTEGRAL + i] + gains[VELOCITY_I if i < 2 else VELOCITY_Z_I] * error[i] * dt
            memory[INTEGRAL + i] = min(max(grown, -GRAVITY_M_S2), GRAVITY_M_S2)
    # The tilt is chosen as if the vehicle kept its height; the thrust then scales the horizontal part along.
    share = max(GRAVITY_M_S2 + asked[2], 0.2 * GRAVITY_M_S2) / GRAVITY_M_S2
    for i in range(3):
        reference[i] = state[i]
        reference[3 + i] = state[3 + i]
        reference[6 + i] = asked[i] * (share if i < 2 else 1.0)
        reference[9 + i] = 0.0
