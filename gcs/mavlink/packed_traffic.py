"""What a vehicle sends, packed ahead, so that one process can play a hundred of them for a benchmark."""

from __future__ import annotations

import struct
from collections.abc import Iterator

import fastcrc

from gcs.mavlink.dialect import Message, mavlink
from gcs.mavlink.received_message import CHECKSUM_EXTRAS, MARKER_V2
from gcs.mavlink.signing import signed

_HEADER = struct.Struct("<BBBBBBBHB")
_COMMAND_LONG, _TIMESYNC = mavlink.MAVLINK_MSG_ID_COMMAND_LONG, mavlink.MAVLINK_MSG_ID_TIMESYNC
_REQUEST_MESSAGE = mavlink.MAV_CMD_REQUEST_MESSAGE.to_bytes(2, "little")
_ORIGIN_E7, _ALTITUDE_MM = (313622000, 1216155000), 34000


def _typical_messages() -> tuple[tuple[Message, int], ...]:
    """A vehicle's messages and how often a second each comes: 87 in all, as a flying PX4 has them over a fast radio."""
    m = mavlink
    return (
        (m.MAVLink_heartbeat_message(2, m.MAV_AUTOPILOT_PX4, 29, 4 << 16 | 3 << 24, 4, 3), 2),
        (m.MAVLink_attitude_message(1, 0.02, -0.03, 1.0, 0.01, 0.01, 0.01), 20),
        (m.MAVLink_local_position_ned_message(1, 12.0, 5.0, -30.0, 3.0, 0.1, 0.1), 10),
        (m.MAVLink_global_position_int_message(1, *_ORIGIN_E7, _ALTITUDE_MM, 30000, 300, 10, 10, 9000), 10),
        (m.MAVLink_attitude_quaternion_message(1, 0.9, 0.1, 0.1, 0.4, 0.01, 0.01, 0.01), 10),
        (m.MAVLink_servo_output_raw_message(1, 0, *[1500] * 8), 8),
        (m.MAVLink_vfr_hud_message(3.0, 3.0, 90, 50, 34.0, 0.1), 5),
        (m.MAVLink_attitude_target_message(1, 0, [0.9, 0.1, 0.1, 0.4], 0.01, 0.01, 0.01, 0.5), 5),
        (m.MAVLink_position_target_local_ned_message(1, 1, 0, *[1.0] * 9, 0.5, 0.1), 5),
        (m.MAVLink_gps_raw_int_message(1, 3, *_ORIGIN_E7, _ALTITUDE_MM, 80, 90, 300, 9000, 14), 2),
        (m.MAVLink_sys_status_message(0x2F, 0x2F, 0x2F, 300, 15200, 1200, 80, 0, 0, 0, 0, 0, 0), 2),
        (m.MAVLink_extended_sys_state_message(0, 2), 2),
        (m.MAVLink_mission_current_message(3, 20, 3), 2),
        (m.MAVLink_altitude_message(1, *[34.0] * 6), 2),
        (m.MAVLink_battery_status_message(0, 1, 1, 3000, [3800] * 4 + [65535] * 6, 1200, 500, -1, 80), 1),
        (m.MAVLink_estimator_status_message(1, 831, *[0.1] * 8), 1),
    )


def _requested_messages(system_id: int) -> tuple[tuple[Message, int], ...]:
    m = mavlink
    unit = [system_id] * 18
    return (
        (m.MAVLink_autopilot_version_message(0xE8FF, 1, 1, 1, 1, [0] * 8, [0] * 8, [0] * 8, 1, 1, 1, unit), 0),
        (m.MAVLink_home_position_message(*_ORIGIN_E7, 4000, 0, 0, 0, [1, 0, 0, 0], 0, 0, 0), 0),
        (m.MAVLink_gps_global_origin_message(*_ORIGIN_E7, 4000), 0),
    )


class PackedVehicle:
    """One vehicle that sends typical traffic and answers every command and TIMESYNC.

    Args:
        system_id: of the vehicle.
        key: it signs with; None for unsigned traffic.
        signing_time: time stamp of the first signature (10 us since 2015).
    """

    def __init__(self, system_id: int, key: bytes | None = None, signing_time: int = 0) -> None:
        self._system_id = system_id
        self._key = key
        self._signing_time = signing_time
        self._sequence = 0
        self._second = [(number, payload) for number, payload in _one_second(_packed(_typical_messages()))]
        self._on_request = {number: payload for number, payload, _ in _packed(_requested_messages(system_id))}
        self._next = 0

    @property
    def messages_per_s(self) -> int:
        """How many messages make one second of its traffic."""
        return len(self._second)

    def message(self, boot_ms: int) -> bytes:
        """The next packet of its traffic."""
        number, payload = self._second[self._next]
        self._next = (self._next + 1) % len(self._second)
        if number in _STAMPED:
            payload = struct.pack("<I", boot_ms) + payload[4:]
        return self._frame(number, payload)

    def answers(self, packet: bytes, boot_ms: int) -> list[bytes]:
        """The packets with which it answers a station's."""
        number = packet[7] | packet[8] << 8 | packet[9] << 16
        payload = packet[10 : 10 + packet[1]].ljust(33, b"\0")
        if number == _COMMAND_LONG:
            answers = [self._frame(mavlink.MAVLINK_MSG_ID_COMMAND_ACK, payload[28:30] + b"\0")]
            if payload[28:30] == _REQUEST_MESSAGE:
                wanted = int(struct.unpack("<f", payload[:4])[0])
                answers += [self._frame(wanted, self._on_request[wanted])] if wanted in self._on_request else []
            return answers
        if number == _TIMESYNC and payload[:8] == bytes(8):
            return [self._frame(_TIMESYNC, struct.pack("<q", max(boot_ms, 1) * 1_000_000) + payload[8:16])]
        return []

    def _frame(self, number: int, payload: bytes) -> bytes:
        head = (len(payload), 0, 0, self._sequence, self._system_id, 1, number & 0xFFFF, number >> 16)
        self._sequence = (self._sequence + 1) % 256
        frame: bytes = _HEADER.pack(MARKER_V2, *head) + payload
        frame += int(fastcrc.crc16.mcrf4xx(frame[1:] + CHECKSUM_EXTRAS[number])).to_bytes(2, "little")
        if self._key is None:
            return frame
        self._signing_time += 1
        return signed(frame, self._key, self._signing_time)


_STAMPED = frozenset(
    {
        mavlink.MAVLINK_MSG_ID_ATTITUDE,
        mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED,
        mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,
        mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION,
        mavlink.MAVLINK_MSG_ID_ATTITUDE_TARGET,
        mavlink.MAVLINK_MSG_ID_POSITION_TARGET_LOCAL_NED,
    }
)
"""Messages whose payload begins with `time_boot_ms`."""


def _packed(messages: tuple[tuple[Message, int], ...]) -> list[tuple[int, bytes, int]]:
    codec = mavlink.MAVLink(None)
    return [(m.get_msgId(), bytes(m.pack(codec))[10:-2], rate) for m, rate in messages]


def _one_second(messages: list[tuple[int, bytes, int]]) -> Iterator[tuple[int, bytes]]:
    """A second of traffic, each kind spread evenly over it."""
    times = ((k / rate, number, payload) for number, payload, rate in messages for k in range(rate))
    return ((number, payload) for _, number, payload in sorted(times))
