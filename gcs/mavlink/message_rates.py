"""What a vehicle is asked to send, once it is discovered and again after it was lost."""

from __future__ import annotations

from collections.abc import Mapping

from gcs.core.errors import RefusedError
from gcs.mavlink.autopilots.base import CommandCall
from gcs.mavlink.command_protocol import CommandExchange, NoAnswerError
from gcs.mavlink.dialect import mavlink
from gcs.mavlink.vehicle_channel import VehicleChannel

RATES_HZ = {
    mavlink.MAVLINK_MSG_ID_HEARTBEAT: 4.0,
    mavlink.MAVLINK_MSG_ID_ATTITUDE: 10.0,
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 10.0,
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: 10.0,
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: 4.0,
    mavlink.MAVLINK_MSG_ID_MISSION_CURRENT: 4.0,
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: 2.0,
    mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: 1.0,
    mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: 1.0,
    mavlink.MAVLINK_MSG_ID_SYSTEM_TIME: 1.0,
    mavlink.MAVLINK_MSG_ID_HOME_POSITION: 1.0,
    mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN: 0.5,
    mavlink.MAVLINK_MSG_ID_GIMBAL_DEVICE_ATTITUDE_STATUS: 5.0,
    mavlink.MAVLINK_MSG_ID_MOUNT_STATUS: 5.0,
}
"""Messages and how often they are wanted. An autopilot that lacks one refuses it, which is fine. Pictures
(CAMERA_IMAGE_CAPTURED, CAMERA_FEEDBACK) are events and come unasked; at a rate the last one would be repeated."""
OFFBOARD_RATES_HZ = {mavlink.MAVLINK_MSG_ID_ATTITUDE_TARGET: 10.0}
"""Wanted in addition from a vehicle that flies setpoints: how the tilt follows what its controller asks for."""
GIVE_UP_AFTER = 2


def interval_call(message_id: int, rate_hz: float) -> CommandCall:
    """SET_MESSAGE_INTERVAL, in microseconds."""
    return CommandCall(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, (float(message_id), 1e6 / rate_hz))


def request_call(message_id: int) -> CommandCall:
    """REQUEST_MESSAGE: send a message once."""
    return CommandCall(mavlink.MAV_CMD_REQUEST_MESSAGE, (float(message_id),))


async def request_rates(channel: VehicleChannel, rates_hz: Mapping[int, float]) -> bool:
    """Ask for messages, one after another, since acknowledgements do not say for which message they are.

    Args:
        channel: to the vehicle.
        rates_hz: message id -> rate.

    Returns:
        False when the vehicle does not answer such commands at all.
    """
    unanswered = 0
    for message_id, rate_hz in rates_hz.items():
        try:
            await channel.run(
                CommandExchange(
                    interval_call(message_id, rate_hz),
                    target=channel.target,
                    sender=channel.sender,
                    send=channel.send,
                    clock=channel.clock,
                )
            )
        except RefusedError:
            continue
        except NoAnswerError:
            unanswered += 1
            if unanswered >= GIVE_UP_AFTER:
                return False
    return True
