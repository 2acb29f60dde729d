"""What an observer tells, from the wire; the simulated sensor that packs sightings shares no code with the reader."""

import math

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.mavlink.sightings import ObserverFix, ObserverPlace, SightingReport, read_observer
from sitl_mocks.sighting_sensor import SensorErrors, range_pitch_azimuth, sighting


def heard(message):
    packet = message.pack(mavlink.MAVLink(None, srcSystem=2, srcComponent=1))
    return mavlink.MAVLink(None).decode(bytearray(packet))


def test_a_sighting_is_read_in_scene_angles():
    errors = SensorErrors(0.05, 0.004, 0.006)
    way = np.array([3.0, -4.0, 1.0])
    report = read_observer(heard(sighting(12_345, 1, range_pitch_azimuth(way), errors)))
    assert isinstance(report, SightingReport)
    assert (report.at_s, report.seen_system) == (12.345, 1)
    level = math.cos(report.pitch_rad)
    towards = [level * math.cos(report.azimuth_rad), level * math.sin(report.azimuth_rad), math.sin(report.pitch_rad)]
    assert np.allclose(report.range_m * np.array(towards), way, atol=1e-5)
    assert report.deviations == pytest.approx((0.05, 0.004, 0.006))


def test_place_and_fix_of_the_observer_are_read():
    place = read_observer(
        heard(
            mavlink.MAVLink_global_position_int_message(7_000, 313_000_000, 1_216_000_000, 12_000, 0, 100, 200, -50, 0)
        )
    )
    assert isinstance(place, ObserverPlace)
    assert (place.at_s, place.place.latitude_deg, place.place.altitude_m) == pytest.approx((7.0, 31.3, 12.0))
    assert np.allclose(place.velocity_m_s, [2.0, 1.0, 0.5])
    raw = mavlink.MAVLink_gps_raw_int_message(0, 6, 1, 1, 0, 0, 0, 0, 0, 14, h_acc=20, v_acc=30)
    assert read_observer(heard(raw)) == ObserverFix(6, 0.02, 0.03)
    silent = mavlink.MAVLink_gps_raw_int_message(0, 3, 1, 1, 0, 0, 0, 0, 0, 14)
    assert read_observer(heard(silent)) == ObserverFix(3, None, None)


def test_what_is_none_of_these_or_damaged_says_nothing():
    good = sighting(0, 1, np.array([5.0, 0.0, 0.0]), SensorErrors())
    assert read_observer(heard(good)) is not None
    wrong_type = mavlink.MAVLink_tunnel_message(0, 0, 7, good.payload_length, good.payload)
    no_number = mavlink.MAVLink_tunnel_message(0, 0, good.payload_type, good.payload_length, [9, *good.payload[1:]])
    empty = mavlink.MAVLink_tunnel_message(0, 0, good.payload_type, 0, [0] * 128)
    no_fix = mavlink.MAVLink_global_position_int_message(7_000, 0, 0, 0, 0, 0, 0, 0, 0)
    for message in (wrong_type, no_number, empty, no_fix, mavlink.MAVLink_attitude_message(0, 0, 0, 0, 0, 0, 0)):
        assert read_observer(heard(message)) is None


def test_numbers_that_are_none_come_through_to_be_refused():
    report = read_observer(heard(sighting(0, 1, np.array([math.nan, math.inf, math.nan]), SensorErrors())))
    assert isinstance(report, SightingReport)
    assert math.isnan(report.range_m)
    assert math.isnan(report.azimuth_rad)
