"""Where the scene lies on the earth, in the integers and datums of MAVLink."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gcs.core.frames import GeoPoint, enu_from_geodetic, geodetic_from_enu

Array = NDArray[np.float64]


class SceneFrame:
    """Scene ENU about the anchor, the earth, and the vehicle's local frame about its estimator's origin.

    Args:
        anchor: where the scene's origin is.
        origin: where the estimator started; its local frame is north-east-down about this point.
    """

    def __init__(self, anchor: GeoPoint, origin: GeoPoint) -> None:
        self.anchor = anchor
        self.origin = origin
        self.origin_m = self.scene(origin.latitude_deg, origin.longitude_deg, origin.altitude_m)

    def scene(self, latitude_deg: float, longitude_deg: float, altitude_m: float) -> Array:
        """Scene ENU of a geodetic point."""
        point: Array = enu_from_geodetic(latitude_deg, longitude_deg, altitude_m, self.anchor)
        return point

    def scene_e7(self, latitude_e7: int, longitude_e7: int, altitude_m: float) -> Array:
        """Scene ENU of a point in MAVLink's 1e-7 degrees."""
        return self.scene(latitude_e7 * 1e-7, longitude_e7 * 1e-7, altitude_m)

    def geo(self, scene_m: Array) -> GeoPoint:
        """Geodetic point of scene ENU."""
        latitude, longitude, altitude = geodetic_from_enu(scene_m, self.anchor)
        return GeoPoint(float(latitude), float(longitude), float(altitude))

    def local_ned(self, scene_m: Array) -> tuple[float, float, float]:
        """Position about the estimator's origin, north, east, down."""
        e, n, u = scene_m - self.origin_m
        return float(n), float(e), float(-u)

    def scene_from_local_ned(self, north_m: float, east_m: float, down_m: float) -> Array:
        """Scene ENU of a point in the vehicle's local frame."""
        point: Array = self.origin_m + np.array([east_m, north_m, -down_m])
        return point


def e7(degrees: float) -> int:
    """Degrees as MAVLink's 1e-7 degrees."""
    return round(degrees * 1e7)
