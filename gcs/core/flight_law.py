"""The settings of an autopilot that decide how it flies a mission or follows setpoints.

The defaults are those of the autopilots' own documentation (ArduCopter 4.7, PX4 1.16); whoever reads a vehicle's
parameters replaces them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class ArduPilotLaw:
    """What ArduCopter's waypoint and position controllers are set to, in SI units.

    Attributes:
        speed_m_s: WPNAV_SPEED; a DO_CHANGE_SPEED item takes its place, as for the next two.
        climb_m_s: WPNAV_SPEED_UP.
        descent_m_s: WPNAV_SPEED_DN.
        acceleration_m_s2: WPNAV_ACCEL.
        vertical_acceleration_m_s2: WPNAV_ACCEL_Z.
        corner_acceleration_m_s2: WPNAV_ACCEL_C; 0 stands for twice WPNAV_ACCEL.
        jerk_m_s3: WPNAV_JERK, along each leg of a mission.
        radius_m: WPNAV_RADIUS, how near to a waypoint a turn must pass.
        input_time_s: ATC_INPUT_TC, over which leaning is smoothed; it bounds the snap.
        stream_jerk_m_s3: PSC_JERK_XY, with which setpoints are shaped.
        stream_vertical_jerk_m_s3: PSC_JERK_Z.
        position_gain_s: PSC_POSXY_P.
        velocity_gains_s: proportional (1/s), integral (1/s^2) and derivative gain of PSC_VELXY.
        vertical_position_gain_s: PSC_POSZ_P.
        vertical_velocity_gain_s: PSC_VELZ_P; what PSC_ACCZ adds is quicker than anything here.
        max_tilt_rad: PSC_ANGLE_MAX, or ANGLE_MAX where that is 0.
        landing_speed_m_s: LAND_SPEED, below 10 m above home.
    """

    speed_m_s: float = 10.0
    climb_m_s: float = 2.5
    descent_m_s: float = 1.5
    acceleration_m_s2: float = 2.5
    vertical_acceleration_m_s2: float = 1.0
    corner_acceleration_m_s2: float = 0.0
    jerk_m_s3: float = 1.0
    radius_m: float = 2.0
    input_time_s: float = 0.15
    stream_jerk_m_s3: float = 5.0
    stream_vertical_jerk_m_s3: float = 5.0
    position_gain_s: float = 1.0
    velocity_gains_s: tuple[float, float, float] = (2.0, 1.0, 0.5)
    vertical_position_gain_s: float = 1.0
    vertical_velocity_gain_s: float = 5.0
    max_tilt_rad: float = math.radians(30.0)
    landing_speed_m_s: float = 0.5


@dataclass(frozen=True)
class Px4Law:
    """What PX4's multicopter controllers are set to, in SI units.

    Attributes:
        cruise_m_s: MPC_XY_CRUISE; a DO_CHANGE_SPEED item takes its place.
        max_speed_m_s: MPC_XY_VEL_MAX.
        climb_m_s: MPC_Z_V_AUTO_UP, in missions.
        descent_m_s: MPC_Z_V_AUTO_DN, in missions.
        max_climb_m_s: MPC_Z_VEL_MAX_UP, which bounds what any setpoint can ask for.
        max_descent_m_s: MPC_Z_VEL_MAX_DN.
        acceleration_m_s2: MPC_ACC_HOR.
        climb_acceleration_m_s2: MPC_ACC_UP_MAX.
        descent_acceleration_m_s2: MPC_ACC_DOWN_MAX.
        jerk_m_s3: MPC_JERK_AUTO.
        turn_gain: MPC_XY_TRAJ_P, the share of the acceleration that a turn at a waypoint may take.
        max_lag_m: MPC_XY_ERR_MAX, the horizontal error at which the trajectory waits for the vehicle.
        radius_m: NAV_ACC_RAD, for waypoints that name none.
        height_radius_m: NAV_MC_ALT_RAD.
        position_gain_s: MPC_XY_P.
        velocity_gains_s: MPC_XY_VEL_P_ACC (1/s), ..._I_ACC (1/s^2) and ..._D_ACC.
        vertical_position_gain_s: MPC_Z_P.
        vertical_velocity_gains_s: MPC_Z_VEL_P_ACC, ..._I_ACC and ..._D_ACC.
        max_tilt_rad: MPC_TILTMAX_AIR.
        landing_speed_m_s: MPC_LAND_SPEED, below 5 m above home.
    """

    cruise_m_s: float = 5.0
    max_speed_m_s: float = 12.0
    climb_m_s: float = 3.0
    descent_m_s: float = 1.5
    max_climb_m_s: float = 3.0
    max_descent_m_s: float = 1.5
    acceleration_m_s2: float = 3.0
    climb_acceleration_m_s2: float = 4.0
    descent_acceleration_m_s2: float = 3.0
    jerk_m_s3: float = 4.0
    turn_gain: float = 0.5
    max_lag_m: float = 2.0
    radius_m: float = 2.0
    height_radius_m: float = 0.8
    position_gain_s: float = 0.95
    velocity_gains_s: tuple[float, float, float] = (1.8, 0.4, 0.2)
    vertical_position_gain_s: float = 1.0
    vertical_velocity_gains_s: tuple[float, float, float] = (4.0, 2.0, 0.0)
    max_tilt_rad: float = math.radians(45.0)
    landing_speed_m_s: float = 0.7


FlightLaw = ArduPilotLaw | Px4Law
"""The law of either autopilot."""


@dataclass(frozen=True)
class Airframe:
    """What no parameter tells of a vehicle, but its flights do.

    The defaults are in the middle of what small quadrotors show; a steady tilt of 10 degrees at 5 m/s is 0.35 1/s.

    Attributes:
        drag_1_s: deceleration by the air per speed through it.
        tilt_lag_s: time constant of each of the two first-order lags between a commanded and a real acceleration across
            the vertical (leaning, and the motors).
    """

    drag_1_s: float = 0.35
    tilt_lag_s: float = 0.1
