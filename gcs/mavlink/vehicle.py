"""One vehicle: what it tells, and what it can be asked and commanded to do."""

from __future__ import annotations

import asyncio
import logging
import time

from gcs.core.errors import ConflictError, GcsError, LinkError, RefusedError
from gcs.core.vehicle import FlightMode, VehicleIdentity
from gcs.mavlink import events
from gcs.mavlink.events import OffboardEnd
from gcs.mavlink.flight_commands import FlightCommands
from gcs.mavlink.message_rates import OFFBOARD_RATES_HZ, request_rates
from gcs.mavlink.mode_guard import ModeChange
from gcs.mavlink.offboard import OffboardSession, Setpoint, SetpointStream
from gcs.mavlink.vehicle_channel import VehicleChannel
from gcs.mavlink.vehicle_flight import VehicleFlight

log = logging.getLogger(__name__)

OFFBOARD_LEAD_IN_S = 1.2
START_S = 5.0
FEED_S = 0.1
FRESH_S = 2.0
BACKLOG_S = 0.3
IN_AIR_S = 10.0


class Vehicle(VehicleFlight):
    """A vehicle that the station has heard.

    Made by `MavlinkStation`. All methods are for the event loop, if not said otherwise. Every command returns only when
    the vehicle's own state shows it, and raises RefusedError, with the vehicle's own words where it gave some, or
    LinkError. `VehicleState` has what it tells, `VehicleTransfers` missions, parameters and files, `VehicleFlight` the
    commands; here is the stream of setpoints.

    Args:
        identity: who it is.
        channel: to it.
        lost_after_s: without heartbeats for so long the link counts as lost.
    """

    def __init__(self, identity: VehicleIdentity, channel: VehicleChannel, *, lost_after_s: float = 3.0) -> None:
        super().__init__(identity, channel, lost_after_s=lost_after_s)
        self._session: OffboardSession | None = None
        self._lease: str | None = None
        self._in_offboard = False
        self._leaving = False

    @property
    def offboard_session(self) -> OffboardSession | None:
        """The running stream of setpoints, if any."""
        return self._session

    async def close(self) -> None:
        """See VehicleState."""
        if self._session is not None:
            self._session.halt(OffboardEnd.STOPPED, "the station closed the link")
        await super().close()

    async def offboard(
        self,
        owner: str,
        *,
        take_off_altitude_amsl_m: float | None = None,
        rate_hz: float = 50.0,
        deadman_s: float = 0.5,
    ) -> OffboardSession:
        """Lease its setpoints, bring it into OFFBOARD (GUIDED), and hover there.

        On the ground it takes off first. It then hovers until the owner calls `OffboardSession.fly` with a source. From
        the return on the owner must call `feed` at least every `deadman_s` seconds; the stream ends at once when that
        stops, when the mode changes without a command, when the vehicle disarms or is not heard any more.

        Args:
            owner: who leases it, for people.
            take_off_altitude_amsl_m: where to hover after the take-off, above mean sea level; for a vehicle that flies
                already it is not used.
            rate_hz: setpoints per second of the vehicle's clock.
            deadman_s: see above, in station time.

        Raises:
            ConflictError: somebody has the lease.
            RefusedError: the vehicle is not the station's to command, is on the ground without a take-off altitude, or
                refuses.
            LinkError: it does not answer, or does not tell its position.
        """
        self._demand_known()
        if self._lease is not None:
            raise ConflictError(f"its setpoints are leased to {self._lease}", field=self.identity.name)
        if not self.in_air and take_off_altitude_amsl_m is None:
            raise RefusedError("it is on the ground: give an altitude to take off to", field=self.identity.name)
        self._lease = owner

        async def enter(control: FlightCommands) -> None:
            if self.in_air:
                await self._stack.hold_before_stream(control)
            elif take_off_altitude_amsl_m is not None:
                await self._stack.take_off(control, take_off_altitude_amsl_m)
                await self.until(lambda: self.in_air, IN_AIR_S, "it to say that it is in the air")
            session = self._begin(self._hovering_session(owner, rate_hz, deadman_s))
            await self.until(lambda: session.setpoints_sent > 0 or not session.active, START_S, "the first setpoint")
            await asyncio.sleep(OFFBOARD_LEAD_IN_S)
            await self._stack.enter_offboard(control)

        feeding = asyncio.ensure_future(self._feed())
        try:
            await self._fly("enter offboard", enter)
            session = self._running_session()
        except BaseException:
            if self._session is not None:
                self._session.halt(OffboardEnd.STOPPED, "the vehicle did not go into offboard")
            else:
                self._lease = None
            raise
        finally:
            feeding.cancel()
        session.feed()
        if self.takes_acceleration_forward:
            self._spawn(self._ask_for_tilt())
        return session

    async def _ask_for_tilt(self) -> None:
        try:
            await request_rates(self._channel, OFFBOARD_RATES_HZ)
        except GcsError as error:
            log.info("%s was not asked for its wanted attitude: %s", self.identity.name, error)

    def _running_session(self) -> OffboardSession:
        if self._session is None or not self._session.active:
            raise RefusedError("the stream of setpoints ended as soon as it began", field=self.identity.name)
        return self._session

    def _begin(self, session: OffboardSession) -> OffboardSession:
        session.start()
        self._session, self._in_offboard, self._leaving = session, False, False
        return session

    async def _feed(self) -> None:
        """The event loop keeps the stream alive until its owner can."""
        while True:
            if self._session is not None:
                self._session.feed()
            await asyncio.sleep(FEED_S)

    def _hovering_session(self, owner: str, rate_hz: float, deadman_s: float) -> OffboardSession:
        place, yaw = self.telemetry.local_position_m, self.telemetry.yaw_rad
        now = self._now()
        if place is None or yaw is None or place.age_s(now) > FRESH_S or yaw.age_s(now) > FRESH_S:
            raise LinkError("it does not tell its local position and attitude", field=self.identity.name)
        self._guard.check()
        self.vehicle_now()
        hover = Setpoint.hover(place.value, yaw.value)
        stream = SetpointStream(
            target=self._channel.target, clock=time.monotonic, deadman_s=deadman_s, source=lambda _: hover
        )
        loop = asyncio.get_running_loop()

        def ended(session: OffboardSession) -> None:
            if not loop.is_closed():
                loop.call_soon_threadsafe(self._offboard_ended, session)

        return OffboardSession(
            owner,
            stream,
            own_system=self._channel.sender[0],
            peer=self._channel.peer,
            passed=self.passed,
            vehicle_at=self.vehicle_at,
            clock_rate=lambda: self.clock.rate,
            rate_hz=rate_hz,
            on_end=ended,
            leave=self._leave_offboard,
        )

    async def _leave_offboard(self, session: OffboardSession) -> None:
        self._leaving = True
        try:
            await self._fly("hold", self._stack.pause)
        finally:
            session.halt(OffboardEnd.STOPPED)

    def _offboard_ended(self, session: OffboardSession) -> None:
        if session is not self._session:
            return
        end, detail = session.end or (OffboardEnd.SOURCE_FAILED, "")
        self._session, self._lease = None, None
        self._publish(events.OffboardEndedEvent(session.owner, end, detail))
        mode = self.telemetry.mode
        wants_hold = end in (OffboardEnd.FINISHED, OffboardEnd.DEADMAN, OffboardEnd.SOURCE_FAILED)
        if wants_hold and mode is not None and mode.value is FlightMode.OFFBOARD and not self._closed:
            self._spawn(self._hold_after_stream(end))

    async def _hold_after_stream(self, end: OffboardEnd) -> None:
        """Have it hold, if it is still led by the stream.

        Which it may not be after a dead man's stop: when this process stood still, what was heard is old, what is
        waiting in the sockets is old too, and a pilot may have taken over.
        """
        try:
            if end is OffboardEnd.DEADMAN:
                new_from = self._now() + BACKLOG_S
                await self.until(lambda: self._heard_since("mode", new_from), FRESH_S, "a heartbeat")
            mode = self.telemetry.mode
            if mode is not None and mode.value is FlightMode.OFFBOARD:
                await self._fly("hold", self._stack.pause)
        except GcsError as error:
            log.warning("%s: the stream of setpoints ended, and it did not go into hold: %s", self.identity.name, error)

    def _mode_changed(self, change: ModeChange, mode: FlightMode, name: str) -> None:
        """Decide what a change of mode means for the stream; before anything else hears of the change."""
        session = self._session
        if session is None:
            return
        if mode is FlightMode.OFFBOARD and change is ModeChange.COMMANDED:
            self._in_offboard = True
        elif change is ModeChange.COMMANDED and mode is FlightMode.TAKEOFF and not self._in_offboard:
            pass  # the take-off that leads here, shown late
        elif change is ModeChange.COMMANDED:
            session.halt(OffboardEnd.STOPPED if self._leaving else OffboardEnd.COMMANDED)
        elif self._in_offboard or change is not ModeChange.OWN:
            session.halt(OffboardEnd.MODE_CHANGED, f"the vehicle went into {name} without a command of the station")

    def _disarmed(self) -> None:
        if self._session is not None:
            self._session.halt(OffboardEnd.DISARMED)

    def _id_clashes(self) -> None:
        if self._session is not None:
            self._session.halt(OffboardEnd.ID_CLASH)

    def _link_lost(self) -> None:
        if self._session is not None:
            self._session.halt(OffboardEnd.LINK_LOST)
