"""Runs cooperative positioning between two vehicles of the station: one looks, the other is told where it is."""

from __future__ import annotations

import asyncio
import time
from contextlib import suppress
from typing import TYPE_CHECKING

from gcs.core.errors import LinkError, RefusedError
from gcs.mavlink.sightings import SightingReport, read_observer
from gcs.services.cooperative_positioning import CooperativePositioning

if TYPE_CHECKING:
    from collections.abc import Callable

    from gcs.mavlink.dialect import Message
    from gcs.mavlink.transaction import Clock
    from gcs.mavlink.vehicle import Vehicle

LOOK_EVERY_S = 0.2


class SightedFlight:
    """Tells one vehicle what another one sees of it, while its own position fix is lost.

    Args:
        observer: the vehicle that looks.
        seen: the vehicle that is told.
        say: takes lines for the operator.
        clock: that of both vehicles' channels.
    """

    def __init__(
        self, observer: Vehicle, seen: Vehicle, say: Callable[[str], None], clock: Clock = time.monotonic
    ) -> None:
        self._observer = observer
        self._seen = seen
        self._clock = clock
        names = observer.identity.name, seen.identity.name
        self._positioning = CooperativePositioning(*names, seen.identity.system_id, say)
        self.lag_s = 0.0
        """How old the vehicle takes a position to be when it comes."""

    @property
    def source(self) -> str | None:
        """Where the vehicle has its position from, in words; None while it has its own."""
        return self._positioning.source

    async def check(self) -> None:
        """See that the vehicle would use what it is told; nothing is changed on it.

        Raises:
            RefusedError: it would not, or the observer would too; says what to set.
            LinkError: it does not answer, or the observer is not heard.
        """
        if self._observer is self._seen:
            raise RefusedError("a vehicle cannot be its own observer", field=self._seen.identity.name)
        if not self._observer.connected:
            raise LinkError("the observer is not heard", field=self._observer.identity.name)
        self.lag_s = await self._seen.read_position_lag()
        if self._observer.shares_link_with(self._seen):
            await self._demand_deaf()

    async def _demand_deaf(self) -> None:
        """On one link the observer hears the positions, which name no vehicle: it must not take them for its own."""
        try:
            await self._observer.read_position_lag()
        except RefusedError:
            return
        raise RefusedError(
            f"it is on one link with {self._seen.identity.name} and would take that one's positions for its own: "
            "set its EKF2_EV_CTRL or GPS2_TYPE to 0, or give it a link of its own",
            field=self._observer.identity.name,
        )

    async def run(self) -> None:
        """Do it until cancelled; `check` comes before."""
        async with self._observer.messages() as heard:
            pending = asyncio.ensure_future(anext(heard))
            try:
                while True:
                    done, _ = await asyncio.wait({pending}, timeout=LOOK_EVERY_S)
                    self.watch()
                    if done:
                        self.take(pending.result())
                        pending = asyncio.ensure_future(anext(heard))
            finally:
                pending.cancel()

    def watch(self) -> None:
        """Look whether the vehicle has a fix of its own; to be called often."""
        self._positioning.watch(self._seen.telemetry, self._clock())

    def take(self, message: Message) -> None:
        """Take a message of the observer, and tell the other vehicle what follows from it."""
        told = read_observer(message)
        from_autopilot = message.get_srcComponent() == self._observer.identity.component_id
        if told is None or not (from_autopilot or isinstance(told, SightingReport)):
            return
        with suppress(LinkError):  # the clocks are known a second after a vehicle is first heard
            observer_now_s = self._observer.vehicle_now()
            seen = self._seen.telemetry
            new = self._positioning.take(told, observer_now_s, seen, self._clock())
            if new is None or seen.origin is None:
                return
            one_way_s = self._seen.clock.rate * (self._seen.link_quality.round_trip_s or 0.0) / 2
            self._seen.tell_position(
                self._positioning.position(
                    observer_now_s, one_way_s - self.lag_s, seen.origin.value, self._seen.vehicle_now(), time.time()
                )
            )
