"""A simulated quadrotor body with its controller: told where to go, it flies there, physically."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gcs.planning.dynamics.geometric_controller import ControllerGains
from gcs.planning.dynamics.quadrotor import GRAVITY_M_S2, QuadrotorParameters, resting_state
from gcs.planning.dynamics.wind_gusts import WindGusts
from sitl_mocks import flight_kernel as kernel
from sitl_mocks.position_cascade import GAINS_SIZE, MEMORY_SIZE, CascadeGains

Array = NDArray[np.float64]

AIR_DENSITY_KG_M3 = 1.225

BODIES = {
    "usual": QuadrotorParameters(),
    "sih": QuadrotorParameters(motor_time_constant_s=0.05, drag_n_s_m=(3.0, 3.0, 3.0)),
}
"""Bodies by name. `sih` has, per unit of mass, the drag and the motors of the simulation that is part of PX4, in which
the recorded flights were flown: 1 N s/m at 1 kg, nine times as much as the usual one."""


@dataclass(frozen=True)
class FlightLimits:
    """What the autopilot allows itself, from its parameters; SI units."""

    horizontal_m_s: float
    climb_m_s: float
    descent_m_s: float
    acceleration_m_s2: float
    vertical_acceleration_m_s2: float
    jerk_m_s3: float
    yaw_rate_rad_s: float = math.radians(60.0)
    clips_setpoints: bool = False
    extrapolates_setpoints: bool = False

    def packed(self) -> Array:
        """The numbers as the kernel takes them."""
        numbers = np.empty(kernel.LIMITS_SIZE)
        numbers[kernel.MAX_HORIZONTAL] = self.horizontal_m_s
        numbers[kernel.MAX_CLIMB] = self.climb_m_s
        numbers[kernel.MAX_DESCENT] = self.descent_m_s
        numbers[kernel.MAX_ACCELERATION] = self.acceleration_m_s2
        numbers[kernel.MAX_VERTICAL_ACCELERATION] = self.vertical_acceleration_m_s2
        numbers[kernel.MAX_JERK] = self.jerk_m_s3
        numbers[kernel.MAX_YAW_RATE] = self.yaw_rate_rad_s
        numbers[kernel.MAX_YAW_ACCELERATION] = 2.5
        numbers[kernel.CLIP_SETPOINT_SPEED] = float(self.clips_setpoints)
        numbers[kernel.EXTRAPOLATE_SETPOINT] = float(self.extrapolates_setpoints)
        return numbers


@dataclass(frozen=True)
class FlightSetpoint:
    """A setpoint of an offboard stream in scene ENU; yaw NaN keeps the yaw (turning at `yaw_rate_rad_s` if finite)."""

    position_m: Array
    velocity_m_s: Array
    acceleration_m_s2: Array
    yaw_rad: float = math.nan
    yaw_rate_rad_s: float = math.nan


class Airframe:
    """Body, motors and controller of one vehicle in scene ENU.

    Args:
        start_m: where it stands; the ground is flat at this height.
        yaw_rad: which way it faces, from east counter-clockwise.
        limits: of the autopilot.
        wind_m_s: velocity of the air in the mean, ENU.
        gust_m_s: standard deviation of its horizontal components.
        seed: of the gusts.
        parameters: physical properties.
        battery_wh: capacity of the battery, full at the start.
        cascade: gains by which setpoints are flown as autopilots fly them; the geometric controller does when None.
            Its limit of the tilt counts for everything that is flown.
    """

    def __init__(
        self,
        start_m: ArrayLike,
        limits: FlightLimits,
        *,
        yaw_rad: float = math.pi / 2,
        wind_m_s: tuple[float, float, float] = (0.0, 0.0, 0.0),
        gust_m_s: float = 0.0,
        seed: int = 0,
        parameters: QuadrotorParameters | None = None,
        battery_wh: float = 130.0,
        cascade: CascadeGains | None = None,
    ) -> None:
        self.parameters = parameters or QuadrotorParameters()
        self.battery = Battery(battery_wh, self.parameters)
        self.start_m = np.array(start_m, dtype=np.float64)
        self.ground_m = float(self.start_m[2])
        self.state = resting_state(self.start_m, yaw_rad)
        self._guidance = np.zeros(kernel.GUIDANCE_SIZE)
        self._guidance[kernel.YAW] = yaw_rad
        self._gusts = WindGusts(wind_m_s, gust_m_s)
        self._mean_wind = np.array(wind_m_s, dtype=np.float64)
        self._rng = np.random.default_rng(seed)
        self._wind = self._gusts.first(self._rng)
        self._packed = self.parameters.packed()
        self._gains = ControllerGains().packed()
        self._cascade = np.zeros(GAINS_SIZE)
        if cascade is not None:
            self.set_cascade(cascade)
        self._memory = np.zeros(MEMORY_SIZE)
        self._limits = limits.packed()
        self.limits = limits
        self._error_m = np.zeros(3)
        self._error_m_s = np.zeros(3)

    def believe(self, error_m: Array, error_m_s: Array) -> None:
        """Be wrong about position and velocity by so much from now on; where it truly is stays as it is.

        All that flies the vehicle, and all that it tells, follows what it believes.
        """
        self.state[0:3] += error_m - self._error_m
        self.state[3:6] += error_m_s - self._error_m_s
        self._error_m, self._error_m_s = error_m.copy(), error_m_s.copy()

    def set_limits(self, limits: FlightLimits) -> None:
        """Fly within other limits from now on."""
        if limits != self.limits:
            self.limits = limits
            self._limits = limits.packed()

    def set_cascade(self, cascade: CascadeGains) -> None:
        """Fly setpoints with other gains from now on, and lean no further than they say."""
        self._cascade = cascade.packed()
        self._gains = ControllerGains(max_tilt_rad=cascade.max_tilt_rad).packed()

    @property
    def position_m(self) -> Array:
        """Position as the vehicle believes, scene ENU; the true one unless `believe` says otherwise."""
        return self.state[0:3].copy()

    @property
    def velocity_m_s(self) -> Array:
        """Velocity as the vehicle believes, ENU."""
        return self.state[3:6].copy()

    @property
    def true_position_m(self) -> Array:
        """Position, scene ENU."""
        return self.state[0:3] - self._error_m

    @property
    def true_velocity_m_s(self) -> Array:
        """Velocity, ENU."""
        return self.state[3:6] - self._error_m_s

    @property
    def yaw_rad(self) -> float:
        """True yaw, from east counter-clockwise."""
        w, x, y, z = (float(c) for c in self.state[6:10])
        return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))

    @property
    def roll_pitch_rad(self) -> tuple[float, float]:
        """Roll and pitch as aircraft count them: right side down and nose up are positive."""
        w, x, y, z = (float(c) for c in self.state[6:10])
        roll = math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
        pitch = -math.asin(max(-1.0, min(1.0, 2.0 * (w * y - z * x))))
        return roll, pitch

    @property
    def asked_roll_pitch_yaw_rad(self) -> tuple[float, float, float] | None:
        """Attitude that the position controller wants; roll and pitch as above. None with idle motors."""
        force = self._guidance[kernel.ASKED_FORCE : kernel.ASKED_FORCE + 3]
        if not self.running or not force[2] > 0.0:
            return None
        east, north, up = (float(c) for c in force / np.linalg.norm(force))
        yaw = float(self._guidance[kernel.YAW])
        forward, right = (
            east * math.cos(yaw) + north * math.sin(yaw),
            east * math.sin(yaw) - north * math.cos(yaw),
        )
        return math.asin(right), math.atan2(-forward, up), yaw

    @property
    def height_m(self) -> float:
        """True height above the ground."""
        return float(self.state[2] - self._error_m[2]) - self.ground_m

    @property
    def on_ground(self) -> bool:
        """Whether it touches the ground."""
        return self.height_m <= 0.005

    @property
    def target_m(self) -> Array:
        """Where the governor leads it."""
        return self._guidance[kernel.TARGET : kernel.TARGET + 3].copy()

    @property
    def reference_m(self) -> Array:
        """Where the controller is told to be now, without a detour."""
        return self._guidance[kernel.POSITION : kernel.POSITION + 3].copy()

    @property
    def reference_velocity_m_s(self) -> Array:
        """Velocity of the reference, without a detour."""
        return self._guidance[kernel.VELOCITY : kernel.VELOCITY + 3].copy()

    @property
    def running(self) -> bool:
        """Whether the motors are under control."""
        return bool(self._guidance[kernel.SOURCE] != kernel.SOURCE_NONE)

    def cut_motors(self) -> None:
        """Stop the motors."""
        self._guidance[kernel.SOURCE] = kernel.SOURCE_NONE
        self.end_detour()

    def go_to(self, target_m: ArrayLike, yaw_rad: float | None = None) -> None:
        """Lead the reference to a point, from wherever it is.

        Args:
            target_m: scene ENU.
            yaw_rad: yaw to turn to on the way; None keeps the present target.
        """
        self._enter_governor()
        self._guidance[kernel.TARGET : kernel.TARGET + 3] = target_m
        if yaw_rad is not None:
            self._guidance[kernel.TARGET_YAW] = yaw_rad

    def turn_to(self, yaw_rad: float) -> None:
        """Turn without changing the target point."""
        self._guidance[kernel.TARGET_YAW] = yaw_rad

    def stop(self) -> None:
        """Brake and stay where the braking ends."""
        self._enter_governor()
        velocity = self.reference_velocity_m_s
        speed = float(np.linalg.norm(velocity))
        brake = kernel.BRAKING_SHARE * min(self.limits.acceleration_m_s2, self.limits.vertical_acceleration_m_s2)
        reach = speed / (2.0 * brake) + 0.35
        self._guidance[kernel.TARGET : kernel.TARGET + 3] = self.reference_m + velocity * reach
        self._guidance[kernel.TARGET_YAW] = self._guidance[kernel.YAW]

    def braking_way_m(self, speed_m_s: float, direction: Array) -> float:
        """How far before its target the governor begins to brake from a speed."""
        across, up = math.hypot(direction[0], direction[1]), abs(float(direction[2]))
        brake = kernel.BRAKING_SHARE * min(
            self.limits.acceleration_m_s2 / max(across, 1e-9),
            self.limits.vertical_acceleration_m_s2 / max(up, 1e-9),
        )
        way = speed_m_s**2 / (2.0 * brake) + speed_m_s * brake / (2.0 * self.limits.jerk_m_s3)
        return max(way, speed_m_s / kernel.POSITION_GAIN)

    def follow(self, setpoint: FlightSetpoint) -> None:
        """Take the reference from a stream of setpoints."""
        g = self._guidance
        g[kernel.SOURCE] = kernel.SOURCE_SETPOINT
        g[kernel.SETPOINT_AGE] = 0.0
        g[kernel.SETPOINT_POSITION : kernel.SETPOINT_POSITION + 3] = setpoint.position_m
        g[kernel.SETPOINT_VELOCITY : kernel.SETPOINT_VELOCITY + 3] = setpoint.velocity_m_s
        g[kernel.SETPOINT_ACCELERATION : kernel.SETPOINT_ACCELERATION + 3] = setpoint.acceleration_m_s2
        g[kernel.SETPOINT_YAW] = setpoint.yaw_rad
        g[kernel.SETPOINT_YAW_RATE] = setpoint.yaw_rate_rad_s

    def begin_detour(self, height_m: float, rise_s: float) -> None:
        """Start to rise above the reference."""
        self._guidance[kernel.DETOUR_PHASE] = kernel.DETOUR_RISING
        self._guidance[kernel.DETOUR_TIME] = 0.0
        self._guidance[kernel.DETOUR_HEIGHT] = height_m
        self._guidance[kernel.DETOUR_RISE_S] = rise_s

    def level_detour(self) -> None:
        """Stay above the reference."""
        self._guidance[kernel.DETOUR_PHASE] = kernel.DETOUR_HOLDING

    def leave_detour(self) -> None:
        """Start to come back to the reference."""
        self._guidance[kernel.DETOUR_PHASE] = kernel.DETOUR_FALLING
        self._guidance[kernel.DETOUR_TIME] = 0.0

    def end_detour(self) -> None:
        """Be back on the reference."""
        self._guidance[kernel.DETOUR_PHASE] = kernel.DETOUR_OFF

    def step(self, steps: int) -> None:
        """Let `steps * STEP_S` of simulated time pass; the wind stays as it is meanwhile."""
        if self._gusts.deviation_m_s > 0.0:
            self._wind = self._gusts.after(self._wind, steps * kernel.STEP_S, self._rng)
        effort = kernel.fly(
            steps,
            self.state,
            self._guidance,
            self._limits,
            self._wind + self._error_m_s,  # the air drags on what truly moves
            self._mean_wind,
            self.ground_m + self._error_m[2],
            self._packed,
            self._gains,
            self._cascade,
            self._memory,
        )
        self._error_m = self._error_m + self._error_m_s * (steps * kernel.STEP_S)
        self.battery.use(effort, steps * kernel.STEP_S)

    def _enter_governor(self) -> None:
        g = self._guidance
        if g[kernel.SOURCE] == kernel.SOURCE_GOVERNOR:
            return
        g[kernel.SOURCE] = kernel.SOURCE_GOVERNOR
        g[kernel.POSITION : kernel.POSITION + 3] = self.state[0:3]
        g[kernel.VELOCITY : kernel.VELOCITY + 3] = self.state[3:6]
        g[kernel.ACCELERATION : kernel.ACCELERATION + 3] = 0.0
        g[kernel.TARGET : kernel.TARGET + 3] = self.state[0:3]
        g[kernel.YAW] = self.yaw_rad
        g[kernel.YAW_RATE] = 0.0
        g[kernel.TARGET_YAW] = self.yaw_rad


class Battery:
    """Energy used by ideal rotors over a figure of merit, plus avionics.

    Momentum theory: a rotor of disc area A needs `T^1.5 / sqrt(2 rho A)` at thrust T.

    Args:
        capacity_wh: when full.
        parameters: of the quadrotor; its arm tells how large its rotors can be.
    """

    CELLS = 6
    AVIONICS_W = 15.0
    FIGURE_OF_MERIT = 0.6

    def __init__(self, capacity_wh: float, parameters: QuadrotorParameters) -> None:
        self.capacity_wh = capacity_wh
        self.used_wh = 0.0
        self.power_w = self.AVIONICS_W
        radius = 0.6 * parameters.arm_m
        self._per_effort = 1.0 / math.sqrt(2.0 * AIR_DENSITY_KG_M3 * math.pi * radius**2) / self.FIGURE_OF_MERIT

    @property
    def remaining(self) -> float:
        """Share left, 0 to 1."""
        return max(0.0, 1.0 - self.used_wh / self.capacity_wh)

    @property
    def voltage_v(self) -> float:
        """Pack voltage: 4.2 V a cell when full, 3.5 V when empty."""
        return self.CELLS * (3.5 + 0.7 * self.remaining)

    @property
    def current_a(self) -> float:
        """Present current."""
        return self.power_w / self.voltage_v

    def use(self, effort: float, seconds: float) -> None:
        """Take out what the motors and the avionics needed.

        Args:
            effort: integral of the sum of `thrust**1.5` of the motors, N^1.5 s.
            seconds: how long.
        """
        energy_j = effort * self._per_effort + self.AVIONICS_W * seconds
        self.power_w = energy_j / seconds
        self.used_wh += energy_j / 3600.0

    def hover_power_w(self, parameters: QuadrotorParameters) -> float:
        """What hovering needs, W."""
        per_motor = parameters.mass_kg * GRAVITY_M_S2 / 4.0
        return float(4.0 * per_motor**1.5 * self._per_effort + self.AVIONICS_W)
