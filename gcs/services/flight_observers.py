"""Vehicles that look at others in flight: begun with the flight, taken up again after a restart of the station."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING

from gcs.core.errors import LinkError, NotFoundError, RefusedError
from gcs.services.flight_recorder import NOTICE, WARNING
from gcs.services.sighted_flight import SightedFlight

if TYPE_CHECKING:
    from gcs.services.flight_recorder import FlightRecorder
    from gcs.services.flight_run import FlightRun
    from gcs.services.vehicle_service import VehicleService

TRY_AGAIN_S = 0.5


class FlightObservers:
    """Has vehicles look at others.

    Args:
        vehicles: the station's vehicles.
    """

    def __init__(self, vehicles: VehicleService) -> None:
        self._vehicles = vehicles

    async def checked(self, observer: str, seen: str, recorder: FlightRecorder) -> SightedFlight:
        """A pair whose one vehicle sees the other, which would use what it is told; nothing is changed on them.

        Raises:
            NotFoundError: one of them was not heard.
            RefusedError: it would not work; says what to set.
            LinkError: one of them does not answer.
        """
        sighted = SightedFlight(self._vehicles.vehicle(observer), self._vehicles.vehicle(seen), recorder.notice)
        await sighted.check()
        return sighted

    def begin(self, run: FlightRun, observer: str, sighted: SightedFlight) -> None:
        """Tell the vehicle of a flight its position, wherever it has no fix of its own, until it is down."""
        identity = run.vehicle.identity
        run.recorder.change(observer=observer)
        run.recorder.notice(f"{observer} looks at {identity.name}, for where it has no position fix of its own")
        run.position_by(sighted)
        self._vehicles.set_position_source(identity.system_id, sighted)

    async def take_up(self, run: FlightRun, observer: str) -> None:
        """After a restart of the station: go on as soon as both vehicles are heard, and say it when that cannot be.

        It goes on by itself, since a vehicle without a fix that is told no position drifts.
        """
        recorder, seen = run.recorder, run.vehicle.identity.name
        recorder.log("command", f"{seen} is told no position until {observer} is heard again", severity=WARNING)
        while not run.down.is_set():
            try:
                self.begin(run, observer, await self.checked(observer, seen, recorder))
            except RefusedError as error:
                recorder.problem(f"after the restart of the station {seen} is told no positions: {error}")
            except (LinkError, NotFoundError):
                await asyncio.sleep(TRY_AGAIN_S)
                continue
            else:
                recorder.log("station", f"positions are told again since {observer} is heard", severity=NOTICE)
            return
