"""Failsafes that the operator has set: on a vehicle that is a dictionary."""

from types import SimpleNamespace

import pytest

from gcs.core.errors import InputError, RefusedError
from gcs.mavlink.autopilots.ardupilot import ArduPilot
from gcs.mavlink.autopilots.px4 import Px4
from gcs.services.failsafe_settings import set_failsafes, wanted_settings
from gcs.services.preflight import check_failsafes, with_acceptance

SIX = {"ground-station loss", "RC loss", "battery", "fence", "offboard loss", "return"}


class Vehicle:
    def __init__(self, armed=False, **values):
        self.values = values
        self.identity = SimpleNamespace(name="px4-1")
        self.telemetry = SimpleNamespace(armed=SimpleNamespace(value=armed))
        self.failsafe_parameters = tuple(values)
        self.set = []

    async def read_parameters(self, names):
        return {name: self.values[name] for name in names}

    async def set_parameter(self, name, value):
        self.set.append((name, value))
        self.values[name] = value
        return value


async def test_what_is_asked_for_is_set_once_and_told():
    vehicle, told = Vehicle(NAV_DLL_ACT=0.0), []
    for _ in range(2):
        await set_failsafes(vehicle, ("NAV_RCL_ACT", "NAV_DLL_ACT=2"), told.append)
    assert vehicle.set == [("NAV_DLL_ACT", 2.0)]
    assert told == ["NAV_DLL_ACT of px4-1 was set from 0 to 2, as the operator asked"]


async def test_only_failsafes_are_set_and_only_on_the_ground():
    with pytest.raises(RefusedError, match="no failsafe"):
        await set_failsafes(Vehicle(NAV_DLL_ACT=0.0), ("SYS_AUTOSTART=1",), print)
    vehicle = Vehicle(armed=True, NAV_DLL_ACT=0.0)
    with pytest.raises(RefusedError, match="disarm"):
        await set_failsafes(vehicle, ("NAV_DLL_ACT=2",), print)
    assert vehicle.set == []


@pytest.mark.parametrize("entry", ["NAV_DLL_ACT=", "NAV_DLL_ACT=on", "NAV_DLL_ACT=nan", "NAV_DLL_ACT=inf"])
def test_what_is_no_number(entry):
    with pytest.raises(InputError, match="accept"):
        wanted_settings([entry])


def test_asking_for_a_setting_does_not_accept_that_it_is_off():
    checks = check_failsafes(Px4().failsafes({"NAV_DLL_ACT": 0.0}))
    (off,) = [c for c in with_acceptance(checks, ("NAV_DLL_ACT=2",)) if c.name == "NAV_DLL_ACT"]
    assert off.state == "needs_acceptance"
    assert "accept NAV_DLL_ACT=2" in off.detail


@pytest.mark.parametrize("stack", [Px4(), ArduPilot()])
def test_all_six_are_read_and_said_whatever_the_vehicle_tells(stack):
    for values in ({}, dict.fromkeys(stack.failsafe_parameters, 0.0), dict.fromkeys(stack.failsafe_parameters, 1.0)):
        failsafes = stack.failsafes(values)
        assert {f.about for f in failsafes} >= SIX
        checks = check_failsafes(failsafes)
        for f, check in zip(failsafes, checks, strict=True):
            assert check.state == {True: "ok", False: "needs_acceptance", None: "unknown"}[f.active]
            assert f.about in check.detail


@pytest.mark.parametrize(
    ("stack", "off", "about"),
    [
        (Px4(), {"NAV_DLL_ACT": 0}, "ground-station loss"),
        (Px4(), {"NAV_RCL_ACT": 0}, "RC loss"),
        (Px4(), {"COM_RC_IN_MODE": 4, "NAV_RCL_ACT": 2}, "RC loss"),
        (Px4(), {"COM_LOW_BAT_ACT": 0}, "battery"),
        (Px4(), {"GF_ACTION": 0}, "fence"),
        (Px4(), {"GF_ACTION": 1}, "fence"),
        (ArduPilot(), {"FS_GCS_ENABLE": 0}, "ground-station loss"),
        (ArduPilot(), {"FS_THR_ENABLE": 0}, "RC loss"),
        (ArduPilot(), {"BATT_FS_LOW_ACT": 0}, "battery"),
        (ArduPilot(), {"BATT_FS_LOW_ACT": 2, "BATT_LOW_VOLT": 0, "BATT_LOW_MAH": 0}, "battery"),
        (ArduPilot(), {"FENCE_ENABLE": 0}, "fence"),
        (ArduPilot(), {"FENCE_ENABLE": 1, "FENCE_ACTION": 0}, "fence"),
        (ArduPilot(), {"GUID_TIMEOUT": 0}, "offboard loss"),
    ],
)
def test_what_is_off_is_found(stack, off, about):
    (found,) = [f for f in stack.failsafes(off) if f.about == about]
    assert found.active is False


def test_a_battery_failsafe_with_a_threshold_is_on():
    for threshold in ("BATT_LOW_VOLT", "BATT_LOW_MAH"):
        values = {"BATT_FS_LOW_ACT": 2.0, "BATT_LOW_VOLT": 0.0, "BATT_LOW_MAH": 0.0, threshold: 10.5}
        (found,) = [f for f in ArduPilot().failsafes(values) if f.about == "battery"]
        assert found.active
