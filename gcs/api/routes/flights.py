"""Flights: commands and records."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Query
from fastapi.responses import Response, StreamingResponse

from gcs.api.dependencies import FlightId, Services
from gcs.api.doors import REPORT_CSP
from gcs.api.lease_views import lease_info
from gcs.api.replan_views import replan_info
from gcs.api.schemas.flights import (
    CommandRequest,
    FlightDetail,
    FlightEvent,
    FlightInfo,
    FlightRequest,
    ImageInfo,
    OnVehicle,
    PreflightInfo,
    StartRequest,
    TelemetryLogFile,
    Track,
    UploadRequest,
    Visit,
)
from gcs.api.schemas.replans import ReplanInfo
from gcs.api.views import (
    flight_event,
    flight_info,
    image_info,
    on_vehicle_info,
    preflight_info,
    track_sample,
)
from gcs.core.errors import RefusedError
from gcs.core.frames import GeoPoint
from gcs.services.flight_report import flight_report_page

router = APIRouter(prefix="/flights", tags=["flights"])

Limit = Annotated[int, Query(ge=1, le=20000)]


def _info(services: Services, flight_id: str) -> FlightInfo:
    return flight_info(services.database.flights.summary(flight_id))


def _anchor(services: Services, flight_id: str) -> GeoPoint:
    return services.plans.anchor(services.database.flights.get(flight_id).plan_id)


def _check_confirmation(services: Services, flight_id: str, confirm: str | None, *, needed: bool) -> None:
    """Safety rule 2: a confirmation names the vehicle."""
    flight = services.database.flights.get(flight_id)
    if confirm is None and not needed:
        return
    if confirm not in {flight.vehicle, str(flight.system_id)}:
        raise RefusedError(f"the confirmation must name the vehicle of this flight: {flight.vehicle}", field="confirm")


@router.get("", operation_id="listFlights")
def list_flights(services: Services) -> list[FlightInfo]:
    """Newest first."""
    return [flight_info(f) for f in services.database.flights.summaries()]


@router.post("", status_code=201, operation_id="createFlight")
async def create_flight(services: Services, request: FlightRequest) -> FlightInfo:
    """Prepare a flight of a plan by a vehicle; nothing is changed on the vehicle.

    Without a mode the vehicle is asked for its settings, and the way to fly is chosen by what is predicted of both.
    """
    flight = await services.flights.create(request.plan_id, request.vehicle, request.mode)
    return _info(services, flight.id)


@router.get("/{flight_id}", operation_id="getFlight")
def get_flight(services: Services, flight_id: FlightId) -> FlightDetail:
    """One flight with the viewpoints that were reached."""
    visits = [Visit.model_validate(v) for v in services.database.flights.visits(flight_id)]
    size = services.telemetry_logs.size_bytes(flight_id)
    name = services.telemetry_logs.file_name(flight_id)
    log = None if size is None else TelemetryLogFile(name=name, size_bytes=size)
    lease = services.flights.lease(flight_id)
    return FlightDetail(
        **_info(services, flight_id).model_dump(),
        visits=visits,
        telemetry_log=log,
        lease=None if lease is None else lease_info(lease),
    )


@router.get(
    "/{flight_id}/telemetry-log",
    operation_id="getTelemetryLog",
    response_class=StreamingResponse,
    responses={200: {"content": {"application/octet-stream": {"schema": {"type": "string", "format": "binary"}}}}},
)
def get_telemetry_log(services: Services, flight_id: FlightId) -> StreamingResponse:
    """Every packet of the flight's link as a tlog, for MAVLink tools; of a flight under way, what is written so far."""
    flight = services.database.flights.get(flight_id)
    size, pieces = services.telemetry_logs.read(flight.id)
    headers = {
        "Content-Length": str(size),
        "Content-Disposition": f'attachment; filename="{services.telemetry_logs.file_name(flight.id)}"',
    }
    return StreamingResponse(pieces, media_type="application/octet-stream", headers=headers)


@router.get(
    "/{flight_id}/report.html",
    operation_id="getFlightReport",
    response_class=Response,
    responses={200: {"content": {"text/html": {"schema": {"type": "string"}}}}},
)
def get_flight_report(services: Services, flight_id: FlightId) -> Response:
    """What was flown, reached, pictured and changed, for people, complete in one file."""
    page = flight_report_page(services.database, services.plans, services.replans, flight_id)
    return Response(page, media_type="text/html", headers={"Content-Security-Policy": REPORT_CSP})


@router.get("/{flight_id}/preflight", operation_id="checkFlight")
async def check_flight(services: Services, flight_id: FlightId) -> PreflightInfo:
    """Read the vehicle's limits, failsafes and references and compare them with the plan."""
    return preflight_info(await services.flights.preflight(flight_id))


@router.post("/{flight_id}/upload", status_code=202, operation_id="uploadFlight")
async def upload_flight(services: Services, flight_id: FlightId, request: UploadRequest) -> FlightInfo:
    """Begin to put the mission on the vehicle and prove it; the live stream tells how far it is."""
    _check_confirmation(services, flight_id, request.confirm, needed=False)
    await services.flights.upload(flight_id, confirm=request.confirm, accept=request.accept)
    return _info(services, flight_id)


@router.post("/{flight_id}/cancel-transfer", operation_id="cancelTransfer")
async def cancel_transfer(services: Services, flight_id: FlightId) -> FlightInfo:
    """Stop the upload, read-back or check under way, in whatever step it is, and tell the vehicle.

    After an upload that was cancelled it is not known what the vehicle holds, until it is read back or uploaded again.
    """
    await services.flights.cancel_transfer(flight_id)
    return _info(services, flight_id)


@router.post("/{flight_id}/start", operation_id="startFlight")
async def start_flight(services: Services, flight_id: FlightId, request: StartRequest) -> FlightInfo:
    """Check, arm, take off and fly; the confirmation names the vehicle."""
    _check_confirmation(services, flight_id, request.confirm, needed=True)
    await services.flights.start(flight_id, confirm=request.confirm, accept=request.accept, observer=request.observer)
    return _info(services, flight_id)


@router.post("/{flight_id}/resume", operation_id="resumeFlight")
async def resume_flight(services: Services, flight_id: FlightId, request: StartRequest) -> FlightInfo:
    """Go on after a pause or a hold, from where the vehicle is; the confirmation names the vehicle."""
    _check_confirmation(services, flight_id, request.confirm, needed=True)
    await services.flights.resume(flight_id, confirm=request.confirm, accept=request.accept)
    return _info(services, flight_id)


@router.post("/{flight_id}/pause", operation_id="pauseFlight")
async def pause_flight(services: Services, flight_id: FlightId, request: CommandRequest) -> FlightInfo:
    """Hold where it is."""
    _check_confirmation(services, flight_id, request.confirm, needed=False)
    await services.flights.pause(flight_id)
    return _info(services, flight_id)


@router.post("/{flight_id}/return", operation_id="returnFlight")
async def return_flight(services: Services, flight_id: FlightId, request: CommandRequest) -> FlightInfo:
    """Let the vehicle fly its own return."""
    _check_confirmation(services, flight_id, request.confirm, needed=False)
    await services.flights.return_home(flight_id)
    return _info(services, flight_id)


@router.post("/{flight_id}/land", operation_id="landFlight")
async def land_flight(services: Services, flight_id: FlightId, request: CommandRequest) -> FlightInfo:
    """Let the vehicle land where it is."""
    _check_confirmation(services, flight_id, request.confirm, needed=False)
    await services.flights.land(flight_id)
    return _info(services, flight_id)


@router.get("/{flight_id}/track", operation_id="getFlightTrack")
def get_flight_track(
    services: Services,
    flight_id: FlightId,
    after_s: Annotated[float, Query(description="Only points after this time (s since 1970, UTC).")] = 0.0,
) -> Track:
    """The flown path."""
    points = services.database.flights.track(flight_id, after_s=after_s)
    return Track(flight_id=flight_id, points=[track_sample(p) for p in points])


@router.get("/{flight_id}/events", operation_id="listFlightEvents")
def list_flight_events(
    services: Services, flight_id: FlightId, after: Annotated[int, Query(ge=0)] = 0, limit: Limit = 2000
) -> list[FlightEvent]:
    """The flight's log, oldest first."""
    return [flight_event(e) for e in services.database.flights.events(flight_id, after=after, limit=limit)]


@router.get("/{flight_id}/images", operation_id="listFlightImages")
def list_flight_images(services: Services, flight_id: FlightId) -> list[ImageInfo]:
    """The flight's pictures, as announced."""
    return [image_info(i) for i in services.database.images.of_flight(flight_id)]


@router.get("/{flight_id}/replans", operation_id="listFlightReplans")
def list_flight_replans(services: Services, flight_id: FlightId) -> list[ReplanInfo]:
    """Departures from the plan that the vehicle reported, as differences from it, in the order of the flight."""
    return [replan_info(view) for view in services.replans.of_flight(flight_id)]


@router.get("/{flight_id}/on-vehicle", operation_id="getOnVehicle")
async def get_on_vehicle(services: Services, flight_id: FlightId) -> OnVehicle:
    """What the vehicle was last known to hold, from the records."""
    return on_vehicle_info(await services.flights.on_vehicle(flight_id), _anchor(services, flight_id))


@router.post("/{flight_id}/read-back", operation_id="readBack")
async def read_back(services: Services, flight_id: FlightId) -> OnVehicle:
    """Read the vehicle's mission now and compare it with the plan's."""
    return on_vehicle_info(await services.flights.read_back(flight_id), _anchor(services, flight_id))
