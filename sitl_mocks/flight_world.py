"""A whole vehicle among obstacles, with a bad link to its station and one to its companion, on fake time.

Time passes in steps of the vehicle's logic. A packet goes on at the first step after its time.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future
from dataclasses import dataclass
from typing import Any

from gcs.core.frames import GeoPoint
from sitl_mocks.ardupilot import ArduPilotVehicle
from sitl_mocks.channel import Channel, FaultyPipe, LinkFaults
from sitl_mocks.lidar import LidarOptions
from sitl_mocks.obstacle_file import parse_obstacles
from sitl_mocks.picture import Exposure
from sitl_mocks.px4 import Px4Vehicle
from sitl_mocks.truth import truth
from sitl_mocks.vehicle import LOGIC_S, SimulatedVehicle
from sitl_mocks.vehicle_options import VehicleOptions

SYSTEM_ID = 1
STATION, COMPANION = "station", "companion"

Packets = dict[str, list[bytes]]
"""By who is at the other end of the link: `STATION` or `COMPANION`."""


@dataclass(frozen=True)
class FlightSpec:
    """What to simulate.

    Attributes:
        autopilot: px4 or ardupilot.
        seed: of all that is left to chance.
        anchor: latitude, longitude (degrees) and altitude (m) of the scene's origin.
        home: where the vehicle stands, likewise.
        obstacles: as the file of obstacles has them under this name.
        parameters: of the vehicle, that differ from the usual.
        loss: of packets, each way, on either link.
        latency_s: of either link, one way.
        jitter_s: each packet takes up to so much longer.
        tells_3d: whether the lidar sends OBSTACLE_DISTANCE_3D, too.
    """

    autopilot: str
    seed: int
    anchor: tuple[float, float, float]
    home: tuple[float, float, float]
    obstacles: Sequence[Mapping[str, Any]] = ()
    parameters: Mapping[str, float] | None = None
    loss: float = 0.0
    latency_s: float = 0.01
    jitter_s: float = 0.01
    tells_3d: bool = False


class FlightWorld:
    """One vehicle and its links.

    Args:
        spec: what to simulate.

    Raises:
        InputError: the obstacles are wrong.
    """

    def __init__(self, spec: FlightSpec) -> None:
        options = VehicleOptions(
            SYSTEM_ID,
            GeoPoint(*spec.anchor),
            GeoPoint(*spec.home),
            _no_picture,
            seed=spec.seed,
            parameters=tuple((spec.parameters or {}).items()),
            obstacles=parse_obstacles({"obstacles": list(spec.obstacles)}),
            lidar=LidarOptions(tells_3d=spec.tells_3d, seed=spec.seed),
        )
        vehicle = Px4Vehicle if spec.autopilot == "px4" else ArduPilotVehicle
        self._vehicle: SimulatedVehicle = vehicle(options)
        self._ticks = 0
        faults = LinkFaults(loss=spec.loss, delay_s=spec.jitter_s, latency_s=spec.latency_s)
        clock = self._now_s
        self._ends = {
            name: _End(self._vehicle, faults, spec.seed * 10 + 2 * number, clock)
            for number, name in enumerate((STATION, COMPANION))
        }
        self._ends[COMPANION].channel.leads_to_companion = True

    def fly(self, until_s: float, packets: Mapping[str, Sequence[bytes]]) -> tuple[float, Packets]:
        """Send packets to the vehicle now, and let time pass until somebody hears something, or until a time.

        Returns:
            The time then, and what either end hears.
        """
        for name, sent in packets.items():
            for packet in sent:
                self._ends[name].upward.put(packet, self._now_s())
        while True:
            self._ticks += 1
            now_s = self._now_s()
            for end in self._ends.values():
                end.upward.release(now_s)
            self._vehicle.step(LOGIC_S, now_s)
            for end in self._ends.values():
                end.downward.release(now_s)
            if now_s >= until_s or any(end.heard for end in self._ends.values()):
                return now_s, {name: end.take() for name, end in self._ends.items()}

    def truth(self, told: Any = None, /) -> dict[str, Any]:
        """What is so in the end; `shots` are the places (scene ENU) and times of all pictures."""
        del told
        shots = [
            {"position_m": [float(c) for c in shot.exposure.position_m], "time_s": shot.exposure.boot_s}
            for shot in self._vehicle.camera.shots
        ]
        return {**truth(self._vehicle), "shots": shots}

    def _now_s(self) -> float:
        return self._ticks * LOGIC_S


class _End:
    """One link of the vehicle, and what has come out at its far end."""

    def __init__(self, vehicle: SimulatedVehicle, faults: LinkFaults, seed: int, clock: Callable[[], float]) -> None:
        self.heard: list[bytes] = []
        self.downward = FaultyPipe(self.heard.append, faults, seed)
        self.channel = Channel(vehicle.system_id, lambda packet: self.downward.put(packet, clock()), faults)
        self.upward = FaultyPipe(self._arrive, faults, seed + 1)
        self._vehicle = vehicle
        vehicle.add_channel(self.channel)

    def take(self) -> list[bytes]:
        heard = list(self.heard)
        self.heard.clear()
        return heard

    def _arrive(self, packet: bytes) -> None:
        for message in self.channel.receive(packet):
            self._vehicle.handle(message, self.channel)


def _no_picture(exposure: Exposure) -> Future[bytes]:
    picture: Future[bytes] = Future()
    picture.set_result(b"picture %d" % exposure.index)
    return picture
