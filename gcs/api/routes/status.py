"""What the station says of itself."""

from __future__ import annotations

from fastapi import APIRouter

import gcs
from gcs.api.dependencies import Services
from gcs.api.schemas.status import Status
from gcs.core.clock import utc_now

router = APIRouter(tags=["status"])


@router.get("/status", operation_id="getStatus")
async def get_status(services: Services) -> Status:
    """The station in a few words."""
    return Status(
        name="gcs",
        version=gcs.__version__,
        started_at=services.started_at,
        now=utc_now(),
        data_dir=str(services.data_dir),
        vehicles=len(services.vehicles.vehicles()),
        links=len(services.vehicles.links()),
        jobs_running=len(services.database.jobs.running()),
        flights_open=len(services.database.flights.open_flights()),
        live_clients=services.feed.clients,
    )
