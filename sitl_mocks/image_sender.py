"""The image transmission protocol, the camera's side: a handshake answers a handshake, ENCAPSULATED_DATA follows."""

from __future__ import annotations

from collections.abc import Callable

from sitl_mocks.dialect import Message, mavlink
from sitl_mocks.picture import HEIGHT_PX, WIDTH_PX

PACKET_BYTES = 253
_QUALITY = 80


class ImageSender:
    """Sends the newest picture to who asks; a new request begins it anew.

    Args:
        newest: the newest picture's file, if there is one.
    """

    PACKETS_PER_STEP = 12

    def __init__(self, newest: Callable[[], bytes | None]) -> None:
        self._newest = newest
        self._under_way: dict[object, tuple[Callable[[Message], None], bytes, int]] = {}

    @property
    def busy(self) -> bool:
        """Whether a picture is being sent."""
        return bool(self._under_way)

    def handle(self, message: Message, send: Callable[[Message], None], receiver: object) -> None:
        """Take a handshake; one that tells of a size is no request."""
        if message.size != 0:
            return
        data = self._newest() or b""
        packets = -(-len(data) // PACKET_BYTES)
        jpeg = mavlink.MAVLINK_DATA_STREAM_IMG_JPEG
        send(
            mavlink.MAVLink_data_transmission_handshake_message(
                jpeg, len(data), WIDTH_PX, HEIGHT_PX, packets, PACKET_BYTES, _QUALITY
            )
        )
        if packets:
            self._under_way[receiver] = (send, data, 0)

    def step(self) -> None:
        """Send the next packets."""
        for receiver, (send, data, first) in list(self._under_way.items()):
            last = min(first + self.PACKETS_PER_STEP, -(-len(data) // PACKET_BYTES))
            for number in range(first, last):
                part = data[number * PACKET_BYTES :][:PACKET_BYTES].ljust(PACKET_BYTES, b"\0")
                send(mavlink.MAVLink_encapsulated_data_message(number, list(part)))
            if last * PACKET_BYTES >= len(data):
                del self._under_way[receiver]
            else:
                self._under_way[receiver] = (send, data, last)
