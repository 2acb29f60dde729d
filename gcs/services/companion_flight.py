"""A flight that the vehicle's companion leads: the station takes off, orders, and follows what the companion tells."""

from __future__ import annotations

import asyncio
import secrets
import time
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING

from gcs.core.errors import GcsError
from gcs.core.vehicle import FlightMode
from gcs.mavlink.companion_lease import LeaseOrder, LeaseState, OrderKind
from gcs.services.flight_recorder import NOTICE, WARNING
from gcs.services.flight_types import LeaseView
from gcs.services.home_column import column_times, column_top_amsl_m
from gcs.services.offboard_flight import StreamEndedError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from gcs.core.plan import Plan
    from gcs.mavlink.companion_lease import LeaseStatus
    from gcs.mavlink.vehicle import Vehicle
    from gcs.services.flight_recorder import FlightRecorder

HOLDS_WITHIN_S = 15.0
SHOWS_WITHIN_S = 5.0
"""News of the companion may be here before the heartbeat that shows the mode."""
SILENT_S = 10.0
LEADS = frozenset({LeaseState.LEADING, LeaseState.PAUSED})


class CompanionFlight:
    """Has one plan flown by one vehicle's companion.

    Args:
        plan: what is flown.
        plan_hash: SHA-256 of its plan.json, by which the companion knows it.
        vehicle: who flies.
        recorder: where it is written down.
    """

    def __init__(self, plan: Plan, plan_hash: str, vehicle: Vehicle, recorder: FlightRecorder) -> None:
        self._plan = plan
        self._plan_hash = plan_hash
        self._vehicle = vehicle
        self._recorder = recorder
        self._lease: int | None = secrets.randbits(32) | 1
        self._status: LeaseStatus | None = None
        self._taken_over = False
        self._news = asyncio.Event()
        self.view: LeaseView | None = None
        """Where the lease stands, as last told; None before that."""

    @property
    def streaming(self) -> bool:
        """Whether the companion leads the vehicle, as far as was heard."""
        return self._status is not None and self._status.state in LEADS and not self._taken_over

    @property
    def plan_time_s(self) -> float:
        """How far the plan is flown, as last told."""
        return 0.0 if self._status is None else self._status.plan_time_s

    def hear(self, status: LeaseStatus) -> None:
        """The vehicle's companion tells where a lease stands: this one, or an older one."""
        if self._lease is None and status.lease and status.plan_hash == self._plan_hash:
            self._lease = status.lease
        if status.lease == self._lease:
            self._take(status)

    def taken_over(self) -> None:
        """Somebody else has the vehicle."""
        self._taken_over = True
        self._news.set()

    async def fly(self, on_flying: Callable[[], None]) -> None:
        """Take off or hold, have the companion fly the plan, and follow it until it lands or somebody takes over.

        Args:
            on_flying: called when the companion leads the vehicle.

        Nothing is armed before the companion has said, now and of this very plan, that it could fly it.

        Raises:
            StreamEndedError: the companion ended the lease early; the vehicle holds or somebody else has it.
            RefusedError: vehicle or companion refuse.
            LinkError: vehicle or companion do not answer.
        """
        vehicle = self._vehicle
        if vehicle.in_air:
            await vehicle.pause()  # a lease begins in a hold that a station commanded
        else:
            await vehicle.ready_companion(self._plan_hash, self._recorder.notice)
            leave, _ = column_times(self._plan)
            await vehicle.take_off(column_top_amsl_m(self._plan, leave))
            await vehicle.until(lambda: vehicle.in_air, HOLDS_WITHIN_S, "it to say that it is in the air")
        with self._lent():
            self._take(await self._order(OrderKind.FLY))
            on_flying()
            await self._follow()

    async def rejoin(self, on_flying: Callable[[], None]) -> None:
        """After a restart of the station: follow a companion that leads this plan, once it is heard; command nothing.

        Raises:
            StreamEndedError: the companion ended the lease early.
        """
        self._lease = None
        while not self._taken_over and (self._status is None or self._status.state is LeaseState.IDLE):
            self._news.clear()
            await self._news.wait()
        if not self.streaming:
            return
        with self._lent():
            on_flying()
            await self._follow()

    async def pause(self) -> None:
        """Have the companion slow down to a hover; it keeps the lease."""
        self._take(await self._order(OrderKind.PAUSE))

    async def resume(self) -> None:
        """Have it go on after a pause."""
        self._take(await self._order(OrderKind.RESUME))

    @contextmanager
    def _lent(self) -> Iterator[None]:
        self._vehicle.lend(self._lease)
        try:
            yield
        finally:
            self._vehicle.lend(None)

    async def _order(self, kind: OrderKind) -> LeaseStatus:
        assert self._lease is not None  # it leads, or is to
        return await self._vehicle.order_companion(LeaseOrder(self._lease, kind, self._plan_hash))

    async def _follow(self) -> None:
        """Until the lease is over or somebody else has the vehicle."""
        while self.streaming:
            self._news.clear()
            try:
                await asyncio.wait_for(self._news.wait(), SILENT_S)
            except TimeoutError:
                self._recorder.log("offboard", "the companion is not heard; it goes on by itself", severity=WARNING)
                await self._news.wait()
        vehicle, status = self._vehicle, self._status
        assert status is not None  # it led
        if self._taken_over or status.state is LeaseState.TAKEN_OVER:
            await self._shown(lambda: vehicle.pilot_in_control)
            if vehicle.pilot_in_control:  # which the vehicle's own event says
                return
        elif status.state is LeaseState.FINISHED:
            await self._shown(lambda: self._in_mode(FlightMode.LAND))
            return
        else:
            await self._shown(lambda: self._in_mode(FlightMode.HOLD))
        raise StreamEndedError(f"the companion ended its lease: {status.text}")

    async def _shown(self, holds: Callable[[], bool]) -> None:
        with suppress(GcsError):
            await self._vehicle.until(holds, SHOWS_WITHIN_S, "the mode that it is left in")

    def _in_mode(self, mode: FlightMode) -> bool:
        shown = self._vehicle.telemetry.mode
        return shown is not None and shown.value is mode

    def _take(self, status: LeaseStatus) -> None:
        before, self._status = self._status, status
        if before is None or (before.state, before.text) != (status.state, status.text):
            text = f"companion: {status.state.name.lower().replace('_', ' ')}, {status.text}"
            self._recorder.log("offboard", text, severity=NOTICE, plan_time_s=status.plan_time_s)
        self.view = LeaseView(self._recorder.flight_id, status, time.monotonic())
        self._recorder.tell_lease(self.view)
        self._news.set()
