"""A camera with one large picture at the far end of a bad link, on fake time and without sockets."""

from __future__ import annotations

import math
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from random import Random

from sitl_mocks.camera import CameraFolder
from sitl_mocks.channel import Channel, FaultyPipe, LinkFaults
from sitl_mocks.dialect import CAMERA_COMPONENT
from sitl_mocks.file_server import DATA_SIZE, FileServer

SYSTEM_ID = 1
PATH = "/DCIM/IMG_0001.JPG"
_STEP_S = 0.001


@dataclass(frozen=True)
class PictureSpec:
    """What to simulate.

    Attributes:
        size: of the picture, in bytes.
        loss: of packets, each way.
        round_trip_s: of the link.
        bytes_per_s: what the line carries, each way.
        packets_per_ms: how fast the camera sends.
        burst_packets: after so many it waits to be asked again.
        seed: of the picture and of the link.
    """

    size: int
    loss: float
    round_trip_s: float
    bytes_per_s: float = 1e6
    packets_per_ms: int = 3
    burst_packets: int = 2000
    seed: int = 0


class PictureWorld:
    """One camera and its link.

    Args:
        spec: what to simulate.
    """

    def __init__(self, spec: PictureSpec) -> None:
        self.now_s = 0.0
        self._picture = Random(spec.seed).randbytes(spec.size)
        self._server = FileServer(CameraFolder({PATH: self._picture}))
        self._server.BURST_BYTES = spec.burst_packets * DATA_SIZE
        self._server.PACKETS_PER_STEP = spec.packets_per_ms
        self._stepped_s = 0.0
        faults = LinkFaults(loss=spec.loss, latency_s=spec.round_trip_s / 2, bytes_per_s=spec.bytes_per_s)
        self._to_station: list[bytes] = []
        self._down = FaultyPipe(self._to_station.append, faults, spec.seed * 2 + 1)
        self._up = FaultyPipe(self._arrive, faults, spec.seed * 2 + 2)
        self._channel = Channel(SYSTEM_ID, lambda packet: self._down.put(packet, self.now_s))

    def pass_time(self, until_s: float, packets: Sequence[bytes]) -> tuple[float, list[bytes]]:
        """Send packets to the camera now, and let time pass until the station hears something, or until a time.

        Returns:
            The time then, and what the station hears.
        """
        for packet in packets:
            self._up.put(packet, self.now_s)
        while True:
            step_s = self._stepped_s + _STEP_S if self._server.busy else math.inf
            self.now_s = max(self.now_s, min(until_s, self._up.next_s, self._down.next_s, step_s))
            self._up.release(self.now_s)
            if self.now_s >= step_s:
                self._stepped_s = self.now_s
                self._server.step()
            self._down.release(self.now_s)
            if self._to_station or self.now_s >= until_s:
                heard = list(self._to_station)
                self._to_station.clear()
                return self.now_s, heard

    def truth(self, crc32: int) -> dict[str, bool]:
        """`whole`: whether what the station has, by its CRC-32, is the picture."""
        return {"whole": zlib.crc32(self._picture) == crc32}

    def _arrive(self, packet: bytes) -> None:
        for message in self._channel.receive(packet):
            self._server.handle(message, lambda m: self._channel.send(m, CAMERA_COMPONENT))
            self._stepped_s = self.now_s
