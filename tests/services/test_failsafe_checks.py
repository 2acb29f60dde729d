"""Failsafes held against the scene: what each stack's parameters make the vehicle do, and what is said about it."""

import numpy as np
import pytest

from gcs.core.vehicle import FlightMode
from gcs.core.way_home import OwnAction
from gcs.mavlink.autopilots.ardupilot import ArduPilot
from gcs.mavlink.autopilots.px4 import Px4
from gcs.planning.flights.ways_home import WaysHome
from gcs.services.failsafe_checks import OwnWaysOfVehicle, check_failsafes_along
from gcs.storage.records import FlightPath

MISSION, HOLD, OFFBOARD = FlightMode.MISSION, FlightMode.HOLD, FlightMode.OFFBOARD
UNDER = ((20.0, 30.0),)


def ways(returns=(), landing=(), hold=(), retrace="", settings=""):
    found = WaysHome(not returns, "", returns, None, landing, hold, 30.0, returns)
    return OwnWaysOfVehicle(found, True, retrace, settings, 100.0)


def one(stack, name, values):
    return {f.name: f for f in stack.failsafes(values)}[name]


def judged(stack, name, values, path=FlightPath.MISSION, **blocked):
    (check,) = check_failsafes_along([one(stack, name, values)], ways(**blocked), path)
    return check


@pytest.mark.parametrize(
    ("stack", "name", "values", "actions"),
    [
        (Px4(), "NAV_DLL_ACT", {"NAV_DLL_ACT": 2}, (OwnAction.RETURN,) * 3),
        (
            Px4(),
            "NAV_DLL_ACT",
            {"NAV_DLL_ACT": 2, "COM_DLL_EXCEPT": 3},
            (OwnAction.CONTINUE, OwnAction.HOLD, OwnAction.RETURN),
        ),
        (Px4(), "NAV_RCL_ACT", {"NAV_RCL_ACT": 3, "COM_RCL_EXCEPT": 1}, (OwnAction.CONTINUE,) + (OwnAction.LAND,) * 2),
        (Px4(), "NAV_RCL_ACT", {"NAV_RCL_ACT": 2, "COM_RC_IN_MODE": 4}, (None, None, None)),
        (Px4(), "COM_LOW_BAT_ACT", {"COM_LOW_BAT_ACT": 2}, (OwnAction.LAND,) * 3),
        (Px4(), "COM_OBL_RC_ACT", {"COM_OBL_RC_ACT": 0}, (None, None, OwnAction.LAND)),
        (Px4(), "COM_OBL_RC_ACT", {"COM_OBL_RC_ACT": 5}, (None, None, OwnAction.HOLD)),
        (ArduPilot(), "FS_GCS_ENABLE", {"FS_GCS_ENABLE": 4}, (OwnAction.RETRACE,) * 3),
        (
            ArduPilot(),
            "FS_GCS_ENABLE",
            {"FS_GCS_ENABLE": 1, "FS_OPTIONS": 18},
            (OwnAction.CONTINUE, OwnAction.HOLD, OwnAction.RETURN),
        ),
        (ArduPilot(), "FS_THR_ENABLE", {"FS_THR_ENABLE": 3}, (OwnAction.LAND,) * 3),
        (ArduPilot(), "FS_THR_ENABLE", {"FS_THR_ENABLE": 5, "FS_OPTIONS": 2}, (OwnAction.RETRACE,) * 3),
        (ArduPilot(), "BATT_FS_LOW_ACT", {"BATT_FS_LOW_ACT": 2}, (OwnAction.RETURN,) * 3),
        (ArduPilot(), "BATT_FS_CRT_ACT", {"BATT_FS_CRT_ACT": 1}, (OwnAction.LAND,) * 3),
        (ArduPilot(), "GUID_TIMEOUT", {"GUID_TIMEOUT": 3}, (None, None, OwnAction.HOLD)),
    ],
)
def test_what_parameters_make_the_vehicle_do(stack, name, values, actions):
    found = one(stack, name, values).actions
    assert tuple(found.get(mode) for mode in (MISSION, HOLD, OFFBOARD)) == actions


def test_a_clear_action_is_fine():
    check = judged(Px4(), "NAV_DLL_ACT", {"NAV_DLL_ACT": 2})
    assert check.state == "ok"
    assert judged(Px4(), "NAV_DLL_ACT", {"NAV_DLL_ACT": 3}, returns=UNDER).state == "ok"


def test_a_return_that_would_hit_is_refused_with_what_to_set():
    values = {"NAV_DLL_ACT": 2, "COM_DLL_EXCEPT": 0}
    check = judged(Px4(), "NAV_DLL_ACT", values, returns=UNDER)
    assert check.state == "refused"
    assert "during 10 s of the plan, first at 20 s" in check.detail
    assert check.detail.endswith("set NAV_DLL_ACT 3 (lands) or COM_DLL_EXCEPT 3 (goes on with a mission)")
    both = judged(Px4(), "NAV_DLL_ACT", values, returns=UNDER, landing=UNDER)
    assert both.detail.endswith("set COM_DLL_EXCEPT 3 (goes on with a mission) or NAV_DLL_ACT 1 (holds)")
    offboard = judged(Px4(), "NAV_DLL_ACT", values, FlightPath.OFFBOARD, returns=UNDER, landing=UNDER)
    assert offboard.detail.endswith("set NAV_DLL_ACT 1 (holds)")
    older = judged(Px4(), "NAV_DLL_ACT", {"NAV_DLL_ACT": 2}, returns=UNDER, landing=UNDER)
    assert older.detail.endswith("set NAV_DLL_ACT 1 (holds)"), "without COM_DLL_EXCEPT it cannot be set"


def test_going_on_with_the_mission_is_not_enough_for_its_pauses():
    check = judged(Px4(), "NAV_DLL_ACT", {"NAV_DLL_ACT": 2, "COM_DLL_EXCEPT": 1}, returns=UNDER)
    assert check.state == "refused"
    assert "while it holds" in check.detail
    assert judged(Px4(), "NAV_DLL_ACT", {"NAV_DLL_ACT": 2, "COM_DLL_EXCEPT": 3}, returns=UNDER).state == "ok"


def test_where_no_setting_is_safe_it_is_accepted_by_name():
    values = {"COM_LOW_BAT_ACT": 3}
    check = judged(Px4(), "COM_LOW_BAT_ACT", values, returns=UNDER, landing=UNDER)
    assert check.state == "needs_acceptance"
    assert judged(Px4(), "COM_LOW_BAT_ACT", values, returns=UNDER).state == "refused", "landing would do"


def test_the_last_resort_of_an_empty_battery_is_said_and_not_refused():
    check = judged(ArduPilot(), "BATT_FS_CRT_ACT", {"BATT_FS_CRT_ACT": 1}, landing=UNDER)
    assert check.state == "ok"
    assert check.detail.endswith("during 10 s of the plan, first at 20 s, that would hit the structure")


def test_flying_back_needs_a_memory_that_is_good_enough():
    values = {"FS_GCS_ENABLE": 4}
    assert judged(ArduPilot(), "FS_GCS_ENABLE", values, returns=UNDER, landing=UNDER).state == "ok"
    poor = {"returns": UNDER, "landing": UNDER, "retrace": "2 m accurate", "settings": "SRTL_ACCURACY 0.5"}
    check = judged(ArduPilot(), "FS_GCS_ENABLE", values, **poor)
    assert check.state == "refused"
    assert "2 m accurate: set FS_GCS_ENABLE 4 with SRTL_ACCURACY 0.5 (flies back the way it came)" in check.detail
    never = judged(ArduPilot(), "BATT_FS_LOW_ACT", {"BATT_FS_LOW_ACT": 2}, **{**poor, "settings": None})
    assert never.state == "needs_acceptance"


def test_an_unknown_return_is_safe_from_nowhere():
    found = ways().found
    unknown = OwnWaysOfVehicle(found, False, "", "", 100.0)
    (check,) = check_failsafes_along([one(Px4(), "NAV_DLL_ACT", {"NAV_DLL_ACT": 2})], unknown, FlightPath.MISSION)
    assert check.state == "refused"


def test_a_failsafe_that_is_off_or_unknown_is_as_it_was():
    off = judged(Px4(), "NAV_DLL_ACT", {"NAV_DLL_ACT": 0}, returns=UNDER)
    assert off.state == "needs_acceptance"
    assert judged(Px4(), "NAV_DLL_ACT", {}, returns=UNDER).state == "unknown"


def test_the_fence_is_never_met():
    fence = judged(Px4(), "GF_ACTION", {"GF_ACTION": 3}, returns=UNDER)
    assert fence.state == "ok"


@pytest.mark.parametrize(
    ("values", "level"),
    [
        ({}, 30.0),
        ({"RTL_CONE_ANG": 45, "RTL_MIN_DIST": 10.0, "NAV_ACC_RAD": 2.0}, 6.0),
        ({"RTL_CONE_ANG": 90, "RTL_MIN_DIST": 10.0, "NAV_ACC_RAD": 2.0}, 5.0),
        ({"RTL_CONE_ANG": 0, "RTL_MIN_DIST": 10.0}, 30.0),
        ({"RTL_CONE_ANG": 45, "RTL_MIN_DIST": 5.0}, 30.0),
    ],
)
def test_the_return_of_px4_six_metres_from_home_and_five_up(values, level):
    flight = Px4().limits({"RTL_RETURN_ALT": 30.0, **values}).return_flight
    assert flight.level_m(np.array([5.0]), np.array([6.0]))[0] == pytest.approx(level)


def test_a_return_of_px4_that_is_not_straight_home_is_not_known():
    assert Px4().limits({"RTL_RETURN_ALT": 30.0, "RTL_TYPE": 2}).return_flight is None
    assert Px4().limits({"RTL_RETURN_ALT": 30.0, "RTL_TYPE": 0}).return_flight is not None


@pytest.mark.parametrize(
    ("values", "level"),
    [
        ({"RTL_CONE_SLOPE": 3.0}, 12.0),
        ({"RTL_CONE_SLOPE": 0.4}, 30.0),
        ({"RTL_CONE_SLOPE": 0.0, "RTL_CLIMB_MIN": 2800}, 33.0),
        ({"RTL_CONE_SLOPE": 0.5}, 7.5),
        ({"FENCE_ENABLE": 1, "FENCE_TYPE": 7, "FENCE_ALT_MAX": 22.0, "FENCE_MARGIN": 2.0}, 20.0),
        ({"FENCE_ENABLE": 1, "FENCE_TYPE": 6, "FENCE_ALT_MAX": 22.0, "FENCE_MARGIN": 2.0}, 30.0),
        ({"FENCE_ENABLE": 0, "FENCE_TYPE": 7, "FENCE_ALT_MAX": 22.0}, 30.0),
    ],
)
def test_the_return_of_ardupilot_four_metres_from_home_and_five_up(values, level):
    flight = ArduPilot().limits({"RTL_ALT": 3000.0, **values}).return_flight
    assert flight.level_m(np.array([5.0]), np.array([4.0]))[0] == pytest.approx(level)
