"""The parameters of the PX4-like vehicle: names and types of the real ones.

Values are PX4's defaults except where a comment says otherwise. Failsafes are on, and the limits let the vehicle fly
5 m/s in every direction with 4 m/s^2 or more.
"""

from __future__ import annotations

from sitl_mocks.parameters import INT32, REAL32

PX4_PARAMETERS: dict[str, tuple[float, int]] = {
    "BAT1_CAPACITY": (5850.0, REAL32),
    "BAT1_N_CELLS": (6, INT32),
    "BAT_CRIT_THR": (0.07, REAL32),
    "BAT_EMERGEN_THR": (0.05, REAL32),
    "BAT_LOW_THR": (0.15, REAL32),
    "COM_ARM_WO_GPS": (1, INT32),
    # Loiter instead of the position mode of the default, which without sticks sinks to the ground.
    "COM_OBL_RC_ACT": (5, INT32),
    "COM_OF_LOSS_T": (1.0, REAL32),
    # 10 s on the real one; a station that is started again within half a minute finds its mission still flying.
    "COM_DL_LOSS_T": (30, INT32),
    "COM_FAIL_ACT_T": (5.0, REAL32),
    "COM_DISARM_LAND": (2.0, REAL32),
    "COM_DLL_EXCEPT": (0, INT32),
    "COM_FLTMODE1": (-1, INT32),
    "COM_LOW_BAT_ACT": (3, INT32),  # return when critical, land when empty; 0 (a warning) on the real one
    "COM_RCL_EXCEPT": (0, INT32),
    "COM_RC_IN_MODE": (3, INT32),
    "COM_RC_LOSS_T": (0.5, REAL32),
    "EKF2_EVP_NOISE": (0.1, REAL32),
    "EKF2_EV_CTRL": (15, INT32),
    "EKF2_EV_DELAY": (0.0, REAL32),
    "EKF2_NOAID_TOUT": (5_000_000, INT32),
    "GF_ACTION": (3, INT32),  # return; 2 (hold) on the real one
    "GF_MAX_HOR_DIST": (1000.0, REAL32),  # 0 (no limit) on the real one
    "GF_MAX_VER_DIST": (150.0, REAL32),  # 0 (no limit) on the real one
    "MAV_SYS_ID": (1, INT32),
    "MAV_TYPE": (2, INT32),
    "MIS_DIST_1WP": (10000.0, REAL32),
    "MIS_TAKEOFF_ALT": (2.5, REAL32),
    "MIS_YAW_ERR": (12.0, REAL32),
    "MIS_YAW_TMT": (-1.0, REAL32),
    "MPC_ACC_DOWN_MAX": (4.0, REAL32),  # 3 on the real one
    "MPC_ACC_HOR": (4.0, REAL32),  # 3 on the real one
    "MPC_ACC_HOR_MAX": (5.0, REAL32),
    "MPC_ACC_UP_MAX": (4.0, REAL32),
    "MPC_JERK_AUTO": (10.0, REAL32),  # 4 on the real one
    "MPC_JERK_MAX": (15.0, REAL32),  # 8 on the real one
    "MPC_LAND_ALT1": (10.0, REAL32),
    "MPC_LAND_ALT2": (5.0, REAL32),
    "MPC_LAND_SPEED": (0.7, REAL32),
    "MPC_TILTMAX_AIR": (45.0, REAL32),
    "MPC_TKO_SPEED": (2.0, REAL32),  # 1.5 on the real one
    "MPC_XY_CRUISE": (5.0, REAL32),
    "MPC_XY_P": (0.95, REAL32),
    "MPC_XY_VEL_D_ACC": (0.2, REAL32),
    "MPC_XY_VEL_I_ACC": (0.4, REAL32),
    "MPC_XY_VEL_MAX": (12.0, REAL32),
    "MPC_XY_VEL_P_ACC": (1.8, REAL32),
    "MPC_YAWRAUTO_MAX": (60.0, REAL32),
    "MPC_YAW_MODE": (0, INT32),
    "MPC_Z_P": (1.0, REAL32),
    "MPC_Z_VEL_D_ACC": (0.0, REAL32),
    "MPC_Z_VEL_I_ACC": (2.0, REAL32),
    "MPC_Z_VEL_MAX_DN": (5.0, REAL32),  # 1.5 on the real one
    "MPC_Z_VEL_MAX_UP": (5.0, REAL32),  # 3 on the real one
    "MPC_Z_VEL_P_ACC": (4.0, REAL32),
    "MPC_Z_V_AUTO_DN": (5.0, REAL32),  # 1.5 on the real one
    "MPC_Z_V_AUTO_UP": (5.0, REAL32),  # 3 on the real one
    "NAV_ACC_RAD": (2.0, REAL32),
    "NAV_DLL_ACT": (2, INT32),  # return; 0 (off) on the real one
    "NAV_MC_ALT_RAD": (0.8, REAL32),
    "NAV_RCL_ACT": (2, INT32),
    "RTL_CONE_ANG": (45, INT32),
    "RTL_DESCEND_ALT": (30.0, REAL32),
    "RTL_LAND_DELAY": (0.0, REAL32),
    "RTL_MIN_DIST": (10.0, REAL32),
    "RTL_RETURN_ALT": (30.0, REAL32),
    "RTL_TYPE": (0, INT32),
    "SYS_AUTOSTART": (4001, INT32),
    "TRIG_MODE": (0, INT32),
}

PX4_AT_MOST = {
    "MPC_XY_CRUISE": "MPC_XY_VEL_MAX",
    "MPC_Z_V_AUTO_DN": "MPC_Z_VEL_MAX_DN",
    "MPC_Z_V_AUTO_UP": "MPC_Z_VEL_MAX_UP",
}
"""Speeds of the auto modes that PX4 clamps, with a warning, to what the vehicle may fly at all."""
