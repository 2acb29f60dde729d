"""Any other autopilot: watched, its missions uploaded and read, its parameters and files read; nothing is commanded."""

from __future__ import annotations

from typing import NoReturn

from gcs.core.errors import RefusedError
from gcs.core.vehicle import Autopilot, Failsafe, FlightMode, VehicleLimits
from gcs.mavlink.autopilots.base import CommandCall, FlightControl, FlightStack, ParameterValues

UNKNOWN_STACK = (
    "its flight stack is neither PX4 nor ArduPilot: this station uploads missions to it and commands nothing"
)


def _unknown() -> NoReturn:
    raise RefusedError(UNKNOWN_STACK)


class GenericAutopilot(FlightStack):
    """An autopilot whose modes and parameters are not known."""

    autopilot = Autopilot.GENERIC
    known = False

    def flight_mode(self, custom_mode: int) -> tuple[FlightMode, str]:
        """See FlightStack."""
        return FlightMode.UNKNOWN, f"mode {custom_mode}"

    def custom_mode(self, mode: FlightMode) -> int | None:
        """See FlightStack."""
        del mode
        return None

    def mode_command(self, custom_mode: int) -> CommandCall:
        """See FlightStack."""
        del custom_mode
        _unknown()

    async def start_mission(self, control: FlightControl) -> None:
        """See FlightStack."""
        del control
        _unknown()

    async def pause(self, control: FlightControl) -> None:
        """See FlightStack."""
        del control
        _unknown()

    async def resume_mission(self, control: FlightControl) -> None:
        """See FlightStack."""
        del control
        _unknown()

    async def take_off(self, control: FlightControl, altitude_amsl_m: float) -> None:
        """See FlightStack."""
        del control, altitude_amsl_m
        _unknown()

    async def enter_offboard(self, control: FlightControl) -> None:
        """See FlightStack."""
        del control
        _unknown()

    def gimbal_commands(self, pitch_rad: float) -> tuple[CommandCall, ...]:
        """See FlightStack."""
        del pitch_rad
        _unknown()

    def picture_command(self, number: int) -> CommandCall:
        """See FlightStack."""
        del number
        _unknown()

    def limits(self, values: ParameterValues) -> VehicleLimits:
        """See FlightStack: nothing is known."""
        del values
        return VehicleLimits(None, None, None, None, None, None)

    def failsafes(self, values: ParameterValues) -> tuple[Failsafe, ...]:
        """See FlightStack: nothing is known."""
        del values
        return ()
