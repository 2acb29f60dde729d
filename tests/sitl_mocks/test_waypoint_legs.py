"""Missions of dense waypoints on the ArduPilot-like vehicle, set as the real one is: as slow as that was measured."""

from pathlib import Path

import numpy as np
import pytest

from gcs.core.errors import InputError
from gcs.core.vehicle import Autopilot
from gcs.services.benchmarks.flown_records import read_curve, read_flights
from sitl_mocks.waypoint_legs import WaypointLeg, leg_speed_m_s

RECORDS = Path(__file__).resolve().parents[2] / "../shared/records"
AS_THE_REAL_ONE = {"WPNAV_JERK": 1.0, "WPNAV_ACCEL": 250.0, "WPNAV_ACCEL_Z": 100.0}
ZERO = (0.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("spacing_m", "jerk_m_s3", "speed_m_s"),
    [(1.0, 1.0, 0.55), (2.0, 1.0, 0.90), (4.0, 1.0, 1.46), (1.0, 5.0, 0.85), (4.0, 5.0, 2.15)],
)
def test_dense_waypoints_are_crawled_along(make_ground, spacing_m, jerk_m_s3, speed_m_s):
    g = make_ground("ardupilot", parameters=tuple((AS_THE_REAL_ONE | {"WPNAV_JERK": jerk_m_s3}).items()))
    fly(g, [[0.0, 5.0 + spacing_m * k, 10.0] for k in range(round(45.0 / spacing_m) + 1)])
    y = g.vehicle.airframe.position_m[1]
    g.run_until(lambda: g.vehicle.airframe.position_m[1] > y + 10.0)
    begin_s, begin_m = g.vehicle.time_s, g.vehicle.airframe.position_m[1]
    slowest = []
    while g.vehicle.airframe.position_m[1] < begin_m + 24.0:
        g.run(0.2)
        slowest.append(g.vehicle.airframe.velocity_m_s[1])
    assert 24.0 / (g.vehicle.time_s - begin_s) == pytest.approx(speed_m_s, rel=0.06)
    assert min(slowest) > 0.8 * speed_m_s  # it never stops


def flights():
    """The recorded missions of straight legs."""
    try:
        every = read_flights(RECORDS, Autopilot.ARDUPILOT)
    except InputError:
        return []
    return [pytest.param(flight, id=flight.name) for flight in every if not (flight.stream or flight.curved)]


@pytest.mark.parametrize("flight", flights())
def test_a_recorded_mission_takes_the_time_that_it_took(make_ground, flight):
    law, curve = flight.law, read_curve(RECORDS / "ardupilot/dense")
    parameters = {
        "WPNAV_JERK": law.jerk_m_s3,
        "WPNAV_ACCEL": 100.0 * law.acceleration_m_s2,
        "WPNAV_ACCEL_Z": 100.0 * law.vertical_acceleration_m_s2,
        "WPNAV_SPEED_UP": 100.0 * law.climb_m_s,
        "WPNAV_SPEED_DN": 100.0 * law.descent_m_s,
    }
    g = make_ground("ardupilot", parameters=tuple(parameters.items()))
    points = curve.spaced(flight.spacing_m) if flight.spacing_m else curve.with_chord_error(flight.chord_error_m)
    first = fly(g, points, flight.speed_m_s)
    g.run_until(lambda: g.vehicle.run.current > first, 200.0)
    begin_s = g.vehicle.time_s
    g.run_until(lambda: g.vehicle.run.state == 5, 2.0 * flight.time_s)
    # Legs of 8 m around bends of 3 m radius meet at sharp corners, at which the simulated vehicle nearly stops.
    share = 0.3 if flight.spacing_m and flight.spacing_m > 5.0 else 0.2
    assert g.vehicle.time_s - begin_s == pytest.approx(flight.time_s, rel=share)


def fly(g, points, speed_m_s=10.0):
    """Begin a mission over places in metres about home; returns the number of its first waypoint."""
    vehicle = g.vehicle
    items = [g.item(0, 0, 16), g.item(1, 3, 22, ZERO, z=float(points[0][2]))]
    items += [g.item(1 + k, 0, 178, (float(k), speed_m_s, -1.0, 0.0), x=0, y=0, z=0.0) for k in (1, 2, 3)]
    for point in points:
        place = vehicle.frame.geo(vehicle.home_m + np.asarray(point))
        x, y = round(place.latitude_deg * 1e7), round(place.longitude_deg * 1e7)
        items.append(g.item(len(items), 3, 16, ZERO, x=x, y=y, z=float(point[2])))
    assert g.upload(items)[0] == 0
    g.set_mode(4)
    g.arm()
    g.set_mode(3)
    g.command(300)
    return len(items) - len(points)


@pytest.mark.parametrize(("jerk_m_s3", "factor"), [(1.0, 0.57), (5.0, 0.5), (20.0, 0.38)])
def test_the_law(jerk_m_s3, factor):
    for length_m in (1.0, 2.0, 8.0):
        expected = factor * (jerk_m_s3 * length_m**2) ** (1 / 3)
        assert leg_speed_m_s(length_m, jerk_m_s3) == pytest.approx(expected, rel=1e-9)


def test_a_leg_is_passed_where_the_turn_is_half_over():
    leg = WaypointLeg(np.zeros(3), np.array([10.0, 0.0, 0.0]), np.array([18.0, 6.0, 0.0]))
    assert not leg.is_passed(np.array([9.8, 0.5, 0.0]))
    assert leg.is_passed(np.array([9.9, 0.5, 0.0]))
    back = WaypointLeg(np.zeros(3), np.array([10.0, 0.0, 0.0]), np.zeros(3))
    assert not back.is_passed(np.array([9.6, 0.0, 0.0]))
    assert back.is_passed(np.array([9.8, 0.0, 0.0]))
