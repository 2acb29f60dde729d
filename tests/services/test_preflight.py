"""Preflight checks: each safety rule's comparison, with figures on both sides of its limit."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from gcs.core.frames import GeoPoint, geodetic_from_enu
from gcs.core.learned_dynamics import Estimate, LearnedDynamics
from gcs.core.scenario import Battery, parse_scenario
from gcs.core.trajectory import PiecewisePolynomial
from gcs.core.vehicle import BatteryState, Failsafe, Heard, Telemetry, VehicleLimits
from gcs.mavlink.camera_description import CameraDescription
from gcs.services.preflight import (
    check_camera,
    check_datum,
    check_energy,
    check_failsafes,
    check_fix,
    check_limits,
    check_link,
    check_on_ground,
    planned_tilt_rad,
    with_acceptance,
)

HOME = (-20.0, -20.0, 0.0)


@pytest.fixture
def plan():
    scenario = parse_scenario(
        {
            "structure": {"sample": "gantry-crane"},
            "anchor": {"latitude_deg": 31.3622, "longitude_deg": 121.6155, "altitude_m": 4.0},
            "camera": {
                "sensor_width_mm": 13.2,
                "sensor_height_mm": 8.8,
                "focal_length_mm": 8.8,
                "image_width_px": 5472,
                "image_height_px": 3648,
            },
            "home_m": HOME,
            "vehicle": {"battery": {"capacity_wh": 100, "reserve": 0.25}},
        }
    )
    coefficients = np.zeros((1, 8, 3))
    coefficients[0, 1] = [30.0, 40.0, 20.0]  # constant velocity over 10 s: (3, 4, 2) m/s
    return SimpleNamespace(
        scenario=scenario,
        trajectory=PiecewisePolynomial(coefficients, np.array([10.0])),
        certificates=SimpleNamespace(max_acceleration_m_s2=2.0, energy_wh=50.0),
    )


def place(plan, enu):
    latitude, longitude, altitude = geodetic_from_enu(np.asarray(enu, float), plan.scenario.anchor.point)
    return GeoPoint(float(latitude), float(longitude), float(altitude))


def at_home(plan, home=HOME, origin=HOME, local=(0.0, 0.0, 0.0)):
    return Telemetry(
        home=Heard(place(plan, home), 0.0),
        origin=Heard(place(plan, origin), 0.0),
        local_position_m=Heard(np.array(local), 0.0),
    )


def test_the_right_datum_passes(plan):
    assert check_datum(plan, at_home(plan)).state == "ok"


@pytest.mark.parametrize(
    ("off", "state"),
    [
        ((0.9, 0, 0), "ok"),
        ((1.1, 0, 0), "refused"),
        ((0, 0, 0.45), "ok"),
        ((0, 0, 0.55), "refused"),
        ((0, 0, -3), "refused"),
    ],
)
def test_home_must_be_where_the_scene_has_it(plan, off, state):
    check = check_datum(plan, at_home(plan, home=tuple(np.add(HOME, off))))
    assert check.state == state


def test_an_origin_that_is_3_m_off_in_height_is_refused(plan):
    check = check_datum(plan, at_home(plan, origin=(-20.0, -20.0, 3.0)))
    assert check.state == "refused"
    assert "GPS_GLOBAL_ORIGIN" in check.detail
    assert "+3.00 m" in check.detail


def test_an_origin_elsewhere_is_fine_when_the_local_position_fits(plan):
    assert check_datum(plan, at_home(plan, origin=(-60.0, -20.0, 0.0), local=(40.0, 0.0, 0.0))).state == "ok"


def test_an_unknown_home_is_refused(plan):
    assert check_datum(plan, Telemetry()).state == "refused"


def limits(**changes):
    values = {
        "max_speed_m_s": 6.0,
        "max_climb_m_s": 3.0,
        "max_descent_m_s": 1.0,
        "max_acceleration_m_s2": 3.0,
        "offboard_timeout_s": 1.0,
        "return_altitude_m": 30.0,
        "max_tilt_rad": math.radians(45.0),
    }
    return VehicleLimits(**(values | changes))


@pytest.mark.parametrize(
    ("changes", "bad"),
    [
        ({}, set()),
        ({"max_speed_m_s": 4.9}, {"horizontal speed"}),
        ({"max_climb_m_s": 1.9}, {"climb speed"}),
        ({"max_acceleration_m_s2": 1.5}, {"acceleration"}),
    ],
)
def test_a_plan_beyond_the_vehicles_limits_is_refused(plan, changes, bad):
    assert {c.name for c in check_limits(plan, limits(**changes)) if c.state == "refused"} == bad


def test_descents_are_compared_with_the_descent_limit(plan):
    down = SimpleNamespace(
        trajectory=PiecewisePolynomial(-plan.trajectory.coefficients, plan.trajectory.durations_s),
        certificates=plan.certificates,
    )
    assert {c.name for c in check_limits(down, limits()) if c.state == "refused"} == {"descent speed"}


def test_an_unknown_limit_is_said_as_unknown_and_can_only_be_accepted_by_name(plan):
    checks = check_limits(plan, limits(max_climb_m_s=None))
    (unknown,) = [c for c in checks if c.state == "unknown"]
    assert [c.state for c in with_acceptance([unknown], [])] == ["unknown"]
    assert [c.state for c in with_acceptance([unknown], ["climb speed"])] == ["accepted"]


def pushed(plan, acceleration, seconds=2.0):
    """The plan with a constant acceleration from rest."""
    coefficients = np.zeros((1, 8, 3))
    coefficients[0, 2] = 0.5 * np.asarray(acceleration) * seconds**2
    return SimpleNamespace(**vars(plan) | {"trajectory": PiecewisePolynomial(coefficients, np.array([seconds]))})


def drag_of(value):
    return LearnedDynamics(drag=Estimate(value, 0.02))


def tilt_check(plan, limit_rad, learned):
    (check,) = [c for c in check_limits(plan, limits(max_tilt_rad=limit_rad), learned) if c.name == "tilt"]
    return check


@pytest.mark.parametrize(
    ("acceleration", "drag"),
    [((2.0, 0.0, 0.0), 0.0), ((1.2, -1.6, 0.0), 0.0), ((2.0, 0.0, 0.0), 1.0), ((1.5, 0.0, -1.5), 0.5)],
)
def test_a_plan_that_leans_further_than_the_vehicle_is_refused(plan, acceleration, drag):
    """At the end of the push: `tan(tilt) = |a + k v| / (g + a_z + k v_z)`, v = 2 s a."""
    force = np.asarray(acceleration) * (1.0 + 2.0 * drag)
    tilt = math.atan2(math.hypot(force[0], force[1]), 9.80665 + force[2])
    assert planned_tilt_rad(pushed(plan, acceleration), drag) == pytest.approx(tilt, abs=1e-6)
    reserve = math.radians(5.0)
    for over, state in ((0.01, "ok"), (-0.01, "refused")):
        check = tilt_check(pushed(plan, acceleration), tilt + reserve + over, drag_of(drag))
        assert check.state == state
        assert f"{math.degrees(tilt):.0f}°" in check.detail


def test_a_plan_within_every_other_limit_is_refused_for_the_drag_that_a_flight_showed(plan):
    fast = pushed(plan, (2.0, 0.0, 0.0))
    narrow = math.radians(25.0)
    assert tilt_check(fast, narrow, drag_of(0.0)).state == "ok"
    checks = check_limits(fast, limits(max_tilt_rad=narrow), drag_of(1.0))
    assert [c.name for c in checks if c.state != "ok"] == ["tilt"]
    assert with_acceptance(checks, ["tilt"])[-1].state == "refused", "nobody can accept it"


def test_for_a_drag_that_is_only_usual_a_plan_must_be_accepted(plan):
    """2 m/s² alone lean by 12°; with a usual drag, up to 4 m/s, by 19°."""
    fast, unknown = pushed(plan, (2.0, 0.0, 0.0)), LearnedDynamics()
    states = [tilt_check(fast, math.radians(limit), unknown).state for limit in (25.0, 22.0, 15.0)]
    assert states == ["ok", "needs_acceptance", "refused"]


def test_a_tilt_that_the_vehicle_does_not_tell_is_unknown(plan):
    assert tilt_check(plan, None, LearnedDynamics()).state == "unknown"


def test_a_failsafe_that_is_off_must_be_accepted_by_its_name():
    off = Failsafe("NAV_DLL_ACT", "ground-station loss", 0.0, False, "does nothing")
    on = Failsafe("NAV_RCL_ACT", "RC loss", 2.0, True, "returns")
    unknown = Failsafe("GF_ACTION", "fence", None, None, "not told")
    checks = check_failsafes([off, on, unknown])
    assert [c.state for c in checks] == ["needs_acceptance", "ok", "unknown"]
    assert [c.state for c in with_acceptance(checks, ["NAV_RCL_ACT"])] == ["needs_acceptance", "ok", "unknown"]
    assert [c.state for c in with_acceptance(checks, ["NAV_DLL_ACT", "GF_ACTION"])] == ["accepted", "ok", "accepted"]


def test_what_is_refused_cannot_be_accepted(plan):
    refused = check_datum(plan, Telemetry())
    assert with_acceptance([refused], [refused.name])[0].state == "refused"


@pytest.mark.parametrize(("left", "state"), [(0.76, "ok"), (0.74, "refused"), (None, "refused")])
def test_the_battery_must_hold_the_plan_and_the_reserve(plan, left, state):
    telemetry = Telemetry(battery=Heard(BatteryState(left, None, None), 0.0))
    assert check_energy(plan, telemetry).state == state


def test_a_flight_that_takes_longer_than_the_plan_needs_more_of_the_battery(plan):
    telemetry = Telemetry(battery=Heard(BatteryState(0.9, None, None), 0.0))
    assert check_energy(plan, telemetry, 0.5 * plan.trajectory.duration_s).state == "ok"
    longer = (0.9 - 0.25) / 0.5  # what is left less the reserve, over what the plan takes
    assert check_energy(plan, telemetry, 0.98 * longer * plan.trajectory.duration_s).state == "ok"
    assert check_energy(plan, telemetry, 1.02 * longer * plan.trajectory.duration_s).state == "refused"


def test_without_a_battery_in_the_scenario_there_is_nothing_to_compare(plan):
    vehicle = plan.scenario.vehicle.model_copy(update={"battery": None})
    bare = SimpleNamespace(
        scenario=plan.scenario.model_copy(update={"vehicle": vehicle}), certificates=plan.certificates
    )
    assert check_energy(bare, Telemetry()).state == "ok"
    assert Battery(capacity_wh=1).reserve == 0.25


def test_link_fix_and_arming():
    heard = Telemetry(armed=Heard(False, 9.0), gps_fix=Heard(3, 9.0))
    assert check_link(heard, 9.0, 10.0).state == "ok"
    assert check_link(heard, 0.0, 10.0).state == "refused"
    assert check_fix(heard).state == "ok"
    assert check_fix(Telemetry(gps_fix=Heard(2, 9.0))).state == "refused"
    assert check_fix(Telemetry()).state == "unknown"
    assert check_on_ground(heard).state == "ok"
    assert check_on_ground(Telemetry(armed=Heard(True, 9.0))).state == "refused"


@pytest.mark.parametrize(
    ("camera", "state", "word"),
    [
        (CameraDescription(), "ok", "camera"),
        (
            CameraDescription(name="A", takes_images=True, in_image_mode=True, storage_ready=True, free_mib=900),
            "ok",
            "A",
        ),
        (CameraDescription(takes_images=False), "needs_acceptance", "no images"),
        (CameraDescription(in_image_mode=False), "needs_acceptance", "video"),
        (CameraDescription(storage_ready=False), "needs_acceptance", "formatted"),
        (CameraDescription(free_mib=3.0), "needs_acceptance", "full"),
    ],
)
def test_a_camera_that_cannot_keep_pictures_must_be_accepted(camera, state, word):
    check = check_camera(100, camera)
    assert check.state == state
    assert word in check.detail
    assert check_camera(None, camera).state == "ok"
