"""Heartbeats of the station, and what a heartbeat of somebody else says about who that is."""

from __future__ import annotations

from gcs.core.vehicle import Autopilot
from gcs.mavlink.dialect import Message, mavlink

INTERVAL_S = 1.0
LOST_AFTER_S = 3.0
_NOT_VEHICLES = frozenset(
    {
        mavlink.MAV_TYPE_ANTENNA_TRACKER,
        mavlink.MAV_TYPE_GCS,
        mavlink.MAV_TYPE_ONBOARD_CONTROLLER,
        mavlink.MAV_TYPE_GIMBAL,
        mavlink.MAV_TYPE_ADSB,
        mavlink.MAV_TYPE_CAMERA,
        mavlink.MAV_TYPE_CHARGING_STATION,
    }
)


def station_heartbeat() -> Message:
    """What this station says of itself; vehicles take only heartbeats of this type as a ground station's."""
    return mavlink.MAVLink_heartbeat_message(
        mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, mavlink.MAV_STATE_ACTIVE, 3
    )


def is_vehicle(heartbeat: Message) -> bool:
    """Whether a heartbeat comes from an autopilot, and not from a station, a gimbal, a camera or the like."""
    return heartbeat.autopilot != mavlink.MAV_AUTOPILOT_INVALID and heartbeat.type not in _NOT_VEHICLES


def autopilot_of(heartbeat: Message) -> Autopilot:
    """The flight stack that a heartbeat names."""
    known = {
        mavlink.MAV_AUTOPILOT_PX4: Autopilot.PX4,
        mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA: Autopilot.ARDUPILOT,
    }
    return known.get(heartbeat.autopilot, Autopilot.GENERIC)
