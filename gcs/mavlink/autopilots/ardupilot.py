"""ArduCopter: mode numbers, sequences and parameter names (as measured on 4.7)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

from gcs.core.errors import GcsError, RefusedError
from gcs.core.flight_law import ArduPilotLaw
from gcs.core.mission import Command
from gcs.core.vehicle import LAST_BATTERY, Autopilot, Failsafe, FlightMode, MissionProgress, MissionState, VehicleLimits
from gcs.core.way_home import OwnAction, RetraceMemory, ReturnFlight
from gcs.mavlink.autopilots.base import (
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

AUTO, GUIDED, LOITER, RTL, LAND, BRAKE, SMART_RTL = 3, 4, 5, 6, 9, 17, 21
CLIMBS_M, CLIMBS_S = 1.0, 4.0
"""A vehicle that comes so high above home within so long has taken off, whatever it answered."""
MODE_NAMES = {
    0: "STABILIZE",
    1: "ACRO",
    2: "ALT_HOLD",
    3: "AUTO",
    4: "GUIDED",
    5: "LOITER",
    6: "RTL",
    7: "CIRCLE",
    9: "LAND",
    11: "DRIFT",
    13: "SPORT",
    14: "FLIP",
    15: "AUTOTUNE",
    16: "POSHOLD",
    17: "BRAKE",
    18: "THROW",
    19: "AVOID_ADSB",
    20: "GUIDED_NOGPS",
    21: "SMART_RTL",
    22: "FLOWHOLD",
    23: "FOLLOW",
    24: "ZIGZAG",
    25: "SYSTEMID",
    26: "AUTOROTATE",
    27: "AUTO_RTL",
    28: "TURTLE",
    29: "RATE_ACRO",
}
_OF_NUMBER = {
    AUTO: FlightMode.MISSION,
    GUIDED: FlightMode.OFFBOARD,
    LOITER: FlightMode.HOLD,
    BRAKE: FlightMode.HOLD,
    RTL: FlightMode.RETURN,
    SMART_RTL: FlightMode.RETURN,
    27: FlightMode.RETURN,
    LAND: FlightMode.LAND,
} | dict.fromkeys((0, 1, 2, 11, 13, 16, 22, 29), FlightMode.MANUAL)
_NUMBERS = {
    FlightMode.MISSION: AUTO,
    FlightMode.OFFBOARD: GUIDED,
    FlightMode.HOLD: BRAKE,
    FlightMode.RETURN: RTL,
    FlightMode.LAND: LAND,
}
_CENTIMETRES = 0.01
_LAW_SETTINGS = {
    "speed_m_s": ("WPNAV_SPEED", _CENTIMETRES),
    "climb_m_s": ("WPNAV_SPEED_UP", _CENTIMETRES),
    "descent_m_s": ("WPNAV_SPEED_DN", _CENTIMETRES),
    "acceleration_m_s2": ("WPNAV_ACCEL", _CENTIMETRES),
    "vertical_acceleration_m_s2": ("WPNAV_ACCEL_Z", _CENTIMETRES),
    "corner_acceleration_m_s2": ("WPNAV_ACCEL_C", _CENTIMETRES),
    "jerk_m_s3": ("WPNAV_JERK", 1.0),
    "radius_m": ("WPNAV_RADIUS", _CENTIMETRES),
    "input_time_s": ("ATC_INPUT_TC", 1.0),
    "stream_jerk_m_s3": ("PSC_JERK_XY", 1.0),
    "stream_vertical_jerk_m_s3": ("PSC_JERK_Z", 1.0),
    "position_gain_s": ("PSC_POSXY_P", 1.0),
    "vertical_position_gain_s": ("PSC_POSZ_P", 1.0),
    "vertical_velocity_gain_s": ("PSC_VELZ_P", 1.0),
    "landing_speed_m_s": ("LAND_SPEED", _CENTIMETRES),
}
"""Fields of its flight law, the parameters that set them, and their units."""
_LEVEL_GAINS = ("PSC_VELXY_P", "PSC_VELXY_I", "PSC_VELXY_D")
_TILT = ("ANGLE_MAX", "PSC_ANGLE_MAX")
_LAW_NAMES = (*(name for name, _ in _LAW_SETTINGS.values()), *_LEVEL_GAINS, *_TILT)


class ArduPilot(FlightStack):
    """ArduPilot multicopters."""

    autopilot = Autopilot.ARDUPILOT
    arming_mode = FlightMode.OFFBOARD
    camera_announces = False
    serves_lists_as_files = True
    stream_loss_parameters = ("GUID_TIMEOUT",)
    limit_parameters = (
        "WPNAV_SPEED",
        "WPNAV_SPEED_UP",
        "WPNAV_SPEED_DN",
        "WPNAV_ACCEL",
        "GUID_TIMEOUT",
        "RTL_ALT",
        "RTL_CLIMB_MIN",
        "RTL_CONE_SLOPE",
        "FENCE_ENABLE",
        "FENCE_TYPE",
        "FENCE_ALT_MAX",
        "FENCE_MARGIN",
        "SRTL_ACCURACY",
        "SRTL_POINTS",
        *_LAW_NAMES,
    )
    failsafe_parameters = (
        "FS_GCS_ENABLE",
        "FS_GCS_TIMEOUT",
        "FS_THR_ENABLE",
        "FS_OPTIONS",
        "BATT_FS_LOW_ACT",
        "BATT_FS_CRT_ACT",
        *(f"BATT_{level}_{unit}" for level in ("LOW", "CRT") for unit in ("VOLT", "MAH")),
        "FENCE_ENABLE",
        "FENCE_ACTION",
        "GUID_TIMEOUT",
        "RTL_ALT",
    )

    def flight_mode(self, custom_mode: int) -> tuple[FlightMode, str]:
        """See FlightStack; GUIDED, which follows setpoints, is OFFBOARD here."""
        mode = _OF_NUMBER.get(custom_mode, FlightMode.OTHER)
        return mode, MODE_NAMES.get(custom_mode, f"mode {custom_mode}")

    def custom_mode(self, mode: FlightMode) -> int | None:
        """See FlightStack; HOLD is BRAKE, which needs no stick in the middle. There is no mode for a take-off."""
        return _NUMBERS.get(mode)

    def mode_command(self, custom_mode: int) -> CommandCall:
        """See FlightStack."""
        flag = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        return CommandCall(mavlink.MAV_CMD_DO_SET_MODE, (float(flag), float(custom_mode)))

    async def start_mission(self, control: FlightControl) -> None:
        """See FlightStack: AUTO cannot be armed in, so GUIDED, arm, AUTO, MISSION_START."""
        await control.switch_mode(GUIDED)
        mission = control.telemetry.mission
        if mission is None or mission.value.current > 1:
            await control.set_current_item(0)
        await control.arm_motors()
        await control.switch_mode(AUTO)
        await control.command(CommandCall(mavlink.MAV_CMD_MISSION_START))
        await control.until_mission_state(MissionState.ACTIVE)

    async def pause(self, control: FlightControl) -> None:
        """See FlightStack: in AUTO the mission itself is paused, and the mode stays."""
        mode = control.telemetry.mode
        if mode is not None and mode.value is FlightMode.MISSION:
            await control.command(CommandCall(mavlink.MAV_CMD_DO_PAUSE_CONTINUE, (0.0,)))
            await control.until_mission_state(MissionState.PAUSED)
        else:
            await control.switch_mode(BRAKE)

    async def resume_mission(self, control: FlightControl) -> None:
        """See FlightStack."""
        mode = control.telemetry.mode
        if mode is not None and mode.value is FlightMode.MISSION:
            await control.command(CommandCall(mavlink.MAV_CMD_DO_PAUSE_CONTINUE, (1.0,)))
        else:
            await control.switch_mode(AUTO)
        await control.until_mission_state(MissionState.ACTIVE)

    async def take_off(self, control: FlightControl, altitude_amsl_m: float) -> None:
        """See FlightStack: NAV_TAKEOFF in GUIDED counts its height from home, and hovers in GUIDED."""
        home = control.telemetry.home
        if home is None:
            raise RefusedError("the vehicle has not told where its home is; wait for its position fix")
        height_m = altitude_amsl_m - home.value.altitude_m
        await control.switch_mode(GUIDED)
        await control.arm_motors()
        try:
            await control.command(CommandCall(Command.NAV_TAKEOFF, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, height_m)))
        except RefusedError as refusal:
            # The answer to a first try may be lost, and a vehicle that climbs refuses the second.
            climbing_m = home.value.altitude_m + min(CLIMBS_M, height_m)
            try:
                await control.until_altitude(climbing_m, tolerance_m=0.0, timeout_s=CLIMBS_S)
            except GcsError:
                raise refusal from None
        await control.until_altitude(altitude_amsl_m, tolerance_m=0.5, timeout_s=60.0)

    async def enter_offboard(self, control: FlightControl) -> None:
        """See FlightStack."""
        await control.switch_mode(GUIDED)

    def gimbal_commands(self, pitch_rad: float) -> tuple[CommandCall, ...]:
        """See FlightStack."""
        targeting = float(mavlink.MAV_MOUNT_MODE_MAVLINK_TARGETING)
        params = (math.degrees(pitch_rad), 0.0, 0.0, 0.0, 0.0, 0.0, targeting)
        return (CommandCall(Command.DO_MOUNT_CONTROL, params),)

    def picture_command(self, number: int) -> CommandCall:
        """See FlightStack; the autopilot counts the pictures itself."""
        del number
        return CommandCall(Command.DO_DIGICAM_CONTROL, (0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0))

    def at_last_item(self, mission: MissionProgress) -> bool:
        """See FlightStack; home is item 0 and not counted in the total."""
        if mission.state is MissionState.COMPLETE:
            return True
        return mission.total is not None and mission.current >= mission.total

    def return_altitude_setting(self, altitude_m: float) -> tuple[str, float] | None:
        """See FlightStack."""
        return "RTL_ALT", round(altitude_m / _CENTIMETRES)

    def limits(self, values: ParameterValues) -> VehicleLimits:
        """See FlightStack; RTL_ALT 0 is a return at the height it has."""
        return VehicleLimits(
            max_speed_m_s=positive(setting(values, "WPNAV_SPEED", _CENTIMETRES)),
            max_climb_m_s=positive(setting(values, "WPNAV_SPEED_UP", _CENTIMETRES)),
            max_descent_m_s=positive(setting(values, "WPNAV_SPEED_DN", _CENTIMETRES)),
            max_acceleration_m_s2=positive(setting(values, "WPNAV_ACCEL", _CENTIMETRES)),
            offboard_timeout_s=setting(values, "GUID_TIMEOUT"),
            return_altitude_m=setting(values, "RTL_ALT", _CENTIMETRES),
            return_flight=_return_flight(values),
            retrace=_retrace_memory(values),
            flight_law=_flight_law(values),
            law_defaults=not_told(values, _LAW_NAMES),
            max_tilt_rad=_max_tilt_rad(values),
        )

    def retrace_mode(self) -> int | None:
        """See FlightStack."""
        return SMART_RTL

    def failsafes(self, values: ParameterValues) -> tuple[Failsafe, ...]:
        """See FlightStack."""
        timeout, options = values.get("FS_GCS_TIMEOUT"), round(values.get("FS_OPTIONS") or 0)
        after = "" if timeout is None else f" for {timeout:g} s"
        return (
            failsafe(
                values,
                "FS_GCS_ENABLE",
                "ground-station loss",
                {0: "does nothing when the ground station is lost"}
                | _actions(f"when the ground station is lost{after}"),
                does=_STATION_LOSS,
                exempt=_goes_on(values, 2, {FlightMode.HOLD: OwnAction.HOLD} if options & 16 else {}),
                settings={
                    OwnAction.RETURN: "FS_GCS_ENABLE 1",
                    OwnAction.LAND: "FS_GCS_ENABLE 5",
                    OwnAction.RETRACE: "FS_GCS_ENABLE 4",
                    OwnAction.CONTINUE: f"FS_OPTIONS {options | 18}",
                },
            ),
            failsafe(
                values,
                "FS_THR_ENABLE",
                "RC loss",
                {0: "does nothing when the transmitter is lost"}
                | _actions("when the transmitter is lost")
                | {
                    3: "lands when the transmitter is lost",
                    4: "returns the way it came, or straight, when the transmitter is lost",
                    5: "returns the way it came, or lands, when the transmitter is lost",
                },
                does=_STATION_LOSS | {3: OwnAction.LAND, 5: OwnAction.RETRACE},
                exempt=_goes_on(values, 1, {FlightMode.OFFBOARD: OwnAction.NOTHING} if options & 4 else {}),
                settings={
                    OwnAction.RETURN: "FS_THR_ENABLE 1",
                    OwnAction.LAND: "FS_THR_ENABLE 3",
                    OwnAction.RETRACE: "FS_THR_ENABLE 5",
                    OwnAction.HOLD: "FS_THR_ENABLE 7",
                },
            ),
            _battery(values, "BATT_FS_LOW_ACT", "battery", "low"),
            _battery(values, "BATT_FS_CRT_ACT", LAST_BATTERY, "critical"),
            self._fence(values),
            self._stream_loss(values),
            self._return(values),
        )

    @staticmethod
    def _fence(values: ParameterValues) -> Failsafe:
        enabled, action = values.get("FENCE_ENABLE"), values.get("FENCE_ACTION")
        if enabled is None:
            return Failsafe("FENCE_ENABLE", "fence", None, None, "the vehicle did not tell it")
        if not enabled:
            return Failsafe("FENCE_ENABLE", "fence", enabled, False, "the fence is off")
        read = failsafe(
            values,
            "FENCE_ACTION",
            "fence",
            {
                0: "only reports at the fence",
                1: "returns, or lands, at the fence",
                2: "lands at the fence",
                3: "returns the way it came, or straight, at the fence",
                4: "brakes, or lands, at the fence",
                5: "returns the way it came, or lands, at the fence",
            },
        )
        name = "FENCE_ACTION" if action == 0 else "FENCE_ENABLE"
        return Failsafe(name, "fence", enabled if name == "FENCE_ENABLE" else action, read.active, read.effect)

    @staticmethod
    def _stream_loss(values: ParameterValues) -> Failsafe:
        timeout = values.get("GUID_TIMEOUT")
        if timeout is None:
            return Failsafe("GUID_TIMEOUT", "offboard loss", None, None, "the vehicle did not tell it")
        effect = f"flies on for {timeout:g} s at the last velocity when setpoints stop, then brakes and stays in GUIDED"
        does = {FlightMode.OFFBOARD: OwnAction.HOLD}
        return Failsafe("GUID_TIMEOUT", "offboard loss", timeout, timeout > 0, effect, does)

    @staticmethod
    def _return(values: ParameterValues) -> Failsafe:
        altitude = setting(values, "RTL_ALT", _CENTIMETRES)
        if altitude is None:
            return Failsafe("RTL_ALT", "return", None, None, "the vehicle did not tell it")
        effect = f"climbs to at least {altitude:g} m above home before it returns"
        if altitude == 0:
            effect = "returns at the height it has"
        return Failsafe("RTL_ALT", "return", values.get("RTL_ALT"), True, effect)


_STATION_LOSS = {
    0: OwnAction.NOTHING,
    1: OwnAction.RETURN,
    2: OwnAction.RETURN,
    3: OwnAction.RETRACE,
    4: OwnAction.RETRACE,
    5: OwnAction.LAND,
    6: OwnAction.RETURN,
    7: OwnAction.HOLD,
}
_BATTERY = _STATION_LOSS | {1: OwnAction.LAND, 2: OwnAction.RETURN, 5: OwnAction.FALL}


def _goes_on(values: ParameterValues, bit: int, besides: Mapping[FlightMode, OwnAction]) -> dict[FlightMode, OwnAction]:
    """Modes in which FS_OPTIONS, or the old choice 2, lets a vehicle go on."""
    old = values.get("FS_GCS_ENABLE" if bit == 2 else "FS_THR_ENABLE") == 2
    goes_on = old or round(values.get("FS_OPTIONS") or 0) & bit
    return ({FlightMode.MISSION: OwnAction.CONTINUE} if goes_on else {}) | dict(besides)


def _battery(values: ParameterValues, name: str, about: str, level: str) -> Failsafe:
    """A battery failsafe; without a voltage and a charge at which it acts it never does."""
    read = _battery_action(values, name, about, level)
    thresholds = [f"BATT_{name.split('_')[2]}_{unit}" for unit in ("VOLT", "MAH")]
    if not read.active or any(values.get(threshold) != 0 for threshold in thresholds):
        return read
    return replace(read, active=False, effect=f"never acts: {' and '.join(thresholds)} are 0", actions={}, settings={})


def _battery_action(values: ParameterValues, name: str, about: str, level: str) -> Failsafe:
    return failsafe(
        values,
        name,
        about,
        {
            0: f"only warns when the battery is {level}",
            1: f"lands when the battery is {level}",
            2: f"returns when the battery is {level}",
            3: f"returns the way it came, or straight, when the battery is {level}",
            4: f"returns the way it came, or lands, when the battery is {level}",
            5: f"terminates the flight when the battery is {level}",
            6: f"flies to its landing sequence, or returns, when the battery is {level}",
            7: f"brakes, or lands, when the battery is {level}",
        },
        does=_BATTERY,
        settings={OwnAction.RETURN: f"{name} 2", OwnAction.LAND: f"{name} 1", OwnAction.RETRACE: f"{name} 4"},
    )


def _max_tilt_rad(values: ParameterValues) -> float | None:
    """PSC_ANGLE_MAX (degrees), or ANGLE_MAX (hundredths of them) where that is 0."""
    own = positive(setting(values, "PSC_ANGLE_MAX", math.radians(1.0)))
    return own or positive(setting(values, "ANGLE_MAX", math.radians(0.01)))


def _flight_law(values: ParameterValues) -> ArduPilotLaw:
    law = law_from(values, ArduPilotLaw(), _LAW_SETTINGS)
    return replace(
        law,
        velocity_gains_s=gains_from(values, _LEVEL_GAINS, law.velocity_gains_s),
        max_tilt_rad=_max_tilt_rad(values) or law.max_tilt_rad,
    )


def _return_flight(values: ParameterValues) -> ReturnFlight | None:
    """RTL: below RTL_CONE_SLOPE times the distance from home it climbs only by 2.5 m; slopes under 0.5 do not count.

    A height fence that is on lowers the return under it, by its margin.
    """
    altitude = setting(values, "RTL_ALT", _CENTIMETRES)
    if altitude is None:
        return None
    fence_m = values.get("FENCE_ALT_MAX")
    if values.get("FENCE_ENABLE") and round(values.get("FENCE_TYPE") or 0) & 1 and fence_m is not None:
        altitude = min(altitude, fence_m - (values.get("FENCE_MARGIN") or 0.0))
    slope = values.get("RTL_CONE_SLOPE")
    return ReturnFlight(
        altitude,
        least_climb_m=max(setting(values, "RTL_CLIMB_MIN", _CENTIMETRES) or 0.0, 0.0),
        cone_slope=slope if slope is not None and slope >= 0.5 else None,
        cone_climb_m=2.5,
        no_cone="RTL_CONE_SLOPE 0",
    )


def _retrace_memory(values: ParameterValues) -> RetraceMemory | None:
    accuracy, points = values.get("SRTL_ACCURACY"), values.get("SRTL_POINTS")
    if accuracy is None or points is None:
        return None
    return RetraceMemory(accuracy, round(points), "SRTL_ACCURACY", "SRTL_POINTS")


def _actions(when: str) -> dict[int, str]:
    """What the choices of FS_GCS_ENABLE do; those of FS_THR_ENABLE differ for 3 and 4."""
    return {
        1: f"returns {when}",
        2: f"goes on with a mission, otherwise returns, {when}",
        3: f"returns the way it came, or straight, {when}",
        4: f"returns the way it came, or lands, {when}",
        5: f"lands {when}",
        6: f"flies to its landing sequence, or returns, {when}",
        7: f"brakes, or lands, {when}",
    }
