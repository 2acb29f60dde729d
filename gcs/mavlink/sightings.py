"""What an observer tells: where it is, how well it knows that, and what it sees of another vehicle. All untrusted."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.frames import GeoPoint, enu_from_ned, yaw_from_heading
from gcs.mavlink.telemetry_decoder import geo_point
from gcs.mavlink.tunnel_carrier import carried

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from gcs.mavlink.dialect import Message


@dataclass(frozen=True, eq=False)
class ObserverPlace:
    """Where the observer was.

    Attributes:
        at_s: its clock (s since boot).
        place: geodetic.
        velocity_m_s: ENU, shape (3,).
    """

    at_s: float
    place: GeoPoint
    velocity_m_s: NDArray[np.float64]


@dataclass(frozen=True)
class ObserverFix:
    """How good its receiver's fix is.

    Attributes:
        fix_type: GPS_FIX_TYPE.
        horizontal_m: deviation of the horizontal position; None when not told.
        vertical_m: of the height, likewise.
    """

    fix_type: int
    horizontal_m: float | None
    vertical_m: float | None


@dataclass(frozen=True)
class SightingReport:
    """A sighting as it came, its numbers not looked at.

    Attributes:
        at_s: the observer's clock (s since boot).
        seen_system: system id of the vehicle that was seen.
        range_m: distance.
        pitch_rad: above the horizon.
        azimuth_rad: from east, counter-clockwise.
        deviations: of range, pitch and azimuth (m, rad, rad).
    """

    at_s: float
    seen_system: int
    range_m: float
    pitch_rad: float
    azimuth_rad: float
    deviations: tuple[float, float, float]


def read_observer(message: Message) -> ObserverPlace | ObserverFix | SightingReport | None:
    """What a message of the observer says of these; None when nothing."""
    kind = message.get_type()
    if kind == "GLOBAL_POSITION_INT":
        place = geo_point(message.lat, message.lon, message.alt * 1e-3)
        velocity = enu_from_ned(np.array([message.vx, message.vy, message.vz]) * 1e-2)
        return None if place is None else ObserverPlace(message.time_boot_ms * 1e-3, place, velocity)
    if kind == "GPS_RAW_INT":
        horizontal_m, vertical_m = (mm * 1e-3 if mm > 0 else None for mm in (message.h_acc, message.v_acc))
        return ObserverFix(int(message.fix_type), horizontal_m, vertical_m)
    inner = carried(message) if kind == "TUNNEL" else None
    if inner is None or inner.get_type() != "SIGHTING":
        return None
    azimuth = yaw_from_heading(inner.azimuth) if math.isfinite(inner.azimuth) else math.nan
    deviations = (inner.range_deviation, inner.pitch_deviation, inner.azimuth_deviation)
    return SightingReport(
        inner.time_boot_ms * 1e-3, int(inner.seen_system), inner.range, inner.pitch, azimuth, deviations
    )
