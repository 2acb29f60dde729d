"""What one vehicle is commanded to do: modes, missions, take-off, gimbal and camera."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Awaitable, Callable
from typing import NoReturn

from gcs.core.errors import ConflictError, GcsError, LinkError, RefusedError
from gcs.core.vehicle import FlightMode, LandedState, VehicleIdentity
from gcs.mavlink.autopilots.base import CommandCall
from gcs.mavlink.command_protocol import CommandExchange, OnProgress, command_name
from gcs.mavlink.companion_lease import LeaseOrder, LeaseOrdering, LeaseStatus
from gcs.mavlink.events import CommandProgressEvent
from gcs.mavlink.flight_commands import FlightCommands
from gcs.mavlink.plan_announcement import CompanionAnnouncement
from gcs.mavlink.vehicle_channel import VehicleChannel
from gcs.mavlink.vehicle_transfers import VehicleTransfers

log = logging.getLogger(__name__)

TEXT_AGE_S = 4.0
TEXT_GRACE_S = 0.3
READINESS_TOLD_S = 3.0
WARNING = 4
COMPANION_MODES = frozenset({FlightMode.OFFBOARD, FlightMode.HOLD, FlightMode.LAND})
"""Modes that a companion commands."""


class VehicleFlight(VehicleTransfers):
    """The commanding half of a `Vehicle`."""

    def __init__(self, identity: VehicleIdentity, channel: VehicleChannel, *, lost_after_s: float) -> None:
        super().__init__(identity, channel, lost_after_s=lost_after_s)
        self._sequence = 0
        self._pictures = 0

    def take_back(self, confirm_name: str) -> None:
        """An operator explicitly has the station command the vehicle again, after somebody else took over.

        Args:
            confirm_name: the vehicle's name, or its system id.

        Raises:
            RefusedError: another name was given.
        """
        if confirm_name.strip() not in (self.identity.name, str(self.identity.system_id)):
            raise RefusedError("to take the vehicle back, give its name", field=self.identity.name)
        self._guard.take_back()

    def lend(self, lease: int | None) -> None:
        """Let a companion lead it by a lease: the modes that one commands count as commanded; None ends that."""
        self._lent_lease = lease
        self._guard.lend(frozenset() if lease is None else COMPANION_MODES)

    async def order_companion(self, order: LeaseOrder) -> LeaseStatus:
        """Give the vehicle's companion an order; returns the state that answers it.

        Raises:
            RefusedError: the companion refuses; in its own words.
            LinkError: there is none, or it does not follow.
        """
        system_id = self.identity.system_id
        ordering = LeaseOrdering(order, system_id, self._channel.send, self._now)
        return await self._named(self._channel.run(ordering))

    async def ready_companion(self, plan_hash: str, tell: Callable[[str], None]) -> None:
        """Have the vehicle's companion get a plan and make it ready; returns when it says that it could fly it now.

        Args:
            plan_hash: SHA-256 of plan.json, 64 hex digits.
            tell: takes what it says meanwhile.

        Raises:
            RefusedError: the companion cannot fly it; in its own words.
            LinkError: there is none, or it does not come to hold the plan.
        """
        system_id = self.identity.system_id
        await self._named(
            self._channel.run(CompanionAnnouncement(plan_hash, system_id, self._channel.send, self._now, tell))
        )

    async def arm(self) -> None:
        """Arm, without force."""
        await self._fly("arm", lambda control: control.arm_motors())

    async def wait_ready_to_arm(self, timeout_s: float = 60.0) -> None:
        """Go into the mode to arm in and wait until the vehicle's own checks pass.

        A vehicle that does not tell whether they do is taken for ready: arming will show it.

        Raises:
            RefusedError: they do not pass in time; with the vehicle's words.
        """
        await self.set_mode(self._stack.arming_mode)
        asked_at = self._now()

        def ready() -> bool:
            told = self.telemetry.ready_to_arm
            if told is None:
                return self._now() - asked_at > READINESS_TOLD_S
            return told.at_s > asked_at and told.value

        try:
            await self.until(ready, timeout_s, "the vehicle to be ready to arm")
        except LinkError as error:
            if not self.connected:
                raise
            said = "; ".join(dict.fromkeys(text.text for text in self.recent_texts if text.severity <= WARNING))
            words = f"its own checks do not pass after {timeout_s:g} s" + (f" ({said})" if said else "")
            raise RefusedError(words, field=self.identity.name) from error

    async def disarm(self) -> None:
        """Disarm, without force: a flying vehicle refuses."""
        await self._fly("disarm", lambda control: control.disarm_motors())

    async def set_current(self, sequence: int) -> None:
        """Make an item of its mission the current one."""
        await self._fly("set the current item", lambda control: control.set_current_item(sequence))

    async def start_mission(self) -> None:
        """Arm and start the mission from its first item."""
        self._must_be_on_ground("resume the mission instead")
        await self._fly("start the mission", self._stack.start_mission)

    async def pause(self) -> None:
        """Stop and hover."""
        await self._fly("pause", self._stack.pause)

    async def resume_mission(self) -> None:
        """Go on with a paused mission."""
        await self._fly("resume the mission", self._stack.resume_mission)

    async def return_home(self) -> None:
        """Have it fly its own return."""
        await self.set_mode(FlightMode.RETURN)

    async def retrace(self) -> None:
        """Have it fly home along the path that it came, where the stack can.

        Raises:
            RefusedError: it has no such mode, or refuses it.
        """
        self._demand_known()
        number = self._stack.retrace_mode()
        if number is None:
            stack = self.identity.autopilot.value
            raise RefusedError(f"{stack} has no mode that flies back the way it came", field=self.identity.name)
        await self._fly("fly back the way it came", lambda control: control.switch_mode(number))

    async def land(self) -> None:
        """Land where it is."""
        await self.set_mode(FlightMode.LAND)

    async def take_off(self, altitude_amsl_m: float) -> None:
        """Arm, climb straight up to an altitude above mean sea level and hover."""
        self._must_be_on_ground("it needs no take-off")
        await self._fly("take off", lambda control: self._stack.take_off(control, altitude_amsl_m))

    async def set_mode(self, mode: FlightMode) -> None:
        """Switch to a mode."""
        self._demand_known()
        number = self._stack.custom_mode(mode)
        if number is None:
            stack = self.identity.autopilot.value
            raise RefusedError(f"{stack} has no mode {mode.value} that can be commanded", field=self.identity.name)
        await self._fly(f"go into {mode.value}", lambda control: control.switch_mode(number))

    async def point_gimbal(self, pitch_rad: float) -> None:
        """Turn the camera to a pitch (rad above the horizon), straight ahead of the vehicle.

        Returns when the commands were accepted; `telemetry.gimbal_pitch_rad` shows the motion.
        """
        self._demand_known()
        calls = self._stack.gimbal_commands(pitch_rad)
        for call in calls[:-1]:
            try:
                await self._named(self._exchange(call))
            except RefusedError as error:
                log.debug("%s: %s", self.identity.name, error)
        await self._named(self._exchange(calls[-1]))

    async def take_picture(self, index_hint: int | None = None) -> None:
        """Take one picture; returns when the command was accepted. The picture itself is announced by an ImageEvent.

        Args:
            index_hint: a number, from 0, that no other picture of this vehicle was commanded with; counts by default.
        """
        self._demand_known()
        self._pictures = self._pictures + 1 if index_hint is None else index_hint + 1
        await self._named(self._exchange(self._stack.picture_command(self._pictures)))

    async def _fly(
        self,
        what: str,
        steps: Callable[[FlightCommands], Awaitable[None]],
    ) -> None:
        """Run a sequence of commands; a newer sequence ends an older one at its next step."""
        self._demand_known()
        self._sequence += 1
        number = self._sequence

        def permit() -> None:
            if self._sequence != number:
                raise ConflictError(f"a newer command has overtaken {what!r}")

        control = FlightCommands(self, self._stack, self._channel, self._guard, permit, self._progress_of)
        try:
            self._channel.check()
            self._guard.check()
            await steps(control)
        except GcsError as error:
            await self._disarm_again(control)
            await self._raise_with_texts(what, error)

    async def _disarm_again(self, control: FlightCommands) -> None:
        """A start that failed after arming must not leave motors turning on the ground."""
        landed = self.telemetry.landed
        if not control.armed_by_us or landed is None or landed.value is not LandedState.ON_GROUND:
            return
        try:
            await control.disarm_motors()
        except GcsError as error:
            log.warning("%s: armed, not started, and not disarmed again: %s", self.identity.name, error)

    async def _raise_with_texts(self, what: str, error: GcsError) -> NoReturn:
        if not isinstance(error, RefusedError) or isinstance(error, ConflictError) or self.pilot_in_control:
            raise self._about_this(error) from error.__cause__
        await asyncio.sleep(TEXT_GRACE_S)
        since = self._now() - TEXT_AGE_S
        texts = [text.text for at, text in self._recent_texts if at >= since and text.severity <= WARNING]
        said = "; ".join(dict.fromkeys(texts[-3:]))
        message = f"cannot {what}: {error.message}" + (f" ({said})" if said else "")
        raise RefusedError(message, field=self.identity.name) from error

    def _must_be_on_ground(self, instead: str) -> None:
        if self.in_air:
            raise RefusedError(f"it is in the air; {instead}", field=self.identity.name)

    async def _exchange(self, call: CommandCall) -> None:
        system, component = self._channel.target
        if call.to_camera:
            if self.camera_component is None:
                raise RefusedError("no camera component of it has been heard")
            component = self.camera_component
        exchange = CommandExchange(
            call,
            target=(system, component),
            sender=self._channel.sender,
            send=self._channel.send,
            clock=self._now,
            on_progress=self._progress_of(call),
        )
        await self._channel.run(exchange)

    def _progress_of(self, call: CommandCall) -> OnProgress:
        """Tells of a command's progress as an event, at every tenth."""
        told: list[int | None] = []

        def tell(share: float | None) -> None:
            tenth = None if share is None else int(10 * share)
            if tenth not in told:
                told.append(tenth)
                self._publish(CommandProgressEvent(command_name(call.command), share))

        return tell
