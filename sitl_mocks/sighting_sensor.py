"""An observer's sensor: range, pitch and azimuth to another vehicle, told to the station in SIGHTING messages."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sitl_mocks.dialect import Message, mavlink
from sitl_mocks.scene_frame import Array
from sitl_mocks.vehicle import SimulatedVehicle

_EVERY_S = 0.1
_TUNNEL_BYTES = 128
_PAYLOAD_TYPE = 0x8247
_SIGHTING, _SIGHTING_CRC_EXTRA = 62478, 71


@dataclass(frozen=True)
class SensorErrors:
    """Standard deviations of an observer's sensors.

    Attributes:
        range_m: of the range.
        pitch_rad: of the pitch, with that of the observer's attitude.
        azimuth_rad: of the azimuth, likewise.
        place_m: of the observer's own place, on each axis; drawn once, since a receiver's error lasts.
    """

    range_m: float = 0.05
    pitch_rad: float = math.radians(0.3)
    azimuth_rad: float = math.radians(0.3)
    place_m: float = 0.02


class SightingSensor:
    """Sees one vehicle from another.

    Args:
        observer: that carries it.
        seen: gives the vehicle that it looks at.
        errors: of its measurements.
        seed: of what is left to chance.
    """

    def __init__(
        self, observer: SimulatedVehicle, seen: Callable[[], SimulatedVehicle], errors: SensorErrors, seed: int
    ) -> None:
        self._observer = observer
        self._seen = seen
        self._errors = errors
        self._rng = np.random.default_rng(seed)
        self._next_s = 0.0
        observer.airframe.believe(self._rng.normal(0.0, errors.place_m, 3), np.zeros(3))

    def step(self) -> None:
        """Measure and tell, when it is time."""
        observer, errors = self._observer, self._errors
        if observer.time_s < self._next_s:
            return
        self._next_s = observer.time_s + _EVERY_S
        seen = self._seen()
        way = seen.airframe.true_position_m - observer.airframe.true_position_m
        measured = range_pitch_azimuth(way) + self._rng.normal(
            0.0, (errors.range_m, errors.pitch_rad, errors.azimuth_rad)
        )
        observer.broadcast(sighting(observer.boot_ms, seen.system_id, measured, errors))


def range_pitch_azimuth(way_m: Array) -> Array:
    """Distance, angle above the horizon, and angle from north clockwise of a way in ENU; shape (3,)."""
    east, north, up = way_m
    return np.array([np.linalg.norm(way_m), math.atan2(up, math.hypot(east, north)), math.atan2(east, north)])


def sighting(boot_ms: int, seen_system: int, measured: Array, errors: SensorErrors) -> Message:
    """SIGHTING in its tunnel, as `docs/replan_report.md` describes them."""
    deviations = (errors.range_m, errors.pitch_rad, errors.azimuth_rad)
    head = struct.pack("<HB", _SIGHTING, _SIGHTING_CRC_EXTRA)
    payload = head + struct.pack("<I6fB", boot_ms, *measured, *deviations, seen_system)
    return mavlink.MAVLink_tunnel_message(0, 0, _PAYLOAD_TYPE, len(payload), list(payload.ljust(_TUNNEL_BYTES, b"\0")))
