"""A horizontal circle of 20 m radius at 3 m/s by setpoints, and recorded missions, set as the real vehicles were."""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial import cKDTree

from gcs.core.errors import InputError
from gcs.core.vehicle import Autopilot
from gcs.services.benchmarks.flown_records import read_curve, read_flights

RECORDS = Path(__file__).resolve().parents[2] / "../shared/records"
RADIUS_M, SPEED_M_S = 20.0, 3.0
ALL, NO_ACCELERATION, POSITION_ONLY = 0x800, 0x9C0, 0x9F8
STOCK = {
    "px4": {"MPC_ACC_HOR": 3.0, "MPC_JERK_AUTO": 4.0},
    "ardupilot": {"WPNAV_ACCEL": 250.0, "WPNAV_JERK": 5.0},
}


def flown_circle(g, mask, rate_hz, lead_s=0.0):
    """Mean and largest error, lag and outward offset of the second half of a lap and a half."""
    vehicle = g.vehicle
    g.in_air()
    start = np.array(vehicle.frame.local_ned(vehicle.airframe.position_m))
    centre, turn = start - [RADIUS_M, 0.0, 0.0], SPEED_M_S / RADIUS_M

    def target(t):
        ahead = np.array([math.cos(turn * t), math.sin(turn * t), 0.0])
        left = np.array([-ahead[1], ahead[0], 0.0])
        return centre + RADIUS_M * ahead, SPEED_M_S * left, -SPEED_M_S * turn * ahead

    g.setpoint(start)
    if vehicle.kind == "px4":
        assert g.set_mode(6) == [0, 0]
    began_s, due_s, laps_s, flown = vehicle.time_s, 0.0, 1.5 * 2 * math.pi / turn, []
    while (t := vehicle.time_s - began_s) < laps_s:
        if t >= due_s - 1e-6:
            due_s += 1.0 / rate_hz
            g.setpoint(*target(t + lead_s), mask=mask)
        g.run(0.02)
        flown.append((vehicle.time_s - began_s, *vehicle.frame.local_ned(vehicle.airframe.position_m)))
    late = np.array(flown)[len(flown) // 2 :]
    times, place = late[:, 0], late[:, 1:]
    errors = np.linalg.norm(place - [target(t)[0] for t in times], axis=1)
    angle = np.arctan2(place[:, 1] - centre[1], place[:, 0] - centre[0])
    lag = np.angle(np.exp(1j * (turn * times - angle))).mean() / turn
    outward = np.linalg.norm(place[:, :2] - centre[:2], axis=1).mean() - RADIUS_M
    return SimpleNamespace(mean=errors.mean(), most=errors.max(), lag=lag, outward=outward)


@pytest.mark.parametrize(
    ("mask", "rate_hz", "mean_m", "lag_s"),
    [
        (ALL, 20.0, 1.16, 0.27),
        (ALL, 10.0, 1.29, None),
        (ALL, 5.0, 1.64, None),
        (ALL, 2.5, 1.51, None),
        (NO_ACCELERATION, 20.0, 1.17, 0.26),
        (POSITION_ONLY, 20.0, 3.9, 1.3),
    ],
)
def test_px4_is_as_far_off_and_as_late_as_measured(make_ground, mask, rate_hz, mean_m, lag_s):
    flown = flown_circle(make_ground("px4", body="sih", parameters=tuple(STOCK["px4"].items())), mask, rate_hz)
    assert flown.mean == pytest.approx(mean_m, rel=0.27)
    if lag_s is not None:
        assert flown.lag == pytest.approx(lag_s, rel=0.27)


def test_on_px4_a_lead_takes_the_lag_away_and_nothing_else_and_more_setpoints_do_nothing(make_ground):
    usual, led, denser = (
        flown_circle(make_ground("px4", body="sih"), ALL, rate_hz, lead_s)
        for rate_hz, lead_s in ((20.0, 0.0), (20.0, 0.25), (50.0, 0.0))
    )
    assert usual.lag - led.lag == pytest.approx(0.25, abs=0.01)
    assert led.outward == pytest.approx(usual.outward, abs=0.02)
    assert denser.outward == pytest.approx(usual.outward, abs=0.02)
    assert denser.lag == pytest.approx(usual.lag, abs=0.03)


@pytest.mark.parametrize(
    ("mask", "rate_hz", "mean_m", "lag_s"),
    [(ALL, 10.0, 0.18, 0.02), (ALL, 4.0, 0.14, None), (POSITION_ONLY, 10.0, 4.5, 1.5)],
)
def test_ardupilot_is_as_far_off_and_as_late_as_measured(make_ground, mask, rate_hz, mean_m, lag_s):
    flown = flown_circle(make_ground("ardupilot", parameters=tuple(STOCK["ardupilot"].items())), mask, rate_hz)
    assert flown.mean == pytest.approx(mean_m, abs=0.12, rel=0.15)
    assert flown.outward > 0.05 or mask == POSITION_ONLY
    if lag_s is not None:
        assert flown.lag == pytest.approx(lag_s, abs=0.03, rel=0.15)


def recorded_missions():
    """PX4's, as far as they came to their end."""
    try:
        return [pytest.param(f, id=f.name) for f in read_flights(RECORDS, Autopilot.PX4) if not f.stream]
    except InputError:
        return []


@pytest.mark.parametrize("flight", recorded_missions())
def test_a_recorded_px4_mission_takes_the_time_and_keeps_to_the_curve_as_it_did(make_ground, flight):
    curve = read_curve(RECORDS / "px4/dense")
    g = make_ground("px4", body="sih", parameters=tuple(STOCK["px4"].items()))
    vehicle, points = g.vehicle, curve.spaced(flight.spacing_m)
    items = [g.item(0, 6, 22, north=-20.0, east=-20.0, z=float(points[0][2]), current=1)]
    items.append(g.item(1, 2, 178, (1.0, flight.speed_m_s, -1.0, 0.0), x=0, y=0, z=0.0))
    for point in points:
        place = vehicle.frame.geo(vehicle.home_m + point)
        x, y = round(place.latitude_deg * 1e7), round(place.longitude_deg * 1e7)
        items.append(g.item(len(items), 6, 16, (0.0, flight.radius_m, 0.0, math.nan), x=x, y=y, z=float(point[2])))
    assert g.upload(items)[0] == 0
    g.run(2.0)
    g.arm()
    assert g.set_mode(4, 4) == [0, 0]
    g.run_until(lambda: vehicle.run.current > 2)
    began_s, places = vehicle.time_s, []
    g.run_until(lambda: places.append(vehicle.airframe.position_m - vehicle.home_m) or vehicle.run.complete, 400.0)
    deviation = cKDTree(curve.spaced(0.02)).query(np.array(places))[0]
    assert vehicle.time_s - began_s == pytest.approx(flight.time_s, rel=0.2)
    assert deviation.mean() == pytest.approx(0.2, abs=0.15)
    assert deviation.max() < flight.max_deviation_m + 0.1
