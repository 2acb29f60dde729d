"""Two vehicles on fake time, one of which flies where no satellites are received while the other one looks at it.

Both share one link with the station, as two vehicles on one radio do.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from concurrent.futures import Future
from dataclasses import dataclass
from typing import Any

import numpy as np

from gcs.core.frames import GeoPoint
from sitl_mocks.ardupilot import ArduPilotVehicle
from sitl_mocks.channel import Channel, FaultyPipe, LinkFaults
from sitl_mocks.dialect import mavlink
from sitl_mocks.positioning import Box
from sitl_mocks.px4 import Px4Vehicle
from sitl_mocks.scene_frame import SceneFrame
from sitl_mocks.sighting_sensor import SensorErrors, SightingSensor
from sitl_mocks.vehicle import LOGIC_S, SimulatedVehicle
from sitl_mocks.vehicle_options import VehicleOptions

INSPECTOR, OBSERVER = 1, 2
_KINDS: dict[str, type[SimulatedVehicle]] = {"px4": Px4Vehicle, "ardupilot": ArduPilotVehicle}
_READY_S = 3.0
_MOST_CLIMB_S = 60.0
_RECORD_EVERY_S = 0.1


@dataclass(frozen=True)
class CooperativeSpec:
    """What to simulate.

    Attributes:
        autopilot: px4 or ardupilot, of both.
        anchor: latitude, longitude (deg) and altitude (m) of the scene's origin.
        inspector_m: where the inspecting vehicle hovers at first, scene ENU; the ground is at height 0.
        observer_m: where the other one hovers all the time.
        hidden: boxes without satellites.
        seed: of all that is left to chance.
        parameters: of the inspecting vehicle.
        loss: of packets, each way.
        latency_s: of the link, one way.
        jitter_s: each packet takes up to so much longer.
        errors: of the observer, fields of `SensorErrors`.
    """

    autopilot: str
    anchor: tuple[float, float, float]
    inspector_m: tuple[float, float, float]
    observer_m: tuple[float, float, float]
    hidden: tuple[Box, ...]
    seed: int
    parameters: tuple[tuple[str, float], ...] = ()
    loss: float = 0.0
    latency_s: float = 0.025
    jitter_s: float = 0.01
    errors: tuple[tuple[str, float], ...] = ()


class CooperativeWorld:
    """The two vehicles and their link.

    Args:
        spec: what to simulate.
    """

    def __init__(self, spec: CooperativeSpec) -> None:
        self.now_s = 0.0
        self._faults = LinkFaults(loss=spec.loss, latency_s=spec.latency_s, delay_s=spec.jitter_s)
        self._to_station: list[bytes] = []
        self._down = FaultyPipe(self._to_station.append, self._faults, spec.seed * 2 + 1)
        self._up = FaultyPipe(self._arrive, self._faults, spec.seed * 2 + 2)
        self._vehicles: list[SimulatedVehicle] = []
        self._channels: list[Channel] = []
        self._parser = mavlink.MAVLink(None)
        self._track: list[tuple[float, ...]] = []
        self._stepped_s = 0.0
        for system, place, parameters in (
            (INSPECTOR, spec.inspector_m, spec.parameters),
            (OBSERVER, spec.observer_m, ()),
        ):
            self._vehicles.append(_hovering(spec, system, place, parameters))
        for vehicle in self._vehicles:
            channel = Channel(vehicle.system_id, lambda packet: self._down.put(packet, self.now_s))
            vehicle.add_channel(channel)
            self._channels.append(channel)
        inspector, observer = self._vehicles
        errors = SensorErrors(**dict(spec.errors))
        self._sensor = SightingSensor(observer, lambda: inspector, errors, spec.seed)

    def pass_time(self, until_s: float, packets: Sequence[bytes]) -> tuple[float, list[bytes]]:
        """Send packets to both vehicles now, and let time pass until a time.

        Returns:
            The time then, and what the station hears.
        """
        for packet in packets:
            self._up.put(packet, self.now_s)
        while self.now_s < until_s - 1e-9:
            self.now_s = min(until_s, self._stepped_s + LOGIC_S)
            self._up.release(self.now_s)
            for vehicle in self._vehicles:
                vehicle.step(self.now_s - self._stepped_s, vehicle.wall_s + self.now_s - self._stepped_s)
            self._stepped_s = self.now_s
            self._sensor.step()
            self._down.release(self.now_s)
            self._record()
        heard = list(self._to_station)
        self._to_station.clear()
        return self.now_s, heard

    def truth(self, _: object) -> dict[str, Any]:
        """`track`: time, true position and believed position of the inspecting vehicle; `mode` that it ended in."""
        return {"track": self._track, "mode": self._vehicles[0].mode_name()}

    def _record(self) -> None:
        airframe = self._vehicles[0].airframe
        if not self._track or self.now_s - self._track[-1][0] >= _RECORD_EVERY_S - 1e-9:
            places = (*airframe.true_position_m.tolist(), *airframe.position_m.tolist())
            self._track.append((self.now_s, *places))

    def _arrive(self, packet: bytes) -> None:
        try:
            message = self._parser.decode(bytearray(packet))
        except (mavlink.MAVError, struct.error):
            return
        for vehicle, channel in zip(self._vehicles, self._channels, strict=True):
            vehicle.handle(message, channel)


def _hovering(
    spec: CooperativeSpec, system: int, place: tuple[float, float, float], parameters: tuple[tuple[str, float], ...]
) -> SimulatedVehicle:
    """A vehicle that has climbed to its place.

    Raises:
        RuntimeError: it has not.
    """
    anchor = GeoPoint(*spec.anchor)
    home = SceneFrame(anchor, anchor).geo(np.array([place[0], place[1], 0.0]))
    vehicle = _KINDS[spec.autopilot](
        VehicleOptions(
            system,
            anchor,
            home,
            draw=lambda _: Future(),
            seed=spec.seed * 10 + system,
            parameters=tuple((name, value) for name, value in parameters),
            hidden=spec.hidden,
        )
    )
    wall_s = 0.0
    while wall_s < _READY_S:
        wall_s += LOGIC_S
        vehicle.step(LOGIC_S, wall_s)
    vehicle.arm()
    vehicle.flight.take_off_to(place[2])
    while vehicle.flight.landed or abs(float(vehicle.airframe.position_m[2]) - place[2]) > 0.1:
        wall_s += LOGIC_S
        vehicle.step(LOGIC_S, wall_s)
        if wall_s > _MOST_CLIMB_S:
            raise RuntimeError(f"vehicle {system} has not climbed to {place[2]:g} m")
    return vehicle
