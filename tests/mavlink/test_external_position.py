"""Positions told to a vehicle, read back from the wire by pymavlink, and the settings that they need."""

import calendar
import math

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.core.errors import RefusedError
from gcs.core.frames import GeoPoint, enu_from_geodetic
from gcs.core.vehicle import Autopilot
from gcs.mavlink.external_position import (
    ExternalPosition,
    external_position_lag,
    external_position_message,
    external_position_parameters,
)

ORIGIN = GeoPoint(31.36, 121.61, 4.0)
COVARIANCE = np.array([[0.04, 0.01, 0.002], [0.01, 0.09, -0.003], [0.002, -0.003, 0.16]])
UTC = calendar.timegm((2020, 1, 1, 0, 0, 0))
FIX = ExternalPosition(
    position_m=np.array([12.0, -7.0, 9.5]),
    velocity_m_s=np.array([0.5, -1.0, 0.25]),
    position_covariance_m2=COVARIANCE,
    velocity_covariance_m2_s2=0.25 * np.eye(3),
    origin=ORIGIN,
    at_vehicle_s=321.5,
    unix_s=UTC + 0.25,
    resets=258,
)


def on_the_wire(autopilot):
    packet = external_position_message(autopilot, FIX).pack(mavlink.MAVLink(None, srcSystem=255))
    return mavlink.MAVLink(None).decode(bytearray(packet))


def test_gps_input_is_the_second_receiver_with_place_velocity_and_accuracies():
    message = on_the_wire(Autopilot.ARDUPILOT)
    assert message.get_type() == "GPS_INPUT"
    assert (message.gps_id, message.ignore_flags, message.fix_type) == (1, 0, 3)
    place = enu_from_geodetic(message.lat * 1e-7, message.lon * 1e-7, message.alt, ORIGIN)
    assert np.allclose(place, FIX.position_m, atol=0.02)
    assert np.allclose([message.ve, message.vn, -message.vd], FIX.velocity_m_s)
    widest = math.sqrt(np.linalg.eigvalsh(COVARIANCE[:2, :2])[-1])
    assert message.horiz_accuracy == pytest.approx(widest)
    assert message.vert_accuracy == pytest.approx(0.4)
    assert message.speed_accuracy == pytest.approx(0.5)
    # The first of January 2020 was a Wednesday, in GPS week 2086; GPS time was 18 s ahead of UTC.
    assert (message.time_week, message.time_week_ms) == (2086, (3 * 86_400 + 18) * 1000 + 250)


def test_vision_position_is_north_east_down_with_its_covariance_and_no_attitude():
    message = on_the_wire(Autopilot.PX4)
    assert message.get_type() == "VISION_POSITION_ESTIMATE"
    assert (message.x, message.y, message.z) == (-7.0, 12.0, -9.5)
    assert message.usec == 321_500_000
    assert message.reset_counter == 258 % 256
    north_north, north_east, north_down, east_east, east_down, down_down = (
        message.covariance[i] for i in (0, 1, 2, 6, 7, 11)
    )
    assert (north_north, east_east, down_down) == pytest.approx((0.09, 0.04, 0.16))
    assert (north_east, north_down, east_down) == pytest.approx((0.01, 0.003, -0.002))
    assert all(math.isnan(angle) for angle in (message.roll, message.pitch, message.yaw))


@pytest.mark.parametrize(
    ("autopilot", "values", "lag_s"),
    [
        (Autopilot.PX4, {"EKF2_EV_CTRL": 3.0, "EKF2_EV_DELAY": 20.0}, 0.02),
        (Autopilot.PX4, {"EKF2_EV_CTRL": 15.0, "EKF2_EV_DELAY": None}, 0.0),
        (Autopilot.ARDUPILOT, {"GPS2_TYPE": 14.0, "GPS_AUTO_SWITCH": 1.0, "GPS2_DELAY_MS": 0.0}, 0.2),
        (Autopilot.ARDUPILOT, {"GPS2_TYPE": 14.0, "GPS_AUTO_SWITCH": 4.0, "GPS2_DELAY_MS": 60.0}, 0.06),
    ],
)
def test_the_parameters_say_for_how_old_a_position_is_taken(autopilot, values, lag_s):
    assert set(external_position_parameters(autopilot)) == set(values)
    assert external_position_lag(autopilot, values) == pytest.approx(lag_s)


@pytest.mark.parametrize(
    ("autopilot", "values", "named"),
    [
        (Autopilot.PX4, {"EKF2_EV_CTRL": 2.0, "EKF2_EV_DELAY": 0.0}, "set EKF2_EV_CTRL 3"),
        (Autopilot.PX4, {"EKF2_EV_CTRL": None, "EKF2_EV_DELAY": 0.0}, "not told"),
        (Autopilot.ARDUPILOT, {"GPS2_TYPE": 0.0, "GPS_AUTO_SWITCH": 1.0, "GPS2_DELAY_MS": 0.0}, "set GPS2_TYPE 14"),
        (Autopilot.ARDUPILOT, {"GPS2_TYPE": 14.0, "GPS_AUTO_SWITCH": 0.0, "GPS2_DELAY_MS": 0.0}, "GPS_AUTO_SWITCH 1"),
    ],
)
def test_a_vehicle_that_would_not_use_them_is_refused_with_what_to_set(autopilot, values, named):
    with pytest.raises(RefusedError, match=named):
        external_position_lag(autopilot, values)


def test_other_flight_stacks_are_told_none():
    with pytest.raises(RefusedError):
        external_position_parameters(Autopilot.GENERIC)
