"""What differs from one flight stack to another, and the little that a stack may ask of a vehicle."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Protocol, TypeVar

from gcs.core.flight_law import ArduPilotLaw, Px4Law
from gcs.core.vehicle import Autopilot, Failsafe, FlightMode, MissionProgress, MissionState, Telemetry, VehicleLimits
from gcs.core.way_home import OwnAction

ParameterValues = Mapping[str, float | None]
NAN = float("nan")


@dataclass(frozen=True)
class CommandCall:
    """A MAV_CMD with its seven parameters, for COMMAND_LONG.

    Attributes:
        to_camera: for the vehicle's camera component, not its autopilot.
    """

    command: int
    params: tuple[float, ...] = ()
    to_camera: bool = False


class FlightControl(Protocol):
    """What a stack's sequences may ask of the vehicle; every call returns only when the vehicle's own state shows it.

    All raise RefusedError (with the vehicle's words) or LinkError.
    """

    @property
    def telemetry(self) -> Telemetry:
        """The newest values heard."""
        ...

    async def switch_mode(self, custom_mode: int, *, timeout_s: float = 5.0) -> None:
        """Command a mode by its number and wait until heartbeats show it."""
        ...

    async def command(self, call: CommandCall, *, brings_mode: int | None = None) -> None:
        """Send a command and wait for its acceptance.

        Args:
            call: the command.
            brings_mode: the mode number that the autopilot changes to because of it, if any.
        """
        ...

    async def arm_motors(self) -> None:
        """Arm without force and wait until heartbeats show it; nothing is sent to an armed vehicle."""
        ...

    async def until_mission_state(self, *states: MissionState, timeout_s: float = 5.0) -> None:
        """Wait until MISSION_CURRENT tells one of the states; at once when the vehicle tells no mission states."""
        ...

    async def until_altitude(self, altitude_amsl_m: float, *, tolerance_m: float, timeout_s: float) -> None:
        """Wait until the vehicle is no lower than `altitude_amsl_m - tolerance_m`."""
        ...

    async def set_current_item(self, sequence: int) -> None:
        """Make an item of the mission the current one and wait until MISSION_CURRENT shows it."""
        ...


class FlightStack(ABC):
    """One flight stack: its mode numbers, sequences, commands and parameter names. It holds no state."""

    autopilot: Autopilot
    known = True
    """Whether the station knows how to command it."""
    arming_mode = FlightMode.HOLD
    """The mode in which the vehicle's own readiness check says whether it can be armed for a flight."""
    camera_announces = True
    """Whether the camera component announces pictures, and not the autopilot in its stead."""
    takes_acceleration_forward = False
    """Whether a setpoint's acceleration is only added to what the controller asks for. Where it also moves the setpoint
    on (ArduPilot integrates it between setpoints), nothing but the curve's own acceleration may be in it."""
    bytewise_parameters = False
    """Whether whole-number parameters travel as their bytes inside the float, not as a float of the same value."""
    serves_lists_as_files = False
    """Whether the autopilot serves missions and parameters as files too (`@MISSION`, `@PARAM`)."""
    limit_parameters: tuple[str, ...] = ()
    stream_loss_parameters: tuple[str, ...] = ()
    """Of the limits, what says for how long it flies on when setpoints stop."""
    failsafe_parameters: tuple[str, ...] = ()

    @abstractmethod
    def flight_mode(self, custom_mode: int) -> tuple[FlightMode, str]:
        """The mode in common words, and the stack's own name of it."""

    @abstractmethod
    def custom_mode(self, mode: FlightMode) -> int | None:
        """The number to command for a mode; None when the stack has none for it."""

    @abstractmethod
    def mode_command(self, custom_mode: int) -> CommandCall:
        """The DO_SET_MODE that asks for a mode number."""

    @abstractmethod
    async def start_mission(self, control: FlightControl) -> None:
        """Arm and start the mission that is on the vehicle, from its first item."""

    @abstractmethod
    async def pause(self, control: FlightControl) -> None:
        """Stop and hover."""

    @abstractmethod
    async def resume_mission(self, control: FlightControl) -> None:
        """Go on with the mission where it was paused."""

    @abstractmethod
    async def take_off(self, control: FlightControl, altitude_amsl_m: float) -> None:
        """Arm, climb straight up to an altitude and hover there."""

    async def hold_before_stream(self, control: FlightControl) -> None:
        """In the air and before the first setpoint: make sure that a stream alone brings no mode.

        Args:
            control: commands and waits.
        """
        del control  # by default setpoints are ignored until the mode is commanded

    @abstractmethod
    async def enter_offboard(self, control: FlightControl) -> None:
        """Make the vehicle follow setpoints, which are being streamed already."""

    @abstractmethod
    def gimbal_commands(self, pitch_rad: float) -> tuple[CommandCall, ...]:
        """Commands that turn the camera to a pitch (rad above the horizon), straight ahead of the vehicle."""

    @abstractmethod
    def picture_command(self, number: int) -> CommandCall:
        """The command that takes one picture; `number` counts from 1 and is not used twice."""

    def return_altitude_setting(self, altitude_m: float) -> tuple[str, float] | None:
        """Parameter and value that make the vehicle's return fly at a height above home; None when not known."""
        del altitude_m
        return None

    def retrace_mode(self) -> int | None:
        """The number of the mode that flies home along the path that was flown; None when there is none."""
        return None

    @abstractmethod
    def limits(self, values: ParameterValues) -> VehicleLimits:
        """What `limit_parameters` allow."""

    @abstractmethod
    def failsafes(self, values: ParameterValues) -> tuple[Failsafe, ...]:
        """What `failsafe_parameters` do, in plain words."""

    def own_successors(self, mode: FlightMode, mission: MissionProgress | None) -> frozenset[FlightMode]:
        """Modes that the autopilot changes to by itself, in the regular course of what it was told to do.

        TAKEOFF ends in HOLD or goes on into MISSION; RETURN ends in HOLD or LAND; a MISSION that is complete, or at its
        last item, ends in HOLD, RETURN or LAND. From every other mode (OFFBOARD, HOLD, LAND, MANUAL, ...) nothing is
        regular while the vehicle is armed.
        """
        if mode is FlightMode.TAKEOFF:
            return frozenset({FlightMode.HOLD, FlightMode.MISSION})
        if mode is FlightMode.RETURN:
            return frozenset({FlightMode.HOLD, FlightMode.LAND})
        if mode is FlightMode.MISSION and mission is not None and self.at_last_item(mission):
            return frozenset({FlightMode.HOLD, FlightMode.RETURN, FlightMode.LAND})
        return frozenset()

    def at_last_item(self, mission: MissionProgress) -> bool:
        """Whether a mission is complete or flies its last item."""
        if mission.state is MissionState.COMPLETE:
            return True
        return mission.total is not None and mission.current >= mission.total - 1


def setting(values: ParameterValues, name: str, scale: float = 1.0) -> float | None:
    """A parameter's value times a scale; None when the vehicle did not tell it."""
    value = values.get(name)
    return None if value is None else value * scale


def positive(value: float | None) -> float | None:
    """The value if it says something; many parameters use 0 or less for "no limit"."""
    return value if value is not None and value > 0 else None


Law = TypeVar("Law", ArduPilotLaw, Px4Law)


def law_from(values: ParameterValues, usual: Law, names: Mapping[str, tuple[str, float]]) -> Law:
    """A flight law with what a vehicle told; what it did not, or what is not positive, stays as usual.

    Args:
        values: the parameters that were read.
        usual: the law as delivered.
        names: field of the law -> parameter and its scale.
    """
    told: dict[str, Any] = {}
    for field, (name, scale) in names.items():
        value = positive(setting(values, name, scale))
        if value is not None:
            told[field] = value
    return replace(usual, **told)


def gains_from(
    values: ParameterValues, names: tuple[str, str, str], usual: tuple[float, float, float]
) -> tuple[float, float, float]:
    """Proportional, integral and derivative gain; 0 is a gain too, and what was not told is as usual."""
    p, i, d = (value if (value := values.get(name)) is not None else u for name, u in zip(names, usual, strict=True))
    return p, i, d


def not_told(values: ParameterValues, names: Iterable[str]) -> tuple[str, ...]:
    """Those of the names whose value the vehicle did not tell."""
    return tuple(name for name in names if values.get(name) is None)


IN_FLIGHT = (FlightMode.MISSION, FlightMode.HOLD, FlightMode.OFFBOARD)
"""Modes in which the station's flights can meet a failsafe."""


def failsafe(
    values: ParameterValues,
    name: str,
    about: str,
    effects: Mapping[int, str],
    *,
    off: frozenset[int] = frozenset({0}),
    does: Mapping[int, OwnAction] | None = None,
    exempt: Mapping[FlightMode, OwnAction] | None = None,
    settings: Mapping[OwnAction, str] | None = None,
) -> Failsafe:
    """Read one failsafe whose parameter is a choice.

    Args:
        values: the parameters that were read.
        name: of the parameter.
        about: what it guards against.
        effects: choice -> what happens then.
        off: choices that do nothing.
        does: choice -> what the vehicle then does by itself.
        exempt: modes in which it does something else.
        settings: see `Failsafe`.
    """
    value = values.get(name)
    if value is None:
        return Failsafe(name, about, None, None, "the vehicle did not tell it")
    choice = round(value)
    effect = effects.get(choice, f"does something that this station does not know (value {choice})")
    action = (does or {}).get(choice)
    actions = {} if action is None else dict.fromkeys(IN_FLIGHT, action) | dict(exempt or {})
    return Failsafe(name, about, value, choice not in off, effect, actions, settings or {})
