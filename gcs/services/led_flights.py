"""Flights whose vehicle is led by setpoints, the station's own or its companion's: begun, followed to their end."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gcs.core.errors import GcsError
from gcs.services.companion_flight import CompanionFlight
from gcs.services.flight_recorder import ERROR
from gcs.services.offboard_flight import OffboardFlight, StreamEndedError
from gcs.storage.records import FlightState

if TYPE_CHECKING:
    import asyncio
    from collections.abc import Awaitable, Callable, Coroutine

    from gcs.core.plan import Plan
    from gcs.planning.trajectories.retiming import TimeWarp
    from gcs.services.flight_run import FlightRun
    from gcs.storage.database import Database


class LedFlights:
    """Leads vehicles.

    Args:
        database: for what earlier flights have shown of a vehicle.
        spawn: starts a task, which ends with the station.
        not_begun: told of a flight that did not leave the ground, and why.
    """

    def __init__(
        self,
        database: Database,
        spawn: Callable[[Coroutine[None, None, None]], asyncio.Task[None]],
        not_begun: Callable[[FlightRun, GcsError], Awaitable[None]],
    ) -> None:
        self._database = database
        self._spawn = spawn
        self._not_begun = not_begun

    def stream(self, run: FlightRun, plan: Plan, warp: TimeWarp) -> None:
        """Begin to stream a plan to a vehicle, its times slowed by a warp."""
        learned = self._database.dynamics.of(run.vehicle.identity.name)
        run.offboard = OffboardFlight(plan, warp, run.vehicle, run.recorder, run.collector, learned)
        self._spawn(self._stream(run, run.offboard))

    def lend(self, run: FlightRun, plan_hash: str) -> None:
        """Begin to have a vehicle led by its companion."""
        run.companion = CompanionFlight(run.plan, plan_hash, run.vehicle, run.recorder)
        self._spawn(self._lend(run, run.companion))

    def rejoin(self, run: FlightRun, plan_hash: str) -> None:
        """Follow a companion that may lead the vehicle already."""
        run.companion = CompanionFlight(run.plan, plan_hash, run.vehicle, run.recorder)
        self._spawn(self._lead(run, run.companion.rejoin))

    async def _stream(self, run: FlightRun, offboard: OffboardFlight) -> None:
        run.recorder.enter(FlightState.ARMED, "going into offboard")
        await self._lead(run, offboard.fly)
        run.recorder.change(plan_time_s=offboard.plan_time_s)
        self._database.dynamics.keep(run.vehicle.identity.name, run.recorder.flight_id, offboard.learned)

    async def _lend(self, run: FlightRun, companion: CompanionFlight) -> None:
        run.recorder.enter(FlightState.ARMED, "going to be led by its companion")
        await self._lead(run, companion.fly)
        run.recorder.change(plan_time_s=companion.plan_time_s)

    async def _lead(self, run: FlightRun, fly: Callable[[Callable[[], None]], Awaitable[None]]) -> None:
        """Have the vehicle led by setpoints until that ends, however it ends."""
        recorder = run.recorder
        try:
            await fly(lambda: recorder.enter(FlightState.FLYING, "the vehicle follows setpoints"))
        except StreamEndedError as error:
            recorder.log("offboard", str(error), severity=ERROR)
            run.show_mode()
        except GcsError as error:
            recorder.problem(str(error))
            if run.vehicle.in_air:
                run.show_mode()
            else:
                await self._not_begun(run, error)
