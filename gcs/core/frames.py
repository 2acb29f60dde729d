"""Coordinate frames: scene ENU, NED and geodetic WGS84.

The scene frame is local ENU in metres about the scenario's anchor. Heights are above mean sea level (EGM96) on both
sides of every transform here; over the few kilometres of a scene the geoid's undulation is constant, so the
ellipsoidal formulas hold with heights above mean sea level in their place.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray


@dataclass(frozen=True)
class GeoPoint:
    """A point on WGS84: latitude and longitude (deg), altitude above mean sea level (m)."""

    latitude_deg: float
    longitude_deg: float
    altitude_m: float


def ned_from_enu(enu: ArrayLike) -> NDArray[np.float64]:
    """Swap to north, east, down; shape (..., 3). Its own inverse."""
    v = np.asarray(enu, dtype=np.float64)
    return np.stack([v[..., 1], v[..., 0], -v[..., 2]], axis=-1)


enu_from_ned = ned_from_enu


def heading_from_yaw(yaw_rad: float) -> float:
    """Compass heading (rad, from north, clockwise, in [0, 2 pi)) of a scene yaw (rad, from east, counter-clockwise)."""
    return float((np.pi / 2 - yaw_rad) % (2 * np.pi))


def yaw_from_heading(heading_rad: float) -> float:
    """Scene yaw (rad, from east, counter-clockwise, in (-pi, pi]) of a compass heading (rad, clockwise from north)."""
    return wrap_angle(np.pi / 2 - heading_rad)


def wrap_angle(angle_rad: float) -> float:
    """The same angle in (-pi, pi]."""
    return float(np.pi - (np.pi - angle_rad) % (2 * np.pi))


def geodetic_from_enu(
    enu_m: ArrayLike, anchor: GeoPoint
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Latitude (deg), longitude (deg) and altitude (m) of scene points.

    Args:
        enu_m: points in the scene frame, m, shape (..., 3).
        anchor: where the scene's origin is.

    Returns:
        Three arrays of shape (...).
    """
    import pymap3d

    e, n, u = np.moveaxis(np.asarray(enu_m, dtype=np.float64), -1, 0)
    lat, lon, alt = pymap3d.enu2geodetic(e, n, u, anchor.latitude_deg, anchor.longitude_deg, anchor.altitude_m)
    return np.asarray(lat), np.asarray(lon), np.asarray(alt)


def enu_from_geodetic(
    latitude_deg: ArrayLike, longitude_deg: ArrayLike, altitude_m: ArrayLike, anchor: GeoPoint
) -> NDArray[np.float64]:
    """Scene points (m, shape (..., 3)) of latitudes (deg), longitudes (deg) and altitudes (m)."""
    import pymap3d

    enu = pymap3d.geodetic2enu(
        np.asarray(latitude_deg, dtype=np.float64),
        np.asarray(longitude_deg, dtype=np.float64),
        np.asarray(altitude_m, dtype=np.float64),
        anchor.latitude_deg,
        anchor.longitude_deg,
        anchor.altitude_m,
    )
    return np.stack([np.asarray(c, dtype=np.float64) for c in enu], axis=-1)


def rigid_between(anchor: GeoPoint, origin: GeoPoint) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Rotation (3, 3) and shift (3,) that take scene ENU about `anchor` to ENU about `origin`: `R @ p + t`."""
    corners = np.vstack([np.zeros(3), np.eye(3)])
    there = enu_from_geodetic(*geodetic_from_enu(corners, anchor), origin)
    return (there[1:] - there[0]).T, there[0]
