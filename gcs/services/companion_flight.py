"""A flight that the vehicle's companion leads: the station takes off, orders, and follows what the companion tells."""

from __future__ import annotations

import asyncio
import secrets
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING

from gcs.core.errors import GcsError
from gcs.core.vehicle import FlightMode
from gcs.mavlink.companion_lease import COMPANION, OVER, LeaseOrder, LeaseState, OrderKind, lease_status
from gcs.services.flight_recorder import NOTICE, WARNING
from gcs.services.home_column import column_times, column_top_amsl_m
from gcs.services.offboard_flight import StreamEndedError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from gcs.core.plan import Plan
    from gcs.mavlink.companion_lease import LeaseStatus
    from gcs.mavlink.dialect import Message
    from gcs.mavlink.vehicle import Vehicle
    from gcs.services.flight_recorder import FlightRecorder

HOLDS_WITHIN_S = 15.0
LANDS_WITHIN_S = 5.0
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
        self._lease = secrets.randbits(32) | 1
        self._status: LeaseStatus | None = None

    @property
    def streaming(self) -> bool:
        """Whether the companion leads the vehicle, as far as was heard."""
        return self._status is not None and self._status.state in LEADS

    @property
    def plan_time_s(self) -> float:
        """How far the plan is flown, as last told."""
        return 0.0 if self._status is None else self._status.plan_time_s

    async def fly(self, on_flying: Callable[[], None]) -> None:
        """Take off if need be, have the companion fly the plan, and follow it until it lands.

        Args:
            on_flying: called when the companion leads the vehicle.

        Raises:
            StreamEndedError: the companion ended the lease early; the vehicle holds or somebody else has it.
            RefusedError: vehicle or companion refuse.
            LinkError: vehicle or companion do not answer.
        """
        vehicle = self._vehicle
        if not vehicle.in_air:
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
        async with self._vehicle.messages() as messages:
            async for message in messages:
                status = self._read(message)
                if status is not None and status.plan_hash == self._plan_hash and status.state in LEADS:
                    self._lease = status.lease
                    break
            else:
                return
        with self._lent():
            self._take(status)
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
        self._vehicle.lend(to_companion=True)
        try:
            yield
        finally:
            self._vehicle.lend(to_companion=False)

    async def _order(self, kind: OrderKind) -> LeaseStatus:
        return await self._vehicle.order_companion(LeaseOrder(self._lease, kind, self._plan_hash))

    async def _follow(self) -> None:
        """Until the lease is over."""
        async with self._vehicle.messages() as messages:
            while self._status is None or self._status.state not in OVER:
                try:
                    async with asyncio.timeout(SILENT_S):
                        message = await anext(messages)
                        while (status := self._read(message)) is None or status.lease != self._lease:
                            message = await anext(messages)
                except TimeoutError:
                    self._recorder.log("offboard", "the companion is not heard; it goes on by itself", severity=WARNING)
                    with suppress(GcsError):
                        await self._vehicle.until(lambda: self._vehicle.connected, SILENT_S, "the link")
                    continue
                self._take(status)
        if self._status.state is not LeaseState.FINISHED:
            raise StreamEndedError(f"the companion ended its lease: {self._status.text}")
        with suppress(GcsError):  # its news may be here before the heartbeat that shows what it commanded
            await self._vehicle.until(self._lands, LANDS_WITHIN_S, "it to land")

    def _lands(self) -> bool:
        mode = self._vehicle.telemetry.mode
        return mode is not None and mode.value is FlightMode.LAND

    @staticmethod
    def _read(message: Message) -> LeaseStatus | None:
        return lease_status(message) if message.get_srcComponent() == COMPANION else None

    def _take(self, status: LeaseStatus) -> None:
        before, self._status = self._status, status
        if before is None or (before.state, before.text) != (status.state, status.text):
            text = f"companion: {status.state.name.lower()}, {status.text}"
            self._recorder.log("offboard", text, severity=NOTICE, plan_time_s=status.plan_time_s)
