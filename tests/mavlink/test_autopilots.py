import math

import pytest
from pymavlink import mavutil

from gcs.core.errors import LinkError, RefusedError
from gcs.core.frames import GeoPoint
from gcs.core.vehicle import Autopilot, FlightMode, Heard, MissionProgress, MissionState, Telemetry
from gcs.mavlink.autopilots.ardupilot import ArduPilot
from gcs.mavlink.autopilots.generic import GenericAutopilot
from gcs.mavlink.autopilots.px4 import Px4

STACKS = [Px4(), ArduPilot()]


class Control:
    """Writes down what a stack asks for, and shows it at once."""

    def __init__(self, stack, **telemetry):
        self.stack = stack
        self.telemetry = Telemetry(**{name: Heard(value, 0.0) for name, value in telemetry.items()})
        self.asked = []

    async def switch_mode(self, custom_mode, *, timeout_s=5.0):
        self.asked.append(self.stack.flight_mode(custom_mode)[1])

    async def command(self, call, *, brings_mode=None):
        self.asked.append((call.command, call.params))

    async def arm_motors(self):
        self.asked.append("arm")

    async def until_mission_state(self, *states, timeout_s=5.0):
        self.asked.append(states)

    async def until_altitude(self, altitude_amsl_m, *, tolerance_m, timeout_s):
        self.asked.append(("until", altitude_amsl_m))

    async def set_current_item(self, sequence):
        self.asked.append(("current", sequence))

    @property
    def told(self):
        return [what for what in self.asked if isinstance(what, str) or isinstance(what[0], (int, str))]


@pytest.mark.parametrize("stack", STACKS, ids=lambda s: s.autopilot.value)
@pytest.mark.parametrize("mode", list(FlightMode))
def test_modes_there_and_back(stack, mode):
    number = stack.custom_mode(mode)
    if number is not None:
        assert stack.flight_mode(number)[0] is mode
        assert stack.mode_command(number).params[0] == 1.0


def test_px4_numbers_agree_with_another_ground_station():
    modes = {"LOITER": FlightMode.HOLD, "MISSION": FlightMode.MISSION, "RTL": FlightMode.RETURN}
    modes |= {"LAND": FlightMode.LAND, "TAKEOFF": FlightMode.TAKEOFF, "OFFBOARD": FlightMode.OFFBOARD}
    for name, mode in modes.items():
        _, main, sub = mavutil.px4_map[name]
        assert Px4().custom_mode(mode) == main << 16 | sub << 24
        assert Px4().mode_command(Px4().custom_mode(mode)).params == (1.0, float(main), float(sub))


@pytest.mark.parametrize(("number", "mode"), [(3 << 16, "POSCTL"), (7 << 16, "STABILIZED"), (2 << 16, "ALTCTL")])
def test_px4_modes_with_sticks_are_manual(number, mode):
    assert Px4().flight_mode(number) == (FlightMode.MANUAL, mode)


@pytest.mark.parametrize("number", [0, 255 << 16, 4 << 16, 4 << 16 | 99 << 24, 2**32 - 1])
def test_strange_px4_numbers_are_no_known_mode(number):
    assert Px4().flight_mode(number)[0] in (FlightMode.OTHER, FlightMode.UNKNOWN)


async def test_px4_starts_a_mission_by_arming_in_hold_first():
    control = Control(Px4(), armed=False, mission=MissionProgress(0, 5, MissionState.NOT_STARTED))
    await Px4().start_mission(control)
    assert control.told == ["AUTO.LOITER", "arm", "AUTO.MISSION"]
    assert control.asked[0] == (
        MissionState.NOT_STARTED,
        MissionState.ACTIVE,
        MissionState.PAUSED,
        MissionState.COMPLETE,
    ), "nothing turns before the mission is known to be flyable"


async def test_px4_starts_a_flown_mission_again_from_its_first_item():
    control = Control(Px4(), armed=False, mission=MissionProgress(4, 5, MissionState.COMPLETE))
    await Px4().start_mission(control)
    assert control.told[0] == ("current", 0)


async def test_ardupilot_starts_a_mission_from_guided():
    control = Control(ArduPilot(), mission=MissionProgress(0, 4, MissionState.NOT_STARTED))
    await ArduPilot().start_mission(control)
    assert control.told == ["GUIDED", "arm", "AUTO", (300, ())]


async def test_pause_and_resume():
    flying = Control(ArduPilot(), mode=FlightMode.MISSION)
    await ArduPilot().pause(flying)
    await ArduPilot().resume_mission(flying)
    assert flying.told == [(193, (0.0,)), (193, (1.0,))]
    guided = Control(ArduPilot(), mode=FlightMode.OFFBOARD)
    await ArduPilot().pause(guided)
    await ArduPilot().resume_mission(guided)
    assert guided.told == ["BRAKE", "AUTO"]
    px4 = Control(Px4(), mode=FlightMode.MISSION)
    await Px4().pause(px4)
    await Px4().resume_mission(px4)
    assert px4.told == ["AUTO.LOITER", "AUTO.MISSION"]


async def test_take_off_heights_px4_above_sea_ardupilot_above_home():
    px4 = Control(Px4(), armed=False)
    await Px4().take_off(px4, 34.0)
    assert px4.told[:2] == ["AUTO.LOITER", "arm"]
    assert px4.told[2][0] == 22
    assert px4.told[2][1][6] == 34.0
    ardupilot = Control(ArduPilot(), home=GeoPoint(31.0, 121.0, 4.0))
    await ArduPilot().take_off(ardupilot, 34.0)
    assert ardupilot.told[:2] == ["GUIDED", "arm"]
    assert ardupilot.told[2][1][6] == 30.0
    with pytest.raises(RefusedError, match="home"):
        await ArduPilot().take_off(Control(ArduPilot()), 34.0)


class RefusesTakeOff(Control):
    """Refuses to take off, as a vehicle in the air does; climbs or stays."""

    def __init__(self, climbs):
        super().__init__(ArduPilot(), home=GeoPoint(31.0, 121.0, 4.0))
        self.climbs = climbs

    async def command(self, call, *, brings_mode=None):
        raise RefusedError("the vehicle refuses NAV_TAKEOFF: failed")

    async def until_altitude(self, altitude_amsl_m, *, tolerance_m, timeout_s):
        if not self.climbs:
            raise LinkError("it does not climb")
        await super().until_altitude(altitude_amsl_m, tolerance_m=tolerance_m, timeout_s=timeout_s)


async def test_a_take_off_whose_first_answer_was_lost_goes_on():
    climbing = RefusesTakeOff(climbs=True)
    await ArduPilot().take_off(climbing, 34.0)
    assert climbing.asked[-1] == ("until", 34.0)
    with pytest.raises(RefusedError, match="NAV_TAKEOFF"):
        await ArduPilot().take_off(RefusesTakeOff(climbs=False), 34.0)


def test_gimbal_and_picture():
    pitch = math.radians(-30)
    turn = Px4().gimbal_commands(pitch)[-1]
    assert turn.command == 1000
    assert turn.params[:2] == (pytest.approx(-30.0), 0.0)
    mount = ArduPilot().gimbal_commands(pitch)[-1]
    assert mount.command == 205
    assert mount.params[0] == pytest.approx(-30.0)
    assert mount.params[6] == 2.0
    picture = Px4().picture_command(7)
    assert (picture.command, picture.to_camera, picture.params[2:4]) == (2000, True, (1.0, 7.0))
    digicam = ArduPilot().picture_command(7)
    assert (digicam.command, digicam.to_camera, digicam.params[4]) == (203, False, 1.0)


def test_limits_in_metres():
    px4 = Px4().limits(
        {
            "MPC_XY_VEL_MAX": 12.0,
            "MPC_Z_VEL_MAX_UP": 3.0,
            "MPC_Z_VEL_MAX_DN": 1.5,
            "MPC_ACC_HOR": 3.0,
            "COM_OF_LOSS_T": 1.0,
            "RTL_RETURN_ALT": 60.0,
        }
    )
    assert (px4.max_speed_m_s, px4.max_climb_m_s, px4.max_descent_m_s) == (12.0, 3.0, 1.5)
    assert (px4.max_acceleration_m_s2, px4.offboard_timeout_s, px4.return_altitude_m) == (3.0, 1.0, 60.0)
    copter = ArduPilot().limits({"WPNAV_SPEED": 1000.0, "WPNAV_ACCEL": 250.0, "RTL_ALT": 1500.0, "GUID_TIMEOUT": 3.0})
    assert (copter.max_speed_m_s, copter.max_acceleration_m_s2) == (10.0, 2.5)
    assert (copter.return_altitude_m, copter.offboard_timeout_s, copter.max_climb_m_s) == (15.0, 3.0, None)


def by_name(failsafes):
    return {f.name: f for f in failsafes}


def test_px4_failsafes_by_default_and_switched_on():
    default = by_name(Px4().failsafes({"NAV_DLL_ACT": 0, "COM_DL_LOSS_T": 10.0, "COM_LOW_BAT_ACT": 0, "GF_ACTION": 2}))
    assert default["NAV_DLL_ACT"].active is False
    assert default["COM_LOW_BAT_ACT"].active is False
    assert default["GF_ACTION"].active is True
    assert default["NAV_RCL_ACT"].active is None, "unknown is not off"
    on = by_name(Px4().failsafes({"NAV_DLL_ACT": 2, "COM_DL_LOSS_T": 10.0, "COM_OBL_RC_ACT": 0, "COM_OF_LOSS_T": 1.0}))
    assert on["NAV_DLL_ACT"].active is True
    assert on["NAV_DLL_ACT"].effect == "returns after 10 s without the ground station"
    assert "position mode 1 s after" in on["COM_OBL_RC_ACT"].effect


def test_px4_rc_loss_without_rc_is_said():
    none = by_name(Px4().failsafes({"NAV_RCL_ACT": 2, "COM_RC_IN_MODE": 4}))["NAV_RCL_ACT"]
    assert none.active is False
    assert "no transmitter" in none.effect
    exempt = by_name(Px4().failsafes({"NAV_RCL_ACT": 2, "COM_RC_IN_MODE": 0, "COM_RCL_EXCEPT": 5}))["NAV_RCL_ACT"]
    assert exempt.effect.endswith("but not in missions and offboard (COM_RCL_EXCEPT 5)")


def test_ardupilot_failsafes():
    values = {"FS_GCS_ENABLE": 0, "FS_THR_ENABLE": 1, "FENCE_ENABLE": 0, "FENCE_ACTION": 1, "RTL_ALT": 1500}
    read = by_name(ArduPilot().failsafes(values | {"GUID_TIMEOUT": 3.0}))
    assert read["FS_GCS_ENABLE"].active is False
    assert read["FS_THR_ENABLE"].active is True
    assert read["FENCE_ENABLE"].active is False
    assert read["BATT_FS_LOW_ACT"].active is None
    assert "3 s" in read["GUID_TIMEOUT"].effect
    assert "15 m" in read["RTL_ALT"].effect
    only_reports = by_name(ArduPilot().failsafes({"FENCE_ENABLE": 1, "FENCE_ACTION": 0}))
    assert only_reports["FENCE_ACTION"].active is False
    assert by_name(ArduPilot().failsafes({"FENCE_ENABLE": 1, "FENCE_ACTION": 1}))["FENCE_ENABLE"].active is True


@pytest.mark.parametrize("stack", STACKS, ids=lambda s: s.autopilot.value)
def test_every_parameter_that_is_named_is_also_read(stack):
    assert all(f.name in stack.failsafe_parameters for f in stack.failsafes({}))
    assert all(len(name) <= 16 for name in (*stack.limit_parameters, *stack.failsafe_parameters))
    assert all(f.active is None for f in stack.failsafes({}))


async def test_other_autopilots_are_not_flown():
    stack = GenericAutopilot()
    assert stack.autopilot is Autopilot.GENERIC
    assert stack.flight_mode(3) == (FlightMode.UNKNOWN, "mode 3")
    assert stack.custom_mode(FlightMode.LAND) is None
    for refused in (stack.start_mission, stack.pause, stack.resume_mission, stack.enter_offboard):
        with pytest.raises(RefusedError):
            await refused(Control(stack))
