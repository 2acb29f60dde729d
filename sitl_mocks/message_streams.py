"""What a vehicle sends again and again on each link, and what it sends when somebody asks for a message."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

from sitl_mocks.channel import Channel, Stream
from sitl_mocks.commands import ACCEPTED, DENIED, UNSUPPORTED, Command
from sitl_mocks.dialect import AUTOPILOT_COMPONENT, CAMERA_COMPONENT, Message, mavlink

if TYPE_CHECKING:
    from sitl_mocks.vehicle import SimulatedVehicle

HEARTBEAT = int(mavlink.MAVLINK_MSG_ID_HEARTBEAT)
ACTIVE = int(mavlink.MAV_STATE_ACTIVE)
SHORTEST_S = 0.005
CAMERA_HEARTBEAT_S = 1.0

RC_CHANNELS = int(mavlink.MAVLINK_MSG_ID_RC_CHANNELS)
CHANNELS, NO_CHANNEL = 18, 65535
CENTRED_US = 1500


class MessageStreams:
    """The streams of one vehicle, and the commands that set them.

    Args:
        vehicle: whose they are.

    Attributes:
        sticks_us: where the pilot's sticks are: roll, pitch, throttle, yaw.
    """

    def __init__(self, vehicle: SimulatedVehicle) -> None:
        self._vehicle = vehicle
        self._camera_heartbeat_s = -math.inf
        self._own = {HEARTBEAT: vehicle.heartbeat, RC_CHANNELS: self._rc_channels}
        self.sticks_us = [CENTRED_US] * 4

    def commands(self) -> dict[int, Callable[[Command, Channel], int]]:
        """What is called for which command."""
        m = mavlink
        return {
            m.MAV_CMD_SET_MESSAGE_INTERVAL: self._set_interval,
            m.MAV_CMD_REQUEST_MESSAGE: self._request,
            m.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES: lambda _, to: self._send_now(
                m.MAVLINK_MSG_ID_AUTOPILOT_VERSION, to
            ),
            m.MAV_CMD_GET_HOME_POSITION: lambda _, to: self._send_now(m.MAVLINK_MSG_ID_HOME_POSITION, to),
        }

    def begin(self, channel: Channel) -> None:
        """Send on a link what comes unasked."""
        for message_id, rate_hz in self._vehicle.default_streams().items():
            self.set_rate(channel, message_id, rate_hz)

    def set_rate(self, channel: Channel, message_id: int, rate_hz: float) -> None:
        """Send a message so often on a link; 0 for no more."""
        if rate_hz > 0:
            channel.streams[message_id] = Stream(max(1.0 / rate_hz, SHORTEST_S), self._vehicle.time_s)
        else:
            channel.streams.pop(message_id, None)

    def send_due(self, wall_s: float) -> None:
        """Send what is due on every link."""
        vehicle = self._vehicle
        for channel in vehicle.channels:
            for message_id, stream in channel.streams.items():
                if stream.is_due(vehicle.time_s, wall_s):
                    message = self._build(message_id)
                    if message is not None:
                        channel.send(message, AUTOPILOT_COMPONENT)
        if wall_s - self._camera_heartbeat_s >= CAMERA_HEARTBEAT_S:
            self._camera_heartbeat_s = wall_s
            beat = mavlink.MAVLink_heartbeat_message(
                mavlink.MAV_TYPE_CAMERA, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, ACTIVE, 3
            )
            vehicle.broadcast(beat, CAMERA_COMPONENT)

    def _build(self, message_id: int) -> Message | None:
        own = self._own.get(message_id)
        return self._vehicle.telemetry.build(message_id) if own is None else own()

    def _knows(self, message_id: int) -> bool:
        return message_id in self._own or self._vehicle.telemetry.knows(message_id)

    def _rc_channels(self) -> Message:
        sticks = self.sticks_us
        channels = [*sticks, *[NO_CHANNEL] * (CHANNELS - len(sticks))]
        return mavlink.MAVLink_rc_channels_message(self._vehicle.boot_ms, len(sticks), *channels, 255)

    def _set_interval(self, command: Command, channel: Channel) -> int:
        message_id, interval_us = int(command.params[0]), command.params[1]
        if not self._knows(message_id):
            return self._vehicle.unknown_stream_result
        if interval_us == 0:
            self.set_rate(channel, message_id, self._vehicle.default_streams().get(message_id, 0.0))
        else:
            self.set_rate(channel, message_id, max(1e6 / interval_us, 0.0))
        return ACCEPTED

    def _request(self, command: Command, channel: Channel) -> int:
        message_id = int(command.params[0])
        return self._send_now(message_id, channel) if self._knows(message_id) else UNSUPPORTED

    def _send_now(self, message_id: int, channel: Channel) -> int:
        message = self._build(message_id)
        if message is None:
            return DENIED
        channel.send(message, AUTOPILOT_COMPONENT)
        return ACCEPTED
