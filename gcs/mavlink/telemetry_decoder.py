"""Telemetry messages to `Telemetry`: units, frames, and "unknown" kept as None. Every field is untrusted."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs.core.frames import GeoPoint, yaw_from_heading
from gcs.core.vehicle import BatteryState, Heard, LandedState, MissionProgress, MissionState, Telemetry
from gcs.mavlink.autopilots.base import FlightStack
from gcs.mavlink.dialect import Message, mavlink

Changes = dict[str, Any]
Reader = Callable[[Message, float], Changes]
"""Takes a message and the station's time; what it says of the telemetry, by field."""
NO_MISSION_TOTAL = 65535
_LANDED_STATES = {state.value: state for state in LandedState}
_MISSION_STATES = {state.value: state for state in MissionState}


def geo_point(latitude_e7: int, longitude_e7: int, altitude_m: float) -> GeoPoint | None:
    """A point from wire units; None when out of range or the 0/0 that stands for "no fix"."""
    if abs(latitude_e7) > 900_000_000 or abs(longitude_e7) > 1_800_000_000 or not math.isfinite(altitude_m):
        return None
    if latitude_e7 == 0 and longitude_e7 == 0:
        return None
    return GeoPoint(latitude_e7 * 1e-7, longitude_e7 * 1e-7, altitude_m)


def mission_progress(m: Message) -> MissionProgress:
    """What a MISSION_CURRENT says."""
    total = int(m.total) if 0 < m.total < NO_MISSION_TOTAL else None
    return MissionProgress(int(m.seq), total, _MISSION_STATES.get(m.mission_state, MissionState.UNKNOWN))


def _enu(north: float, east: float, down: float) -> NDArray[np.float64]:
    """East, north, up of three numbers; `core.frames` has the same for arrays, at ten times the price for so few."""
    return np.array((east, north, -down), dtype=np.float64)


class TelemetryDecoder:
    """Folds messages of vehicles into their telemetry. It holds no state.

    Args:
        stack: the vehicles' flight stack, which reads mode numbers.
    """

    def __init__(self, stack: FlightStack) -> None:
        self._stack = stack
        self._readers: dict[str, Reader] = {
            "HEARTBEAT": self._heartbeat,
            "EXTENDED_SYS_STATE": self._extended_sys_state,
            "GLOBAL_POSITION_INT": self._global_position_int,
            "LOCAL_POSITION_NED": self._local_position_ned,
            "ATTITUDE": self._attitude,
            "SYS_STATUS": self._sys_status,
            "BATTERY_STATUS": self._battery_status,
            "GPS_RAW_INT": self._gps_raw_int,
            "HOME_POSITION": self._home_position,
            "GPS_GLOBAL_ORIGIN": self._gps_global_origin,
            "MISSION_CURRENT": self._mission_current,
            "SYSTEM_TIME": self._system_time,
        }
        self._gimbal_readers: dict[str, Reader] = {
            "GIMBAL_DEVICE_ATTITUDE_STATUS": self._gimbal_device_attitude_status,
            "MOUNT_ORIENTATION": self._mount_orientation,
            "MOUNT_STATUS": self._mount_status,
        }
        self._readers |= self._gimbal_readers

    @property
    def kinds(self) -> frozenset[str]:
        """The messages that say anything of use."""
        return frozenset(self._readers)

    def reader(self, kind: str, *, from_autopilot: bool) -> Reader | None:
        """What reads a kind of message; None when it says nothing of use."""
        return (self._readers if from_autopilot else self._gimbal_readers).get(kind)

    def apply(self, telemetry: Telemetry, message: Message, now_s: float, *, from_autopilot: bool = True) -> Telemetry:
        """The telemetry after a message; the same object when the message says nothing of use.

        Args:
            telemetry: as known so far.
            message: from any component of the vehicle.
            now_s: the station's monotonic time.
            from_autopilot: False for other components, of which only the gimbal's attitude is taken.
        """
        reader = self.reader(message.get_type(), from_autopilot=from_autopilot)
        if reader is None:
            return telemetry
        changes = reader(message, now_s)
        return replace(telemetry, **changes) if changes else telemetry

    def _heartbeat(self, m: Message, now_s: float) -> Changes:
        mode, name = self._stack.flight_mode(m.custom_mode)
        armed = bool(m.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
        return {"mode": Heard(mode, now_s), "mode_name": Heard(name, now_s), "armed": Heard(armed, now_s)}

    @staticmethod
    def _extended_sys_state(m: Message, now_s: float) -> Changes:
        return {"landed": Heard(_LANDED_STATES.get(m.landed_state, LandedState.UNKNOWN), now_s)}

    @staticmethod
    def _global_position_int(m: Message, now_s: float) -> Changes:
        changes: Changes = {"vehicle_time_s": Heard(m.time_boot_ms * 1e-3, now_s)}
        point = geo_point(m.lat, m.lon, m.alt * 1e-3)
        if point is not None:
            velocity = _enu(m.vx * 1e-2, m.vy * 1e-2, m.vz * 1e-2)
            changes |= {"position": Heard(point, now_s), "velocity_m_s": Heard(velocity, now_s)}
        return changes

    @staticmethod
    def _local_position_ned(m: Message, now_s: float) -> Changes:
        changes: Changes = {"vehicle_time_s": Heard(m.time_boot_ms * 1e-3, now_s)}
        if all(map(math.isfinite, (m.x, m.y, m.z, m.vx, m.vy, m.vz))):
            changes["local_position_m"] = Heard(_enu(m.x, m.y, m.z), now_s)
            changes["velocity_m_s"] = Heard(_enu(m.vx, m.vy, m.vz), now_s)
        return changes

    @staticmethod
    def _attitude(m: Message, now_s: float) -> Changes:
        changes: Changes = {"vehicle_time_s": Heard(m.time_boot_ms * 1e-3, now_s)}
        if all(map(math.isfinite, (m.roll, m.pitch, m.yaw))):
            yaw = yaw_from_heading(m.yaw)
            changes |= {"yaw_rad": Heard(yaw, now_s), "attitude_rad": Heard((m.roll, m.pitch, yaw), now_s)}
        return changes

    @staticmethod
    def _sys_status(m: Message, now_s: float) -> Changes:
        changes: Changes = {}
        prearm = mavlink.MAV_SYS_STATUS_PREARM_CHECK
        if m.onboard_control_sensors_present & prearm:
            changes["ready_to_arm"] = Heard(bool(m.onboard_control_sensors_health & prearm), now_s)
        battery = BatteryState(
            remaining=m.battery_remaining / 100 if 0 <= m.battery_remaining <= 100 else None,
            voltage_v=m.voltage_battery * 1e-3 if 0 < m.voltage_battery < 65535 else None,
            current_a=m.current_battery * 1e-2 if m.current_battery >= 0 else None,
        )
        if battery != BatteryState(None, None, None):
            changes["battery"] = Heard(battery, now_s)
        return changes

    @staticmethod
    def _battery_status(m: Message, now_s: float) -> Changes:
        if m.id != 0:
            return {}
        cells = [cell for cell in m.voltages if 0 < cell < 65535]
        battery = BatteryState(
            remaining=m.battery_remaining / 100 if 0 <= m.battery_remaining <= 100 else None,
            voltage_v=sum(cells) * 1e-3 if cells else None,
            current_a=m.current_battery * 1e-2 if m.current_battery >= 0 else None,
        )
        return {} if battery == BatteryState(None, None, None) else {"battery": Heard(battery, now_s)}

    @staticmethod
    def _gps_raw_int(m: Message, now_s: float) -> Changes:
        changes: Changes = {"gps_fix": Heard(int(m.fix_type), now_s)}
        if m.satellites_visible != 255:
            changes["satellites"] = Heard(int(m.satellites_visible), now_s)
        return changes

    @staticmethod
    def _home_position(m: Message, now_s: float) -> Changes:
        point = geo_point(m.latitude, m.longitude, m.altitude * 1e-3)
        return {} if point is None else {"home": Heard(point, now_s)}

    @staticmethod
    def _gps_global_origin(m: Message, now_s: float) -> Changes:
        point = geo_point(m.latitude, m.longitude, m.altitude * 1e-3)
        return {} if point is None else {"origin": Heard(point, now_s)}

    @staticmethod
    def _mission_current(m: Message, now_s: float) -> Changes:
        return {"mission": Heard(mission_progress(m), now_s)}

    @staticmethod
    def _system_time(m: Message, now_s: float) -> Changes:
        return {"vehicle_time_s": Heard(m.time_boot_ms * 1e-3, now_s)}

    @staticmethod
    def _gimbal_device_attitude_status(m: Message, now_s: float) -> Changes:
        w, x, y, z = (float(part) for part in m.q)
        size = w * w + x * x + y * y + z * z
        if not math.isfinite(size) or size < 0.25:
            return {}
        pitch = math.asin(max(-1.0, min(1.0, 2 * (w * y - z * x) / size)))
        return {"gimbal_pitch_rad": Heard(pitch, now_s)}

    @staticmethod
    def _mount_orientation(m: Message, now_s: float) -> Changes:
        return {"gimbal_pitch_rad": Heard(math.radians(m.pitch), now_s)} if math.isfinite(m.pitch) else {}

    @staticmethod
    def _mount_status(m: Message, now_s: float) -> Changes:
        if abs(m.pointing_a) > 18_000:
            return {}
        return {"gimbal_pitch_rad": Heard(math.radians(m.pointing_a * 1e-2), now_s)}
