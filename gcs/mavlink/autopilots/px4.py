"""PX4: mode numbers, sequences and parameter names (as measured on 1.16)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

from gcs.core.flight_law import Px4Law
from gcs.core.mission import Command
from gcs.core.vehicle import Autopilot, Failsafe, FlightMode, MissionState, VehicleLimits
from gcs.core.way_home import OwnAction, ReturnFlight
from gcs.mavlink.autopilots.base import (
    NAN,
    CommandCall,
    FlightControl,
    FlightStack,
    ParameterValues,
    failsafe,
    gains_from,
    law_from,
    not_told,
    positive,
    setting,
)
from gcs.mavlink.dialect import mavlink

MAIN_AUTO = 4
MAIN_NAMES = {
    1: "MANUAL",
    2: "ALTCTL",
    3: "POSCTL",
    4: "AUTO",
    5: "ACRO",
    6: "OFFBOARD",
    7: "STABILIZED",
    8: "RATTITUDE",
    10: "TERMINATION",
}
AUTO_NAMES = {
    1: "READY",
    2: "TAKEOFF",
    3: "LOITER",
    4: "MISSION",
    5: "RTL",
    6: "LAND",
    7: "RTGS",
    8: "FOLLOW_TARGET",
    9: "PRECLAND",
    10: "VTOL_TAKEOFF",
}
MODES = {
    FlightMode.OFFBOARD: (6, 0),
    FlightMode.TAKEOFF: (MAIN_AUTO, 2),
    FlightMode.HOLD: (MAIN_AUTO, 3),
    FlightMode.MISSION: (MAIN_AUTO, 4),
    FlightMode.RETURN: (MAIN_AUTO, 5),
    FlightMode.LAND: (MAIN_AUTO, 6),
}
_OF_MODE = {numbers: mode for mode, numbers in MODES.items()} | {(MAIN_AUTO, 9): FlightMode.LAND}
_MANUAL_MAINS = frozenset({1, 2, 3, 5, 7, 8})
_FLYABLE = (MissionState.NOT_STARTED, MissionState.ACTIVE, MissionState.PAUSED, MissionState.COMPLETE)

_LAW_SETTINGS = {
    "cruise_m_s": ("MPC_XY_CRUISE", 1.0),
    "max_speed_m_s": ("MPC_XY_VEL_MAX", 1.0),
    "climb_m_s": ("MPC_Z_V_AUTO_UP", 1.0),
    "descent_m_s": ("MPC_Z_V_AUTO_DN", 1.0),
    "max_climb_m_s": ("MPC_Z_VEL_MAX_UP", 1.0),
    "max_descent_m_s": ("MPC_Z_VEL_MAX_DN", 1.0),
    "acceleration_m_s2": ("MPC_ACC_HOR", 1.0),
    "climb_acceleration_m_s2": ("MPC_ACC_UP_MAX", 1.0),
    "descent_acceleration_m_s2": ("MPC_ACC_DOWN_MAX", 1.0),
    "jerk_m_s3": ("MPC_JERK_AUTO", 1.0),
    "turn_gain": ("MPC_XY_TRAJ_P", 1.0),
    "max_lag_m": ("MPC_XY_ERR_MAX", 1.0),
    "radius_m": ("NAV_ACC_RAD", 1.0),
    "height_radius_m": ("NAV_MC_ALT_RAD", 1.0),
    "position_gain_s": ("MPC_XY_P", 1.0),
    "vertical_position_gain_s": ("MPC_Z_P", 1.0),
    "max_tilt_rad": ("MPC_TILTMAX_AIR", math.radians(1.0)),
    "landing_speed_m_s": ("MPC_LAND_SPEED", 1.0),
}
"""Fields of its flight law, the parameters that set them, and their units."""
_LEVEL_GAINS = ("MPC_XY_VEL_P_ACC", "MPC_XY_VEL_I_ACC", "MPC_XY_VEL_D_ACC")
_VERTICAL_GAINS = ("MPC_Z_VEL_P_ACC", "MPC_Z_VEL_I_ACC", "MPC_Z_VEL_D_ACC")
_LAW_NAMES = (*(name for name, _ in _LAW_SETTINGS.values()), *_LEVEL_GAINS, *_VERTICAL_GAINS)


def custom_mode_number(main: int, sub: int) -> int:
    """PX4's custom_mode: main mode in byte 2, sub mode in byte 3."""
    return main << 16 | sub << 24


class Px4(FlightStack):
    """PX4 multicopters."""

    autopilot = Autopilot.PX4
    takes_acceleration_forward = True
    bytewise_parameters = True
    stream_loss_parameters = ("COM_OF_LOSS_T",)
    limit_parameters = (
        "MPC_XY_VEL_MAX",
        "MPC_Z_VEL_MAX_UP",
        "MPC_Z_VEL_MAX_DN",
        "MPC_ACC_HOR",
        "COM_OF_LOSS_T",
        "RTL_RETURN_ALT",
        "RTL_TYPE",
        "RTL_CONE_ANG",
        "RTL_MIN_DIST",
        "NAV_ACC_RAD",
        *_LAW_NAMES,
    )
    failsafe_parameters = (
        "NAV_DLL_ACT",
        "COM_DL_LOSS_T",
        "COM_DLL_EXCEPT",
        "NAV_RCL_ACT",
        "COM_RCL_EXCEPT",
        "COM_RC_IN_MODE",
        "COM_LOW_BAT_ACT",
        "GF_ACTION",
        "COM_OBL_RC_ACT",
        "COM_OF_LOSS_T",
        "RTL_RETURN_ALT",
    )

    def flight_mode(self, custom_mode: int) -> tuple[FlightMode, str]:
        """See FlightStack."""
        main, sub = custom_mode >> 16 & 0xFF, custom_mode >> 24 & 0xFF
        name = MAIN_NAMES.get(main, f"mode {main}.{sub}")
        if main == MAIN_AUTO:
            name = f"AUTO.{AUTO_NAMES.get(sub, sub)}"
        if main in _MANUAL_MAINS:
            return FlightMode.MANUAL, name
        mode = _OF_MODE.get((main, sub if main == MAIN_AUTO else 0))
        if mode is None:
            return (FlightMode.UNKNOWN if main == 0 else FlightMode.OTHER), name
        return mode, name

    def custom_mode(self, mode: FlightMode) -> int | None:
        """See FlightStack."""
        numbers = MODES.get(mode)
        return None if numbers is None else custom_mode_number(*numbers)

    def mode_command(self, custom_mode: int) -> CommandCall:
        """See FlightStack; the first of its two COMMAND_ACKs says ACCEPTED whatever the outcome."""
        main, sub = custom_mode >> 16 & 0xFF, custom_mode >> 24 & 0xFF
        flag = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        return CommandCall(mavlink.MAV_CMD_DO_SET_MODE, (float(flag), float(main), float(sub)))

    async def start_mission(self, control: FlightControl) -> None:
        """See FlightStack: armed in HOLD once PX4 has found the mission flyable, then mission mode."""
        mission = control.telemetry.mission
        if mission is None or mission.value.current != 0 or mission.value.state is MissionState.COMPLETE:
            await control.set_current_item(0)
        await control.until_mission_state(*_FLYABLE)
        await self._arm_in_hold(control)
        await control.switch_mode(custom_mode_number(*MODES[FlightMode.MISSION]))
        await control.until_mission_state(MissionState.ACTIVE)

    async def pause(self, control: FlightControl) -> None:
        """See FlightStack: hold mode."""
        await control.switch_mode(custom_mode_number(*MODES[FlightMode.HOLD]))

    async def resume_mission(self, control: FlightControl) -> None:
        """See FlightStack: mission mode again."""
        await control.switch_mode(custom_mode_number(*MODES[FlightMode.MISSION]))
        await control.until_mission_state(MissionState.ACTIVE)

    async def take_off(self, control: FlightControl, altitude_amsl_m: float) -> None:
        """See FlightStack: NAV_TAKEOFF to an altitude above mean sea level, where PX4 goes into HOLD."""
        await self._arm_in_hold(control)
        take_off = CommandCall(Command.NAV_TAKEOFF, (NAN, 0.0, 0.0, NAN, NAN, NAN, altitude_amsl_m))
        await control.command(take_off, brings_mode=custom_mode_number(*MODES[FlightMode.TAKEOFF]))
        await control.until_altitude(altitude_amsl_m, tolerance_m=0.5, timeout_s=60.0)

    async def hold_before_stream(self, control: FlightControl) -> None:
        """See FlightStack: after a lost stream PX4 goes back into OFFBOARD by itself as soon as setpoints come again.

        It then shows HOLD (or another mode) as its failsafe, so the mode shown proves nothing: the command has to be
        acknowledged.
        """
        hold = custom_mode_number(*MODES[FlightMode.HOLD])
        await control.command(self.mode_command(hold), brings_mode=hold)
        await control.switch_mode(hold)

    async def enter_offboard(self, control: FlightControl) -> None:
        """See FlightStack."""
        await control.switch_mode(custom_mode_number(*MODES[FlightMode.OFFBOARD]))

    async def _arm_in_hold(self, control: FlightControl) -> None:
        """PX4 does not arm in return, landing or manual modes without sticks."""
        armed = control.telemetry.armed
        if armed is None or not armed.value:
            await control.switch_mode(custom_mode_number(*MODES[FlightMode.HOLD]))
        await control.arm_motors()

    def gimbal_commands(self, pitch_rad: float) -> tuple[CommandCall, ...]:
        """See FlightStack: gimbal manager; -2 takes control of it for the sender."""
        flags = mavlink.GIMBAL_MANAGER_FLAGS_ROLL_LOCK | mavlink.GIMBAL_MANAGER_FLAGS_PITCH_LOCK
        configure = CommandCall(mavlink.MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE, (-2.0, -2.0, -1.0, -1.0, 0.0, 0.0, 0.0))
        turn = (math.degrees(pitch_rad), 0.0, NAN, NAN, float(flags), 0.0, 0.0)
        return configure, CommandCall(Command.DO_GIMBAL_MANAGER_PITCHYAW, turn)

    def picture_command(self, number: int) -> CommandCall:
        """See FlightStack: to the camera component; the number keeps a resent command from taking two pictures."""
        return CommandCall(Command.IMAGE_START_CAPTURE, (0.0, 0.0, 1.0, float(number)), to_camera=True)

    def return_altitude_setting(self, altitude_m: float) -> tuple[str, float] | None:
        """See FlightStack."""
        return "RTL_RETURN_ALT", altitude_m

    def limits(self, values: ParameterValues) -> VehicleLimits:
        """See FlightStack."""
        return VehicleLimits(
            max_speed_m_s=positive(setting(values, "MPC_XY_VEL_MAX")),
            max_climb_m_s=positive(setting(values, "MPC_Z_VEL_MAX_UP")),
            max_descent_m_s=positive(setting(values, "MPC_Z_VEL_MAX_DN")),
            max_acceleration_m_s2=positive(setting(values, "MPC_ACC_HOR")),
            offboard_timeout_s=setting(values, "COM_OF_LOSS_T"),
            return_altitude_m=setting(values, "RTL_RETURN_ALT"),
            return_flight=_return_flight(values),
            flight_law=_flight_law(values),
            law_defaults=not_told(values, _LAW_NAMES),
            max_tilt_rad=positive(setting(values, "MPC_TILTMAX_AIR", math.radians(1.0))),
        )

    def failsafes(self, values: ParameterValues) -> tuple[Failsafe, ...]:
        """See FlightStack."""
        station_s = _seconds(values, "COM_DL_LOSS_T")
        stream_s = _seconds(values, "COM_OF_LOSS_T")
        return (
            _with_exceptions(
                values,
                "COM_DLL_EXCEPT",
                "NAV_DLL_ACT",
                "ground-station loss",
                {
                    0: "does nothing when the ground station is lost",
                    1: f"holds after {station_s} without the ground station",
                    2: f"returns after {station_s} without the ground station",
                    3: f"lands after {station_s} without the ground station",
                    5: f"terminates the flight after {station_s} without the ground station",
                    6: f"disarms after {station_s} without the ground station",
                },
            ),
            self._rc_loss(values),
            failsafe(
                values,
                "COM_LOW_BAT_ACT",
                "battery",
                {
                    0: "only warns when the battery is low",
                    1: "returns when the battery is critical",
                    2: "lands when the battery is critical",
                    3: "returns when the battery is critical, lands when it is nearly empty",
                },
                does={0: OwnAction.NOTHING, 1: OwnAction.RETURN, 2: OwnAction.LAND, 3: OwnAction.RETURN},
                settings={OwnAction.RETURN: "COM_LOW_BAT_ACT 3", OwnAction.LAND: "COM_LOW_BAT_ACT 2"},
            ),
            failsafe(
                values,
                "GF_ACTION",
                "fence",
                {
                    0: "does nothing at the fence",
                    1: "only warns at the fence",
                    2: "holds at the fence",
                    3: "returns at the fence",
                    4: "terminates the flight at the fence",
                    5: "lands at the fence",
                },
                off=frozenset({0, 1}),
            ),
            _in_offboard_only(
                values,
                {
                    0: f"goes to position mode {stream_s} after the last setpoint (sticks, or the RC-loss action)",
                    1: f"goes to altitude mode {stream_s} after the last setpoint (drifts without a pilot)",
                    2: f"goes to stabilized mode {stream_s} after the last setpoint (falls without a pilot)",
                    3: f"returns {stream_s} after the last setpoint",
                    4: f"lands {stream_s} after the last setpoint",
                    5: f"holds {stream_s} after the last setpoint",
                    6: f"terminates the flight {stream_s} after the last setpoint",
                    7: f"disarms {stream_s} after the last setpoint",
                },
            ),
            _return(values),
        )

    @staticmethod
    def _rc_loss(values: ParameterValues) -> Failsafe:
        name, about = "NAV_RCL_ACT", "RC loss"
        if values.get("COM_RC_IN_MODE") == 4:
            return Failsafe(name, about, values.get(name), False, "no transmitter is used at all (COM_RC_IN_MODE 4)")
        return _with_exceptions(
            values,
            "COM_RCL_EXCEPT",
            name,
            about,
            {
                0: "does nothing when the transmitter is lost",
                1: "holds when the transmitter is lost",
                2: "returns when the transmitter is lost",
                3: "lands when the transmitter is lost",
                5: "terminates the flight when the transmitter is lost",
                6: "disarms when the transmitter is lost",
            },
        )


_LINK_LOSS = {
    0: OwnAction.NOTHING,
    1: OwnAction.HOLD,
    2: OwnAction.RETURN,
    3: OwnAction.LAND,
    5: OwnAction.FALL,
    6: OwnAction.FALL,
}
_EXCEPT_MISSION_AND_HOLD = 3


def _with_exceptions(
    values: ParameterValues, exceptions: str, name: str, about: str, effects: Mapping[int, str]
) -> Failsafe:
    """A failsafe of a lost link, which the bits of another parameter switch off in some modes."""
    told = values.get(exceptions)
    bits = round(told or 0)
    exempt = {}
    if bits & 1:
        exempt[FlightMode.MISSION] = OwnAction.CONTINUE
    if bits & 2:
        exempt[FlightMode.HOLD] = OwnAction.HOLD
    if bits & 4:  # what is left to do is that of a lost stream
        exempt[FlightMode.OFFBOARD] = OwnAction.NOTHING
    settings = {
        OwnAction.RETURN: f"{name} 2",
        OwnAction.LAND: f"{name} 3",
        OwnAction.HOLD: f"{name} 1",
    }
    if told is not None:
        settings[OwnAction.CONTINUE] = f"{exceptions} {bits | _EXCEPT_MISSION_AND_HOLD}"
    read = failsafe(values, name, about, effects, does=_LINK_LOSS, exempt=exempt, settings=settings)
    names = [word for bit, word in ((1, "missions"), (2, "hold"), (4, "offboard")) if bits & bit]
    if not read.active or not names:
        return read
    return replace(read, effect=f"{read.effect}, but not in {' and '.join(names)} ({exceptions} {bits})")


def _in_offboard_only(values: ParameterValues, effects: Mapping[int, str]) -> Failsafe:
    """What is done without setpoints; the pilot's modes without a pilot sink to the ground (measured), or drift."""
    name = "COM_OBL_RC_ACT"
    settings = {OwnAction.RETURN: f"{name} 3", OwnAction.LAND: f"{name} 4", OwnAction.HOLD: f"{name} 5"}
    does = {
        0: OwnAction.LAND,
        3: OwnAction.RETURN,
        4: OwnAction.LAND,
        5: OwnAction.HOLD,
        6: OwnAction.FALL,
        7: OwnAction.FALL,
    }
    read = failsafe(values, name, "offboard loss", effects, off=frozenset(), does=does, settings=settings)
    return replace(read, actions={m: a for m, a in read.actions.items() if m is FlightMode.OFFBOARD})


def _flight_law(values: ParameterValues) -> Px4Law:
    law = law_from(values, Px4Law(), _LAW_SETTINGS)
    return replace(
        law,
        velocity_gains_s=gains_from(values, _LEVEL_GAINS, law.velocity_gains_s),
        vertical_velocity_gains_s=gains_from(values, _VERTICAL_GAINS, law.vertical_velocity_gains_s),
    )


def _return_flight(values: ParameterValues) -> ReturnFlight | None:
    """The straight return of RTL_TYPE 0; the others fly to rally points or along the mission.

    Within RTL_MIN_DIST of home it climbs only as high as a cone of half angle RTL_CONE_ANG (90 degrees: it does not
    climb), and at least two acceptance radii.
    """
    altitude, kind = values.get("RTL_RETURN_ALT"), values.get("RTL_TYPE")
    if altitude is None or (kind is not None and round(kind) != 0):
        return None
    angle, reach = values.get("RTL_CONE_ANG"), values.get("RTL_MIN_DIST")
    if not angle or angle < 0 or reach is None:
        return ReturnFlight(altitude)
    return ReturnFlight(
        altitude,
        cone_slope=0.0 if angle >= 90 else 1 / math.tan(math.radians(angle)),
        cone_reach_m=reach,
        cone_floor_m=2 * (values.get("NAV_ACC_RAD") or 0.0),
        no_cone="RTL_CONE_ANG 0",
    )


def _seconds(values: ParameterValues, name: str) -> str:
    value = values.get(name)
    return "an unknown time" if value is None else f"{value:g} s"


def _return(values: ParameterValues) -> Failsafe:
    altitude = values.get("RTL_RETURN_ALT")
    if altitude is None:
        return Failsafe("RTL_RETURN_ALT", "return", None, None, "the vehicle did not tell it")
    effect = f"climbs to at least {altitude:g} m above home before it returns"
    return Failsafe("RTL_RETURN_ALT", "return", altitude, True, effect)
