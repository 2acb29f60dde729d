"""Telemetry messages of both vehicles, made from the simulated truth and a little seeded sensor noise."""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.frames import heading_from_yaw, ned_from_enu
from sitl_mocks.dialect import Message, mavlink
from sitl_mocks.plan_id import MissionCurrentWithIds
from sitl_mocks.positioning import OWN_FIX_M
from sitl_mocks.scene_frame import e7

if TYPE_CHECKING:
    from sitl_mocks.vehicle import SimulatedVehicle

PREARM = int(mavlink.MAV_SYS_STATUS_PREARM_CHECK)
_SENSORS = 0x0020_002F
"""Gyroscope, accelerometer, compass, barometer, GPS, motor outputs."""


class Telemetry:
    """Builds messages by id.

    Args:
        vehicle: whose telemetry it is.
        seed: of the sensor noise.
        position_noise_m: standard deviation of each component of a reported position.
    """

    def __init__(self, vehicle: SimulatedVehicle, seed: int, position_noise_m: float = 0.01) -> None:
        self._vehicle = vehicle
        self._noise = random.Random(seed)
        self._position_noise_m = position_noise_m
        m = mavlink
        self._builders: dict[int, Callable[[], Message | None]] = {
            m.MAVLINK_MSG_ID_SYS_STATUS: self._sys_status,
            m.MAVLINK_MSG_ID_SYSTEM_TIME: self._system_time,
            m.MAVLINK_MSG_ID_GPS_RAW_INT: self._gps_raw_int,
            m.MAVLINK_MSG_ID_ATTITUDE: self._attitude,
            m.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: self._attitude_quaternion,
            m.MAVLINK_MSG_ID_ATTITUDE_TARGET: self._attitude_target,
            m.MAVLINK_MSG_ID_LOCAL_POSITION_NED: self._local_position_ned,
            m.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: self._global_position_int,
            m.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN: self._gps_global_origin,
            m.MAVLINK_MSG_ID_VFR_HUD: self._vfr_hud,
            m.MAVLINK_MSG_ID_ALTITUDE: self._altitude,
            m.MAVLINK_MSG_ID_BATTERY_STATUS: self._battery_status,
            m.MAVLINK_MSG_ID_HOME_POSITION: self._home_position,
            m.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: self._extended_sys_state,
            m.MAVLINK_MSG_ID_MISSION_CURRENT: self._mission_current,
            m.MAVLINK_MSG_ID_AUTOPILOT_VERSION: self._autopilot_version,
            m.MAVLINK_MSG_ID_GIMBAL_DEVICE_ATTITUDE_STATUS: self._gimbal_device_attitude_status,
            m.MAVLINK_MSG_ID_MOUNT_STATUS: self._mount_status,
        }

    def build(self, message_id: int) -> Message | None:
        """A message by its id; None when this vehicle has none such now."""
        builder = self._builders.get(message_id)
        return None if builder is None else builder()

    def knows(self, message_id: int) -> bool:
        """Whether the vehicle can send such messages at all."""
        return message_id in self._builders

    def _measured_position(self) -> np.ndarray:
        noise = [self._noise.gauss(0.0, self._position_noise_m) for _ in range(3)]
        return self._vehicle.airframe.position_m + noise

    def _measured_velocity(self) -> np.ndarray:
        noise = [self._noise.gauss(0.0, 0.02) for _ in range(3)]
        return self._vehicle.airframe.velocity_m_s + noise

    def _sys_status(self) -> Message:
        vehicle = self._vehicle
        battery = vehicle.airframe.battery
        sensors = _SENSORS | PREARM
        healthy = sensors if vehicle.ready_to_arm else sensors & ~PREARM
        if not vehicle.hears_satellites:
            healthy &= ~int(mavlink.MAV_SYS_STATUS_SENSOR_GPS)
        return mavlink.MAVLink_sys_status_message(
            sensors,
            sensors,
            healthy,
            120,
            round(battery.voltage_v * 1e3),
            round(battery.current_a * 1e2) if vehicle.airframe.running else 80,
            int(battery.remaining * 100),
            0,
            0,
            0,
            0,
            0,
            0,
        )

    def _battery_status(self) -> Message:
        battery = self._vehicle.airframe.battery
        cell = round(battery.voltage_v / battery.CELLS * 1e3)
        voltages = [cell] * battery.CELLS + [65535] * (10 - battery.CELLS)
        return mavlink.MAVLink_battery_status_message(
            0,
            mavlink.MAV_BATTERY_FUNCTION_ALL,
            mavlink.MAV_BATTERY_TYPE_LIPO,
            32767,
            voltages,
            round(battery.current_a * 1e2),
            round(battery.used_wh / (battery.CELLS * 3.7) * 1e3),
            round(battery.used_wh * 36.0),
            int(battery.remaining * 100),
        )

    def _system_time(self) -> Message:
        return mavlink.MAVLink_system_time_message(round(self._vehicle.unix_s * 1e6), self._vehicle.boot_ms)

    def _gps_raw_int(self) -> Message:
        vehicle = self._vehicle
        if not vehicle.hears_satellites:
            seen = 0 if vehicle.positioning is None else vehicle.positioning.satellites
            return mavlink.MAVLink_gps_raw_int_message(
                round(vehicle.time_s * 1e6), mavlink.GPS_FIX_TYPE_NO_FIX, 0, 0, 0, 65535, 65535, 0, 0, seen
            )
        place = vehicle.frame.geo(self._measured_position())
        vx, vy, _ = self._measured_velocity()
        course = math.degrees(math.atan2(vx, vy)) % 360.0
        return mavlink.MAVLink_gps_raw_int_message(
            round(vehicle.time_s * 1e6),
            vehicle.gps_fix,
            e7(place.latitude_deg),
            e7(place.longitude_deg),
            round(place.altitude_m * 1e3),
            70,
            110,
            round(math.hypot(vx, vy) * 1e2),
            round(course * 1e2) % 36000,
            14,
            h_acc=round(OWN_FIX_M * 1e3),
            v_acc=round(OWN_FIX_M * 1.5e3),
        )

    def _angles(self) -> tuple[float, float, float, list[float]]:
        airframe = self._vehicle.airframe
        roll, pitch = airframe.roll_pitch_rad
        heading = heading_from_yaw(airframe.yaw_rad)
        yaw = math.pi - (math.pi - heading) % (2 * math.pi)
        p, q, r = (float(rate) for rate in airframe.state[10:13])
        return roll, pitch, yaw, [p, -q, -r]

    def _attitude(self) -> Message:
        roll, pitch, yaw, rates = self._angles()
        return mavlink.MAVLink_attitude_message(self._vehicle.boot_ms, roll, pitch, yaw, *rates)

    def _attitude_quaternion(self) -> Message:
        roll, pitch, yaw, rates = self._angles()
        q = quaternion(roll, pitch, yaw)
        return mavlink.MAVLink_attitude_quaternion_message(self._vehicle.boot_ms, *q, *rates)

    def _attitude_target(self) -> Message | None:
        asked = self._vehicle.airframe.asked_roll_pitch_yaw_rad
        if asked is None:
            return None
        roll, pitch, yaw = asked
        q = quaternion(roll, pitch, heading_from_yaw(yaw))
        return mavlink.MAVLink_attitude_target_message(self._vehicle.boot_ms, 0, q, 0.0, 0.0, 0.0, 0.5)

    def _local_position_ned(self) -> Message | None:
        vehicle = self._vehicle
        if not vehicle.has_position:
            return None
        velocity = ned_from_enu(self._measured_velocity())
        place = vehicle.frame.local_ned(self._measured_position())
        return mavlink.MAVLink_local_position_ned_message(vehicle.boot_ms, *place, *(float(v) for v in velocity))

    def _global_position_int(self) -> Message:
        vehicle = self._vehicle
        heading = round(math.degrees(heading_from_yaw(vehicle.airframe.yaw_rad)) * 1e2) % 36000
        velocity = [round(float(v) * 1e2) for v in ned_from_enu(self._measured_velocity())]
        if not vehicle.has_position:
            return mavlink.MAVLink_global_position_int_message(vehicle.boot_ms, 0, 0, 0, 0, *velocity, heading)
        place = vehicle.frame.geo(self._measured_position())
        return mavlink.MAVLink_global_position_int_message(
            vehicle.boot_ms,
            e7(place.latitude_deg),
            e7(place.longitude_deg),
            round(place.altitude_m * 1e3),
            round((place.altitude_m - vehicle.home.altitude_m) * 1e3),
            *velocity,
            heading,
        )

    def _vfr_hud(self) -> Message:
        vehicle = self._vehicle
        vx, vy, vz = (float(v) for v in vehicle.airframe.velocity_m_s)
        thrust = float(np.sum(vehicle.airframe.state[13:17])) / (4.0 * vehicle.airframe.parameters.max_motor_thrust_n)
        heading = round(math.degrees(heading_from_yaw(vehicle.airframe.yaw_rad))) % 360
        altitude = vehicle.frame.geo(vehicle.airframe.position_m).altitude_m
        return mavlink.MAVLink_vfr_hud_message(0.0, math.hypot(vx, vy), heading, round(100 * thrust), altitude, vz)

    def _altitude(self) -> Message:
        vehicle = self._vehicle
        altitude = vehicle.frame.geo(vehicle.airframe.position_m).altitude_m
        local = altitude - vehicle.frame.origin.altitude_m
        relative = altitude - vehicle.home.altitude_m
        return mavlink.MAVLink_altitude_message(
            round(vehicle.time_s * 1e6), altitude, altitude, local, relative, math.nan, vehicle.airframe.height_m
        )

    def _home_position(self) -> Message | None:
        vehicle = self._vehicle
        if not vehicle.has_position:
            return None
        home = vehicle.home
        local = vehicle.frame.local_ned(vehicle.home_m)
        return mavlink.MAVLink_home_position_message(
            e7(home.latitude_deg),
            e7(home.longitude_deg),
            round(home.altitude_m * 1e3),
            *local,
            [1.0, 0.0, 0.0, 0.0],
            0.0,
            0.0,
            0.0,
            round(vehicle.time_s * 1e6),
        )

    def _gps_global_origin(self) -> Message | None:
        vehicle = self._vehicle
        if not vehicle.has_position:
            return None
        origin = vehicle.frame.origin
        return mavlink.MAVLink_gps_global_origin_message(
            e7(origin.latitude_deg),
            e7(origin.longitude_deg),
            round(origin.altitude_m * 1e3),
            round(vehicle.time_s * 1e6),
        )

    def _extended_sys_state(self) -> Message:
        return mavlink.MAVLink_extended_sys_state_message(0, self._vehicle.flight.landed_state)

    def _mission_current(self) -> Message:
        message = MissionCurrentWithIds(*self._vehicle.mission_current())
        message.ids = self._vehicle.missions.list_ids()
        return message

    def _autopilot_version(self) -> Message:
        vehicle = self._vehicle
        return mavlink.MAVLink_autopilot_version_message(
            vehicle.capabilities,
            vehicle.software_version,
            0,
            0,
            0,
            [0] * 8,
            [0] * 8,
            [0] * 8,
            0x26AC,
            0x0010,
            int.from_bytes(vehicle.uid[:8], "little"),
            list(vehicle.uid.ljust(18, b"\0")[:18]),
        )

    def _gimbal_device_attitude_status(self) -> Message:
        vehicle = self._vehicle
        flags = mavlink.GIMBAL_DEVICE_FLAGS_ROLL_LOCK | mavlink.GIMBAL_DEVICE_FLAGS_PITCH_LOCK
        q = quaternion(0.0, vehicle.gimbal.pitch_rad, 0.0)
        return mavlink.MAVLink_gimbal_device_attitude_status_message(0, 0, vehicle.boot_ms, flags, q, 0.0, 0.0, 0.0, 0)

    def _mount_status(self) -> Message:
        pitch = round(math.degrees(self._vehicle.gimbal.pitch_rad) * 1e2)
        return mavlink.MAVLink_mount_status_message(0, 0, pitch, 0, 0)


def quaternion(roll: float, pitch: float, yaw: float) -> list[float]:
    """North-east-down attitude as a quaternion, w first, from Tait-Bryan angles."""
    cr, sr = math.cos(roll / 2), math.sin(roll / 2)
    cp, sp = math.cos(pitch / 2), math.sin(pitch / 2)
    cy, sy = math.cos(yaw / 2), math.sin(yaw / 2)
    return [
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    ]
