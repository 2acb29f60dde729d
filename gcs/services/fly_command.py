"""`gcs fly`: one plan, one vehicle, from the upload to the last image, with the station's own flight service."""

from __future__ import annotations

import asyncio
from contextlib import asynccontextmanager, suppress
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from gcs.core.errors import GcsError, RefusedError
from gcs.services.live_feed import EventLogged, FeedEvent, QueueOverflowError
from gcs.services.station import StationServices
from gcs.storage.data_directory import default_data_directory
from gcs.storage.records import FlightPath, FlightState

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Callable
    from pathlib import Path

    from gcs.services.flight_types import PreflightReport
    from gcs.storage.records import FlightRecord

VEHICLE_TIMEOUT_S = 30.0
REFERENCES_TIMEOUT_S = 60.0
TOLD_KINDS = frozenset({"state", "viewpoint", "mode", "link", "problem", "replan", "offboard", "command"})


@dataclass(frozen=True)
class FlightOutcome:
    """The summary of `gcs fly --json`."""

    ok: bool
    flight: str
    proved: bool
    reached: int
    viewpoints: int
    images_expected: int
    images_received: int
    max_cross_track_m: float | None
    duration_s: float | None
    problems: tuple[str, ...]

    def as_json(self) -> dict[str, Any]:
        """As a JSON object."""
        return asdict(self)


async def fly_plan(
    out: Path,
    url: str,
    *,
    mode: str,
    confirm: Callable[[str], str],
    accept: tuple[str, ...],
    data_dir: Path | None,
    say: Callable[[str], None],
) -> FlightOutcome:
    """Fly a written plan.

    Args:
        out: the plan's folder.
        url: of the link to the vehicle.
        mode: `mission` or `offboard`.
        confirm: asked with the vehicle's name, returns what the operator typed.
        accept: failsafes that are off, and unknown values, accepted by name.
        data_dir: where the flight is recorded.
        say: takes lines for the operator.

    Raises:
        InputError: the folder holds no plan.
        LinkError: nobody answers.
        RefusedError: a check or the vehicle said no.
    """
    services = StationServices(data_dir or default_data_directory(), stored_links=False)
    async with services.running(_line), _telling(services, say):
        plan = services.plans.adopt(out).plan
        await services.vehicles.station.open(url)
        vehicle = await services.vehicles.station.wait_for_vehicle(VEHICLE_TIMEOUT_S)
        name = vehicle.identity.name
        say(f"{name} answers on {url}")
        with suppress(GcsError):  # the checks below say what is missing
            await vehicle.request_position_references(REFERENCES_TIMEOUT_S)
        flights = services.flights
        flight = await flights.create(plan.id, name, FlightPath(mode))
        say(f"flight {flight.id}")
        if flight.mode is FlightPath.MISSION:
            await flights.upload(flight.id, confirm=None, accept=accept)
            flight = await flights.wait_for_upload(flight.id)
            if flight.state is not FlightState.UPLOADED:
                raise RefusedError("; ".join(flight.problems), field=name)
        _show(await flights.preflight(flight.id), say)
        typed = confirm(name)
        await flights.start(flight.id, confirm=typed, accept=accept)
        try:
            flight = await flights.wait(flight.id)
        except asyncio.CancelledError:
            say(f"{name} goes on under its own control; nothing more is sent")
            raise
        return _outcome(services, flight)


def _outcome(services: StationServices, flight: FlightRecord) -> FlightOutcome:
    summary = services.database.flights.summary(flight.id)
    return FlightOutcome(
        ok=flight.state is FlightState.COMPLETED and not flight.problems,
        flight=flight.id,
        proved=flight.proved,
        reached=summary.viewpoints_reached,
        viewpoints=flight.viewpoints,
        images_expected=flight.viewpoints,
        images_received=summary.images_received,
        max_cross_track_m=flight.max_cross_track_m,
        duration_s=_seconds_between(flight.started_at, flight.ended_at),
        problems=flight.problems,
    )


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
