"""Commands whose success the vehicle's own state must show, for one sequence of them, such as "start the mission"."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from gcs.core.errors import LinkError, RefusedError
from gcs.core.vehicle import Autopilot, MissionState, Telemetry
from gcs.mavlink.autopilots.base import CommandCall, FlightStack
from gcs.mavlink.command_protocol import CommandExchange, ModeSwitch, NoAnswerError, OnProgress
from gcs.mavlink.dialect import Message, mavlink
from gcs.mavlink.mode_guard import ModeGuard
from gcs.mavlink.transaction import Clock, Send, Transaction
from gcs.mavlink.vehicle_channel import VehicleChannel

SHOWN_WITHIN_S = 5.0
RESEND_S = 0.7
ATTEMPTS = 6


class Flown(Protocol):
    """The vehicle that is commanded."""

    @property
    def telemetry(self) -> Telemetry:
        """The newest values heard."""
        ...

    @property
    def camera_component(self) -> int | None:
        """Component id of its camera, once heard."""
        ...


class CurrentItem(Transaction[None]):
    """MISSION_SET_CURRENT until MISSION_CURRENT shows it.

    Args:
        sequence: of the item.
        shown: sequences that count as shown (ArduPilot goes from home, item 0, to item 1 at once).
        channel: of the vehicle.
        permit: raises when it must not be sent any more.
    """

    def __init__(
        self, sequence: int, shown: frozenset[int], channel: VehicleChannel, permit: Callable[[], None]
    ) -> None:
        super().__init__(channel.send, channel.clock)
        self._sequence = sequence
        self._shown = shown
        self._target = channel.target
        self._permit = permit
        self._sent = 0
        self._deadline = 0.0

    @property
    def deadline(self) -> float:
        """See Transaction."""
        return self._deadline

    def start(self) -> None:
        """See Transaction."""
        self.on_time()

    def handle(self, message: Message) -> None:
        """See Transaction."""
        source = (message.get_srcSystem(), message.get_srcComponent())
        if source == self._target and message.get_type() == "MISSION_CURRENT" and message.seq in self._shown:
            self._succeed(None)

    def on_time(self) -> None:
        """See Transaction."""
        if self._sent >= ATTEMPTS:
            self._fail(NoAnswerError(f"the vehicle does not make item {self._sequence} the current one"))
            return
        try:
            self._permit()
        except RefusedError as refusal:
            self._fail(refusal)
            return
        self._send(mavlink.MAVLink_mission_set_current_message(*self._target, self._sequence))
        self._sent += 1
        self._deadline = self._clock() + RESEND_S


class FlightCommands:
    """Implements `FlightControl` for one sequence of commands.

    Args:
        vehicle: whose state must show it.
        stack: its flight stack.
        channel: to it.
        guard: knows whether the station may command it, and is told of every mode command.
        permit: raises when another sequence has taken over from this one.
        progress_of: makes who is told of the progress of a command; nobody by default.
    """

    def __init__(
        self,
        vehicle: Flown,
        stack: FlightStack,
        channel: VehicleChannel,
        guard: ModeGuard,
        permit: Callable[[], None],
        progress_of: Callable[[CommandCall], OnProgress] | None = None,
    ) -> None:
        self._vehicle = vehicle
        self._progress_of = progress_of
        self._stack = stack
        self._channel = channel
        self._guard = guard
        self._overtaken = permit
        self.armed_by_us = False

    @property
    def telemetry(self) -> Telemetry:
        """See FlightControl."""
        return self._vehicle.telemetry

    def _permit(self) -> None:
        self._overtaken()
        self._guard.check()

    @property
    def _send(self) -> Send:
        return self._channel.send

    @property
    def _clock(self) -> Clock:
        return self._channel.clock

    async def switch_mode(self, custom_mode: int, *, timeout_s: float = SHOWN_WITHIN_S) -> None:
        """See FlightControl."""
        self._overtaken()
        self._guard.command_mode(custom_mode, self._clock())
        name = self._stack.flight_mode(custom_mode)[1]
        switch = ModeSwitch(
            custom_mode,
            self._stack.mode_command(custom_mode),
            target=self._channel.target,
            sender=self._channel.sender,
            send=self._send,
            clock=self._clock,
            permit=self._permit,
            timeout_s=timeout_s,
        )
        try:
            await self._channel.run(switch)
        except RefusedError as error:
            self._guard.withdraw(custom_mode)
            self._overtaken()
            self._guard.check()
            raise RefusedError(f"it does not go into {name}: {error.message}") from error
        self._guard.withdraw(custom_mode)

    async def command(self, call: CommandCall, *, brings_mode: int | None = None) -> None:
        """See FlightControl."""
        self._permit()
        if brings_mode is not None:
            self._guard.command_mode(brings_mode, self._clock())
        target = self._channel.target
        if call.to_camera:
            camera = self._vehicle.camera_component
            if camera is None:
                raise RefusedError("no camera component of the vehicle has been heard")
            target = (target[0], camera)
        exchange = CommandExchange(
            call,
            target=target,
            sender=self._channel.sender,
            send=self._send,
            clock=self._clock,
            permit=self._permit,
            on_progress=None if self._progress_of is None else self._progress_of(call),
        )
        try:
            await self._channel.run(exchange)
        except RefusedError:
            if brings_mode is not None:
                self._guard.withdraw(brings_mode)
            raise

    async def arm_motors(self) -> None:
        """See FlightControl."""
        self._permit()
        if self._armed():
            return
        await self.command(CommandCall(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, (1.0, 0.0)))
        self.armed_by_us = True
        await self._until(self._armed, SHOWN_WITHIN_S, "the vehicle to show that it is armed")

    async def disarm_motors(self) -> None:
        """Disarm without force, which a flying vehicle refuses, and wait until heartbeats show it."""
        self._permit()
        if not self._armed():
            return
        await self.command(CommandCall(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, (0.0, 0.0)))
        await self._until(lambda: not self._armed(), SHOWN_WITHIN_S, "the vehicle to show that it is disarmed")

    async def until_mission_state(self, *states: MissionState, timeout_s: float = SHOWN_WITHIN_S) -> None:
        """See FlightControl."""

        def shown() -> bool:
            mission = self.telemetry.mission
            return mission is None or mission.value.state in (MissionState.UNKNOWN, *states)

        try:
            await self._until(shown, timeout_s, "the mission's state")
        except LinkError as error:
            mission = self.telemetry.mission
            if mission is None or mission.age_s(self._clock()) > timeout_s:
                raise
            told = mission.value.state
            words = "that it has no mission it can fly" if told is MissionState.NO_MISSION else told.name.lower()
            raise RefusedError(f"the vehicle says of its mission: {words}") from error

    async def until_altitude(self, altitude_amsl_m: float, *, tolerance_m: float, timeout_s: float) -> None:
        """See FlightControl."""

        def reached() -> bool:
            position = self.telemetry.position
            return position is not None and position.value.altitude_m >= altitude_amsl_m - tolerance_m

        await self._until(reached, timeout_s, f"the vehicle to climb to {altitude_amsl_m:.1f} m above mean sea level")

    async def set_current_item(self, sequence: int) -> None:
        """See FlightControl."""
        home_first = sequence == 0 and self._stack.autopilot is Autopilot.ARDUPILOT
        shown = frozenset({0, 1}) if home_first else frozenset({sequence})
        await self._channel.run(CurrentItem(sequence, shown, self._channel, self._permit))

    def _armed(self) -> bool:
        armed = self.telemetry.armed
        return armed is not None and armed.value

    async def _until(self, holds: Callable[[], bool], timeout_s: float, what: str) -> None:
        def holds_still_ours() -> bool:
            self._permit()
            return holds()

        await self._channel.until(holds_still_ours, timeout_s, what)
