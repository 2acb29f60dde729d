"""The running station: all services of one data directory, opened and closed together."""

from __future__ import annotations

import os
from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack, asynccontextmanager
from typing import TYPE_CHECKING, TypeAlias

from gcs.core.clock import utc_now
from gcs.services.live_feed import FeedEvent, LiveFeed

if TYPE_CHECKING:
    from pathlib import Path

    from gcs.jobs.planning_jobs import PlanningJobs
    from gcs.mavlink.station import MavlinkStation
    from gcs.services.flight_types import FlightService
    from gcs.services.plan_offers import PlanOffers
    from gcs.services.plan_service import PlanService
    from gcs.services.replan_reports import ReplanReports
    from gcs.services.structure_service import StructureService
    from gcs.services.vehicle_service import VehicleService
    from gcs.storage.database import Database
    from gcs.storage.image_store import ImageStore
    from gcs.storage.telemetry_log import TelemetryLogStore


class StationServices:
    """What the API and the flight service work with.

    Args:
        data_dir: where everything that must last is kept.
        links: URLs to open; not kept for later runs.
        stored_links: whether the links of earlier runs are opened too.
        offers: whether plans for what was skipped are offered when a flight is over, not only on request.
        make_flights: makes the flight service once all others are open; tests put another in.
        make_mavlink: makes the MAVLink side; tests put another in.
        make_jobs: makes what runs the planning; tests put another in.
    """

    database: Database
    structures: StructureService
    plans: PlanService
    vehicles: VehicleService
    images: ImageStore
    telemetry_logs: TelemetryLogStore
    flights: FlightService
    replans: ReplanReports
    offers: PlanOffers
    started_at: str

    def __init__(
        self,
        data_dir: Path,
        *,
        links: tuple[str, ...] = (),
        stored_links: bool = True,
        offers: bool = True,
        make_flights: FlightsFactory | None = None,
        make_mavlink: MavlinkFactory | None = None,
        make_jobs: JobsFactory | None = None,
    ) -> None:
        self.data_dir = data_dir
        self.feed = LiveFeed()
        self._links = links
        self._stored_links = stored_links
        self._offers = offers
        self._make_flights = make_flights
        self._make_mavlink = make_mavlink
        self._make_jobs = make_jobs

    @asynccontextmanager
    async def running(self, render: Callable[[FeedEvent], str]) -> AsyncIterator[None]:
        """Open everything for the time of an `async with` block.

        Args:
            render: makes the text of a live message.

        Raises:
            ConflictError: another station uses the data directory.
            StorageError: the data directory or the database cannot be used.
        """
        from gcs.services.plan_offers import PlanOffers
        from gcs.services.plan_service import PlanService
        from gcs.services.replan_reports import ReplanReports
        from gcs.services.structure_service import StructureService
        from gcs.services.vehicle_service import VehicleService
        from gcs.storage.data_directory import owned_data_directory
        from gcs.storage.database import Database
        from gcs.storage.image_store import ImageStore
        from gcs.storage.signing_keys import PASSPHRASE_VARIABLE, SigningKeyStore
        from gcs.storage.telemetry_log import TelemetryLogStore

        self.started_at = utc_now()
        async with AsyncExitStack() as stack:
            stack.enter_context(owned_data_directory(self.data_dir))
            self.database = Database(self.data_dir)
            stack.callback(self.database.close)
            self.database.jobs.mark_interrupted()
            self.database.flights.mark_uploads_interrupted()
            self.feed.open(render)
            self.images = ImageStore(self.data_dir)
            self.telemetry_logs = TelemetryLogStore(self.data_dir)
            self.structures = StructureService(self.database, self.data_dir)
            self.structures.open()
            jobs = (self._make_jobs or _planning_jobs)()
            self.plans = PlanService(self.database, self.feed, self.data_dir, jobs)
            self.plans.open()
            stack.push_async_callback(self.plans.close)
            self.offers = PlanOffers(self.database, self.feed, self.plans, jobs, self.data_dir)
            self.offers.open(by_itself=self._offers)
            stack.push_async_callback(self.offers.close)
            mavlink = (self._make_mavlink or _mavlink_station)()
            keys = SigningKeyStore(self.data_dir, os.environ.get(PASSPHRASE_VARIABLE))
            self.vehicles = VehicleService(self.database, self.feed, mavlink, self._links, keys)
            stack.push_async_callback(self.vehicles.close)
            self.replans = ReplanReports(self.database, self.feed, self.plans, self.vehicles, self.images)
            self.replans.open()
            stack.push_async_callback(self.replans.close)
            await self.vehicles.open(stored_links=self._stored_links)
            self.flights = (self._make_flights or _flight_service)(self)
            stack.push_async_callback(self.flights.close)
            await self.flights.open()
            yield


def _mavlink_station() -> MavlinkStation:
    from gcs.mavlink.station import MavlinkStation

    return MavlinkStation()


def _flight_service(services: StationServices) -> FlightService:
    from gcs.services.flight_service import FlightControlService

    return FlightControlService(
        services.database,
        services.images,
        services.telemetry_logs,
        services.feed,
        services.plans,
        services.vehicles,
    )


def _planning_jobs() -> PlanningJobs:
    from gcs.jobs.planning_jobs import PlanningJobs

    return PlanningJobs()


FlightsFactory: TypeAlias = "Callable[[StationServices], FlightService]"
MavlinkFactory: TypeAlias = "Callable[[], MavlinkStation]"
JobsFactory: TypeAlias = "Callable[[], PlanningJobs]"
