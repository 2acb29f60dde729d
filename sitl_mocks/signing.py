"""MAVLink 2 signing of a simulated vehicle, by pymavlink's code: one key for the vehicle, time stamps for each link."""

from __future__ import annotations

from sitl_mocks.dialect import Message, mavlink

_RADIO_STATUS = mavlink.MAVLINK_MSG_ID_RADIO_STATUS


class VehicleKey:
    """The key that a vehicle was given, or none."""

    def __init__(self) -> None:
        self._key: bytes | None = None
        self._timestamp = 0

    def set_up(self, message: Message) -> None:
        """Take a SETUP_SIGNING; a key of zeros ends signing."""
        key = bytes(message.secret_key)
        self._key = key if any(key) else None
        self._timestamp = int(message.initial_timestamp)

    def apply(self, signing: Message) -> None:
        """Have a link (its `MAVLinkSigning`) sign, and take what is signed only."""
        signing.secret_key = self._key
        signing.sign_outgoing = self._key is not None
        signing.timestamp = max(signing.timestamp, self._timestamp)
        signing.stream_timestamps.clear()
        signing.allow_unsigned_callback = None if self._key is None else _is_radio_status


def _is_radio_status(codec: Message, message_id: int) -> bool:
    del codec
    return bool(message_id == _RADIO_STATUS)
