"""Replanning reports of all vehicles: given to the flight that they belong to, stored once, acknowledged, compared."""

from __future__ import annotations

import asyncio
import logging
from typing import TYPE_CHECKING

from gcs.core.clock import utc_now
from gcs.core.errors import GcsError
from gcs.core.frames import enu_from_geodetic
from gcs.mavlink.events import ReplanEvent
from gcs.services.flight_recorder import NOTICE, WARNING, FlightRecorder, log_line
from gcs.services.image_account import ImageAccounting, complete_by_pictures, count_pictures_as_visits
from gcs.services.live_feed import ReplanStored
from gcs.services.replan_difference import Chain, ReplanView, differences_of_flight
from gcs.storage.records import ReplanObstacle, ReplanRecord, ViewpointFateName, ViewpointFateRecord

if TYPE_CHECKING:
    from gcs.core.frames import GeoPoint
    from gcs.core.replanning import ReplanReport, ViewpointChange
    from gcs.mavlink.vehicle import Vehicle
    from gcs.services.live_feed import LiveFeed
    from gcs.services.plan_service import PlanService
    from gcs.services.vehicle_service import VehicleService
    from gcs.storage.database import Database
    from gcs.storage.image_store import ImageStore
    from gcs.storage.records import FlightRecord

log = logging.getLogger(__name__)

SAID_OF_CHAIN = {
    Chain.UNKNOWN: "it left a plan that this station does not know, so the report is kept without a comparison",
    Chain.GAP: "a report before this one is missing",
}


class ReplanReports:
    """Takes what vehicles report, also of flights that are over, and hands it out.

    Args:
        database: where it is written.
        feed: the dashboards.
        plans: the station's plans.
        vehicles: who reports.
        images: the pictures of all flights.
    """

    def __init__(
        self, database: Database, feed: LiveFeed, plans: PlanService, vehicles: VehicleService, images: ImageStore
    ) -> None:
        self._database = database
        self._feed = feed
        self._plans = plans
        self._vehicles = vehicles
        self._images = images
        self._task: asyncio.Task[None] | None = None
        self._left_alone: set[tuple[int, int]] = set()

    def open(self) -> None:
        """Begin to listen, in the running event loop."""
        self._task = asyncio.create_task(self._listen(), name="replanning reports")

    async def close(self) -> None:
        """Stop listening."""
        if self._task is not None:
            self._task.cancel()
            await asyncio.gather(self._task, return_exceptions=True)

    def of_flight(self, flight_id: str) -> list[ReplanView]:
        """The reports of a flight as differences from its plan.

        Raises:
            NotFoundError: there is no such flight.
            InputError: the files of its plan were damaged.
        """
        return reported_differences(self._database, self._plans, flight_id)

    async def _listen(self) -> None:
        station = self._vehicles.station
        async with station.events() as heard:
            async for told in heard:
                vehicle = station.vehicles.get(told.system_id)
                if isinstance(told.event, ReplanEvent) and vehicle is not None:
                    try:
                        record = self.take(vehicle, told.event.report)
                        if record is not None:
                            await self._match_pictures(record)
                    except GcsError:  # not acknowledged, so it will come again
                        log.exception("%s: a replanning report could not be stored", vehicle.identity.name)

    def take(self, vehicle: Vehicle, report: ReplanReport) -> ReplanRecord | None:
        """Store a report, once, and acknowledge it each time that it comes.

        One that belongs to no flight of this station is left to the vehicle: another station may be waiting for it.

        Returns:
            What was stored; None when it was stored already, or is left alone.
        """
        system_id, name = vehicle.identity.system_id, vehicle.identity.name
        flight = self._flight_of(name, system_id, report)
        if flight is None:
            if (system_id, report.boot_id) not in self._left_alone:
                self._left_alone.add((system_id, report.boot_id))
                log.warning("%s reports a departure from a plan, and has flown none for this station", name)
            return None
        anchor = self._plans.anchor(flight.plan_id)
        record, new = self._database.replans.add(_record(report, system_id, flight.id, anchor))
        vehicle.acknowledge_replan(report)
        if not new:
            return None
        self._tell(record, report.reason.words)
        return record

    async def _match_pictures(self, record: ReplanRecord) -> None:
        """Of a flight that is over, count anew when it is told only now from where its pictures were taken."""
        moved = any(change.fate is ViewpointFateName.MOVED for change in record.viewpoints)
        if not moved or record.flight_id in {flight.id for flight in self._database.flights.open_flights()}:
            return
        plan = self._plans.read(self._database.flights.get(record.flight_id).plan_id)
        recorder = FlightRecorder(record.flight_id, self._database, self._images, self._feed)
        account = await ImageAccounting(plan, recorder).settle_aside()
        count_pictures_as_visits(account, plan, recorder)
        complete_by_pictures(account, recorder)

    def _flight_of(self, vehicle: str, system_id: int, report: ReplanReport) -> FlightRecord | None:
        """The flight whose plan, or changed plan, the vehicle left; else the one of its other reports, or its last."""
        own = [o.flight for o in self._database.flights.summaries() if o.flight.vehicle == vehicle]
        for flight in own:
            if flight.plan_hash == report.plan_hash and flight.started_at is not None:
                return flight
        boot = self._database.replans.of_boot(system_id, report.boot_id)
        left = next((r for r in boot if r.plan_hash_after == report.plan_hash), boot[-1] if boot else None)
        if left is not None:
            return self._database.flights.get(left.flight_id)
        return next((flight for flight in own if flight.started_at is not None), None)

    def _tell(self, record: ReplanRecord, reason: str) -> None:
        """Into the flight's log, and to the dashboards; with those after it, which it may have joined to the plan."""
        views = self.of_flight(record.flight_id)
        what = "left the plan" if record.path_m else "did not take viewpoints as planned"
        self._log(record, f"the vehicle {what}: {reason}", NOTICE)
        place = next(k for k, view in enumerate(views) if view.record.id == record.id)
        odd = SAID_OF_CHAIN.get(views[place].chain)
        if odd is not None and not self._database.flights.has_line(record.flight_id, odd):
            self._log(record, odd, WARNING)
        for view in views[place:]:
            self._feed.publish(ReplanStored(view))

    def _log(self, record: ReplanRecord, text: str, severity: int) -> None:
        log_line(self._database, self._feed, record.flight_id, "replan", text, severity=severity, report=record.id)


def reported_differences(database: Database, plans: PlanService, flight_id: str) -> list[ReplanView]:
    """The stored reports of a flight as differences from its plan.

    Raises:
        NotFoundError: there is no such flight.
        InputError: the files of its plan were damaged.
    """
    flight = database.flights.get(flight_id)
    if not database.replans.of_flight(flight_id):
        return []
    return differences_of_flight(database, plans.read(flight.plan_id), flight)


def _record(report: ReplanReport, system_id: int, flight_id: str, anchor: GeoPoint) -> ReplanRecord:
    """A report in the scene that has this anchor."""

    def place(geo: GeoPoint) -> tuple[float, float, float]:
        east, north, up = enu_from_geodetic(geo.latitude_deg, geo.longitude_deg, geo.altitude_m, anchor)
        return float(east), float(north), float(up)

    def fate(change: ViewpointChange) -> ViewpointFateRecord:
        elsewhere = None if change.place is None else place(change.place)
        return ViewpointFateRecord(change.viewpoint, ViewpointFateName[change.fate.name], elsewhere)

    seen = report.obstacle
    return ReplanRecord(
        id=0,
        flight_id=flight_id,
        system_id=system_id,
        boot_id=report.boot_id,
        number=report.number,
        received_at=utc_now(),
        plan_hash=report.plan_hash,
        reason=report.reason.words,
        mission_item=report.mission_item,
        left_at_s=report.left_at_s,
        rejoined_at_s=report.rejoined_at_s,
        path_m=tuple(place(geo) for geo in report.path),
        plan_hash_after=report.plan_hash_after,
        obstacle=None if seen is None else ReplanObstacle(place(seen.place), seen.radius_m, seen.velocity_m_s),
        viewpoints=tuple(fate(change) for change in report.viewpoints),
    )
