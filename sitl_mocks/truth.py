"""The truth about a simulated vehicle, for whoever checks a flight from outside."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sitl_mocks.vehicle import SimulatedVehicle


def truth(vehicle: SimulatedVehicle) -> dict[str, Any]:
    """State of a vehicle in plain JSON types: SI units, scene ENU, yaw from east counter-clockwise."""
    airframe, counters = vehicle.airframe, vehicle.counters
    current, _, mission_state, _ = vehicle.mission_current()
    heard = counters.last_setpoint_wall_s
    return {
        "system_id": vehicle.system_id,
        "autopilot": vehicle.kind,
        "time_s": round(vehicle.time_s, 3),
        "armed": vehicle.armed,
        "mode": vehicle.mode_name(),
        "landed_state": vehicle.flight.landed_state,
        "position_m": [round(float(c), 4) for c in airframe.true_position_m],
        "believed_position_m": [round(float(c), 4) for c in airframe.position_m],
        "positions_taken": 0 if vehicle.positioning is None else vehicle.positioning.positions_taken,
        "velocity_m_s": [round(float(c), 4) for c in airframe.true_velocity_m_s],
        "yaw_rad": round(airframe.yaw_rad, 5),
        "gimbal_pitch_rad": round(vehicle.gimbal.pitch_rad, 5),
        "battery": round(airframe.battery.remaining, 4),
        "home": [vehicle.home.latitude_deg, vehicle.home.longitude_deg, vehicle.home.altitude_m],
        "mission_items": len(vehicle.missions.items),
        "mission_current": current,
        "mission_state": mission_state,
        "images": sorted(vehicle.folder.files),
        "captures": len(vehicle.camera.shots),
        "setpoints": counters.setpoints,
        "setpoints_in_offboard": counters.setpoints_in_offboard,
        "longest_setpoint_gap_s": round(counters.longest_gap_s, 3),
        "seconds_since_setpoint": None if heard is None else round(vehicle.wall_s - heard, 3),
        "forced_arms": counters.forced_arms,
        "commands": {str(number): count for number, count in sorted(counters.commands.items())},
        "station_lost": vehicle.station_lost,
        "replan": vehicle.replanner.state(),
        "obstacles": vehicle.encounters.state(),
        "lidar": vehicle.lidar.state,
        "odometry": vehicle.lidar.odometry_state,
    }
