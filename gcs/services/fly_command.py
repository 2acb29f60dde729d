"""`gcs fly`: one plan, one vehicle, from the upload to the last image, with the station's own flight service."""

from __future__ import annotations

import asyncio
import time
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass, fields
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from gcs.core.errors import GcsError, IncompleteError, InputError, LinkError, RefusedError
from gcs.services.fitted_upload import STOPPED_UPLOAD
from gcs.services.live_feed import EventLogged, FeedEvent, QueueOverflowError
from gcs.services.remaining_flight import next_flight
from gcs.services.station import StationServices
from gcs.storage.data_directory import default_data_directory
from gcs.storage.records import FlightPath, FlightState

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Awaitable, Callable

    from gcs.mavlink.vehicle import Vehicle
    from gcs.services.flight_types import PreflightReport

VEHICLE_TIMEOUT_S = 30.0
REFERENCES_TIMEOUT_S = 60.0
GIVE_UP_S = 60.0
"""After so long without a heartbeat in flight nothing more is expected of the vehicle."""
TOLD_KINDS = frozenset({"state", "viewpoint", "mode", "link", "problem", "replan", "offboard", "command", "log"})


@dataclass(frozen=True)
class FlightOutcome:
    """The summary of `gcs fly --json`; `failure` is what ended it early."""

    ok: bool
    flight: str | None
    proved: bool
    reached: int
    viewpoints: int
    images_expected: int
    images_received: int
    max_cross_track_m: float | None
    duration_s: float | None
    problems: tuple[str, ...]
    failure: GcsError | None = None

    def as_json(self) -> dict[str, Any]:
        """As a JSON object."""
        return {field.name: getattr(self, field.name) for field in fields(self) if field.name != "failure"}


async def fly_plan(
    out: Path,
    url: str,
    *,
    mode: str | None,
    confirm: Callable[[str], Awaitable[str]],
    accept: tuple[str, ...],
    data_dir: Path | None,
    say: Callable[[str], None],
    sortie: int | None = None,
    rest: bool = False,
    observer: str | None = None,
) -> FlightOutcome:
    """Fly a written plan.

    Args:
        out: the plan's folder.
        url: of the link to the vehicle.
        mode: `mission` or `offboard`, chosen by the prediction of both when not given; or `companion`.
        confirm: asked with the vehicle's name, returns what the operator typed.
        accept: failsafes that are off, and unknown values, accepted by name.
        data_dir: where the flight is recorded.
        say: takes lines for the operator.
        sortie: which one of a plan of several, from 1; the first that is not done yet when not given.
        rest: leave out the viewpoints that have their picture from earlier flights.
        observer: name or system id of another vehicle on the link, whose sightings stand in for a lost position fix.

    Returns:
        What came of it; a link that was lost, or a refusal, is its `failure`.

    Raises:
        InputError: the folder holds no plan, or nothing of it is left to fly.
        StorageError: nothing can be recorded.
    """
    services = StationServices(data_dir or default_data_directory(), stored_links=False, offers=False)
    async with services.running(_line), _telling(services, say):
        with TemporaryDirectory(prefix="gcs-rest-") as scratch:
            chosen = next_flight(out, sortie, rest, services.database, services.plans, Path(scratch))
            if chosen.said:
                say(chosen.said)
            flying = _Flying(services, chosen.directory, mode, accept, say)
        try:
            await flying.fly(url, confirm, observer)
        except (LinkError, RefusedError, IncompleteError) as error:
            return flying.outcome(error)
        return flying.outcome()


class _Flying:
    """One flight from the command line."""

    def __init__(
        self,
        services: StationServices,
        out: Path,
        mode: str | None,
        accept: tuple[str, ...],
        say: Callable[[str], None],
    ) -> None:
        self._services = services
        self._plan_id = services.plans.adopt(out).plan.id
        self._mode = None if mode is None else FlightPath(mode)
        self._accept = accept
        self._say = say
        self._flight_id: str | None = None

    async def fly(self, url: str, confirm: Callable[[str], Awaitable[str]], observer: str | None) -> None:
        """From the link to the account of the images."""
        station, flights, say = self._services.vehicles.station, self._services.flights, self._say
        await station.open(url)
        looking = None if observer is None else await station.wait_for_vehicle(VEHICLE_TIMEOUT_S, _system_of(observer))
        vehicle = await station.wait_for_vehicle(VEHICLE_TIMEOUT_S, other_than=looking)
        name = vehicle.identity.name
        say(f"{name} answers on {url}")
        with suppress(GcsError):  # the checks below say what is missing
            await vehicle.request_position_references(REFERENCES_TIMEOUT_S)
        flight = await flights.create(self._plan_id, name, self._mode)
        self._flight_id = flight.id
        say(f"flight {flight.id}")
        if flight.mode is FlightPath.MISSION:
            await flights.upload(flight.id, confirm=None, accept=self._accept)
            try:
                await flights.wait_for_upload(flight.id)
            except asyncio.CancelledError:  # the station that ends now tells the vehicle
                say(STOPPED_UPLOAD)
                raise
        _show(await flights.preflight(flight.id), say)
        await flights.start(flight.id, confirm=await confirm(name), accept=self._accept, observer=observer)
        try:
            await self._follow(flight.id, vehicle)
        except asyncio.CancelledError:
            say(f"{name} goes on under its own control; nothing more is sent")
            raise

    async def _follow(self, flight_id: str, vehicle: Vehicle) -> None:
        """Wait for the flight's end, and no longer than there is hope to hear of it.

        Raises:
            LinkError: the vehicle is not heard any more.
        """
        waiting = asyncio.ensure_future(self._services.flights.wait(flight_id))
        told_of_hold = False
        try:
            while not (await asyncio.wait({waiting}, timeout=1.0))[0]:
                silent_s = time.monotonic() - vehicle.last_heard_s
                if silent_s > GIVE_UP_S:
                    lost = f"not heard for {silent_s:.0f} s; where it is and what it does is not known"
                    raise LinkError(f"{lost}: `gcs serve` follows the flight again", field=vehicle.identity.name)
                held = self._services.database.flights.get(flight_id).state is FlightState.HELD
                if held and not told_of_hold:
                    self._say("the vehicle is held: land it by hand, or end this and resume the flight in `gcs serve`")
                told_of_hold = held
            await waiting
        finally:
            waiting.cancel()

    def outcome(self, failure: GcsError | None = None) -> FlightOutcome:
        """What came of it."""
        said = () if failure is None else (str(failure),)
        if self._flight_id is None:
            viewpoints = len(self._services.plans.read(self._plan_id).viewpoints)
            return FlightOutcome(False, None, False, 0, viewpoints, viewpoints, 0, None, None, said, failure)
        summary = self._services.database.flights.summary(self._flight_id)
        flight = summary.flight
        return FlightOutcome(
            ok=flight.state is FlightState.COMPLETED and not flight.problems and failure is None,
            flight=flight.id,
            proved=flight.proved,
            reached=summary.viewpoints_reached,
            viewpoints=flight.viewpoints,
            images_expected=flight.viewpoints,
            images_received=summary.images_received,
            max_cross_track_m=flight.max_cross_track_m,
            duration_s=_seconds_between(flight.started_at, flight.ended_at),
            problems=tuple(dict.fromkeys((*flight.problems, *said))),
            failure=failure,
        )


def _system_of(vehicle: str) -> int:
    """The system id in a vehicle's name, such as `px4-2`, or alone."""
    number = vehicle.rpartition("-")[2]
    if not number.isdecimal():
        raise InputError("is not the name of a vehicle, such as px4-2", field=vehicle)
    return int(number)


def _seconds_between(start: str | None, end: str | None) -> float | None:
    from datetime import datetime

    if start is None or end is None:
        return None
    return (datetime.fromisoformat(end) - datetime.fromisoformat(start)).total_seconds()


def _show(report: PreflightReport, say: Callable[[str], None]) -> None:
    for check in report.checks:
        say(f"  {check.state:16s} {check.name}: {check.detail}")


@asynccontextmanager
async def _telling(services: StationServices, say: Callable[[str], None]) -> AsyncIterator[None]:
    """Tell the operator what is written into the flight's log."""
    with services.feed.subscribe() as client:

        async def tell() -> None:
            while True:
                with suppress(QueueOverflowError):  # lines that were lost are in the log
                    line = await client.next(1.0)
                    if line:
                        say(line)

        telling = asyncio.create_task(tell())
        try:
            yield
            await asyncio.sleep(0.1)
        finally:
            telling.cancel()


def _line(event: FeedEvent) -> str:
    """The line that the operator sees of an event; empty for none."""
    if isinstance(event, EventLogged) and event.event.kind in TOLD_KINDS:
        return f"{event.event.at[11:19]} {event.event.text}"
    return ""
