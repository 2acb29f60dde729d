"""Frames against hand-made cases and against the definition of WGS84."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs.core.frames import (
    GeoPoint,
    enu_from_geodetic,
    geodetic_from_enu,
    heading_from_yaw,
    ned_from_enu,
    rigid_between,
    wrap_angle,
    yaw_from_heading,
)

ANCHOR = GeoPoint(31.3622, 121.6155, 4.0)


def test_ned_swaps_axes_and_is_its_own_inverse():
    enu = np.array([[1.0, 2.0, 3.0], [-4.0, 5.0, -6.0]])
    np.testing.assert_array_equal(ned_from_enu(enu), [[2, 1, -3], [5, -4, 6]])
    np.testing.assert_array_equal(ned_from_enu(ned_from_enu(enu)), enu)


def test_yaw_and_heading_at_the_compass_points():
    east, north, west = 0.0, math.pi / 2, math.pi
    assert heading_from_yaw(east) == pytest.approx(math.pi / 2)
    assert heading_from_yaw(north) == pytest.approx(0.0)
    assert heading_from_yaw(west) == pytest.approx(3 * math.pi / 2)


@given(st.floats(-20, 20))
def test_heading_and_yaw_are_inverse(yaw):
    assert wrap_angle(yaw_from_heading(heading_from_yaw(yaw)) - yaw) == pytest.approx(0.0, abs=1e-9)


def test_a_metre_north_is_the_meridian_radius_of_curvature():
    a, e2 = 6378137.0, 6.69437999014e-3
    lat = math.radians(ANCHOR.latitude_deg)
    radius = a * (1 - e2) / (1 - e2 * math.sin(lat) ** 2) ** 1.5 + ANCHOR.altitude_m
    latitude, longitude, altitude = geodetic_from_enu([0.0, 1.0, 0.0], ANCHOR)
    assert math.radians(float(latitude) - ANCHOR.latitude_deg) * radius == pytest.approx(1.0, rel=1e-6)
    assert float(longitude) == pytest.approx(ANCHOR.longitude_deg, abs=1e-12)
    assert float(altitude) == pytest.approx(ANCHOR.altitude_m, abs=1e-5)


def test_there_and_back_again():
    enu = np.random.default_rng(1).uniform(-2000, 2000, (50, 3))
    np.testing.assert_allclose(enu_from_geodetic(*geodetic_from_enu(enu, ANCHOR), ANCHOR), enu, atol=1e-6)


def test_the_way_between_two_local_frames_is_rigid_and_exact():
    origin = GeoPoint(31.3655, 121.6122, 9.0)
    rotation, shift = rigid_between(ANCHOR, origin)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-7)
    p = np.array([120.0, -80.0, 60.0])
    np.testing.assert_allclose(
        rotation @ p + shift, enu_from_geodetic(*geodetic_from_enu(p, ANCHOR), origin), atol=1e-4
    )
