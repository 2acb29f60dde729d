"""The parameters of the ArduPilot-like vehicle: names and types of the real ones.

Values are ArduCopter's defaults except where a comment says otherwise. Failsafes are on, and the limits let the vehicle
fly 5 m/s in every direction with 3.5 m/s^2 or more.
"""

from __future__ import annotations

from sitl_mocks.parameters import INT8, INT16, INT32, REAL32

ARDUPILOT_PARAMETERS: dict[str, tuple[float, int]] = {
    "ANGLE_MAX": (3000, INT16),
    "ARMING_CHECK": (1, INT32),
    "ATC_INPUT_TC": (0.15, REAL32),
    "BRD_SD_MISSION": (0, INT16),
    "BATT_CAPACITY": (5850, INT32),
    "BATT_CRT_MAH": (400, REAL32),  # 0 (off) on the real one
    "BATT_FS_CRT_ACT": (1, INT8),  # land; 0 (off) on the real one
    "BATT_FS_LOW_ACT": (2, INT8),  # return; 0 (off) on the real one
    "BATT_LOW_MAH": (880, REAL32),  # 0 (off) on the real one
    "BATT_LOW_VOLT": (10.5, REAL32),
    "CAM1_TYPE": (5, INT8),  # a MAVLink camera; 0 (none) on the real one
    "EK3_POSNE_M_NSE": (0.5, REAL32),
    "EK3_SRC1_POSZ": (1, INT8),
    "EK3_SRC1_VELXY": (3, INT8),
    "EK3_VELNE_M_NSE": (0.3, REAL32),
    "FENCE_ACTION": (1, INT8),
    "FENCE_ALT_MAX": (150.0, REAL32),  # 100 on the real one
    "FENCE_ENABLE": (1, INT8),  # 0 (off) on the real one
    "FENCE_RADIUS": (1000.0, REAL32),  # 300 on the real one
    "FENCE_OPTIONS": (1, INT16),
    "FENCE_TYPE": (7, INT8),
    "FS_EKF_ACTION": (1, INT8),
    "FS_GCS_ENABLE": (1, INT8),  # return; 0 (off) on the real one
    # 5 s on the real one; a station that is started again within half a minute finds its vehicle still flying.
    "FS_GCS_TIMEOUT": (30.0, REAL32),
    # Bits: 2 a mission goes on without a ground station, 16 pilot modes (and BRAKE) too; 16 on the real one.
    "FS_OPTIONS": (18, INT32),
    "FS_THR_ENABLE": (1, INT8),
    "GPS2_DELAY_MS": (0, INT16),
    "GPS2_TYPE": (0, INT8),
    "GPS_AUTO_SWITCH": (1, INT8),
    "GUID_OPTIONS": (0, INT32),
    "GUID_TIMEOUT": (3.0, REAL32),
    "LAND_ALT_LOW": (1000.0, REAL32),
    "LAND_SPEED": (50, INT16),
    "LAND_SPEED_HIGH": (0, INT16),
    "MIS_OPTIONS": (0, INT16),
    "MIS_RESTART": (0, INT8),
    "MIS_TOTAL": (0, INT16),
    "MNT1_TYPE": (6, INT8),  # a MAVLink gimbal; 0 (none) on the real one
    "PILOT_TKOFF_ALT": (0.0, REAL32),
    "PSC_ANGLE_MAX": (0.0, REAL32),
    "PSC_JERK_XY": (10.0, REAL32),  # 5 on the real one
    "PSC_JERK_Z": (10.0, REAL32),  # 5 on the real one
    "PSC_POSXY_P": (1.0, REAL32),
    "PSC_POSZ_P": (1.0, REAL32),
    "PSC_VELXY_D": (0.5, REAL32),
    "PSC_VELXY_I": (1.0, REAL32),
    "PSC_VELXY_P": (2.0, REAL32),
    "PSC_VELZ_P": (5.0, REAL32),
    "RTL_ALT": (1500, INT32),
    "RTL_ALT_FINAL": (0, INT16),
    "RTL_CLIMB_MIN": (0, INT16),
    "RTL_CONE_SLOPE": (3.0, REAL32),
    "RTL_LOIT_TIME": (5000, INT32),
    "RTL_SPEED": (0, INT16),
    "SRTL_ACCURACY": (2.0, REAL32),
    "SRTL_POINTS": (300, INT16),
    "SYSID_MYGCS": (255, INT16),
    "SYSID_THISMAV": (1, INT16),
    "WPNAV_ACCEL": (400.0, REAL32),  # 250 on the real one
    "WPNAV_ACCEL_C": (0.0, REAL32),
    "WPNAV_ACCEL_Z": (350.0, REAL32),  # 100 on the real one
    "WPNAV_JERK": (10.0, REAL32),  # 1 on the real one
    "WPNAV_RADIUS": (200.0, REAL32),
    "WPNAV_SPEED": (1000.0, REAL32),
    "WPNAV_SPEED_DN": (500.0, REAL32),  # 150 on the real one
    "WPNAV_SPEED_UP": (500.0, REAL32),  # 250 on the real one
    "WP_YAW_BEHAVIOR": (2, INT8),
}

_SD_ITEM_BYTES = 15


def mission_room(sd_card_kb: float) -> int:
    """How many items a mission may have with so much room on the card (BRD_SD_MISSION); 0 for the board's own room."""
    return max(int(sd_card_kb) * 1024 // _SD_ITEM_BYTES - 1, 0)
