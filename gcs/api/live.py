"""The live stream: a snapshot, then everything that happens, as typed messages."""

from __future__ import annotations

import asyncio
from contextlib import suppress
from typing import Literal, assert_never

from fastapi import APIRouter, WebSocket, WebSocketDisconnect

from gcs.api.dependencies import Services
from gcs.api.lease_views import lease_info
from gcs.api.replan_views import offer_info, replan_info
from gcs.api.schemas import live
from gcs.api.views import (
    flight_event,
    flight_info,
    image_info,
    job_info,
    link_info,
    plan_summary,
    track_sample,
    vehicle_info,
    vehicle_message,
)
from gcs.core.clock import utc_now
from gcs.services import live_feed
from gcs.services.station import StationServices

router = APIRouter()

HEARTBEAT_S = 2.0
SEND_TIMEOUT_S = 20.0


def live_message(event: live_feed.FeedEvent) -> live.AnyLiveMessage:
    """The message that tells of an event."""
    match event:
        case live_feed.TelemetryChanged(vehicle):
            return live.TelemetryMessage(vehicle=vehicle_info(vehicle))
        case live_feed.LinkChanged(link):
            return live.LinkMessage(link=link_info(link))
        case live_feed.VehicleSaid(text):
            return live.VehicleTextMessage(message=vehicle_message(text))
        case live_feed.JobChanged(job):
            return live.JobMessage(job=job_info(job))
        case live_feed.PlanChanged(plan):
            return live.PlanMessage(plan=plan_summary(plan))
        case live_feed.PlanDeleted(plan_id):
            return live.PlanDeletedMessage(plan_id=plan_id)
        case live_feed.FlightChanged(flight):
            return live.FlightMessage(flight=flight_info(flight))
        case live_feed.UploadProgressed(flight_id, phase, fraction):
            return live.UploadMessage(flight_id=flight_id, phase=phase, fraction=fraction)
        case live_feed.TrackGrew(flight_id, points):
            return live.TrackMessage(flight_id=flight_id, points=[track_sample(p) for p in points])
        case live_feed.EventLogged(logged):
            return live.EventMessage(event=flight_event(logged))
        case live_feed.ImageChanged(image):
            return live.ImageMessage(image=image_info(image))
        case live_feed.ReplanStored(replan):
            return live.ReplanMessage(replan=replan_info(replan))
        case live_feed.LeaseTold(lease):
            return live.LeaseMessage(lease=lease_info(lease))
        case live_feed.OfferChanged(offer):
            return live.OfferMessage(offer=offer_info(offer))
        case _:
            assert_never(event)


def render_live(event: live_feed.FeedEvent) -> str:
    """The message that tells of an event, as JSON."""
    return live_message(event).model_dump_json()


def snapshot(services: StationServices, reason: Literal["start", "catch_up"]) -> live.SnapshotMessage:
    """All that is known now."""
    flights = services.database.flights.summaries()
    leases = [services.flights.lease(f.flight.id) for f in flights]
    vehicles = services.vehicles.vehicles()
    messages = [m for v in vehicles for m in services.vehicles.messages(v.identity.name)]
    return live.SnapshotMessage(
        at=utc_now(),
        reason=reason,
        links=[link_info(link) for link in services.vehicles.links()],
        vehicles=[vehicle_info(v) for v in vehicles],
        plans=[plan_summary(p) for p in services.plans.list()],
        flights=[flight_info(f) for f in flights],
        leases=[lease_info(lease) for lease in leases if lease is not None],
        messages=[vehicle_message(m) for m in sorted(messages, key=lambda m: m.number)],
    )


@router.websocket("/live")
async def live_stream(websocket: WebSocket, services: Services) -> None:
    """Tell one dashboard everything until it leaves; what it sends is ignored."""
    await websocket.accept()
    listening = asyncio.create_task(_until_gone(websocket))
    talking = asyncio.create_task(_talk(websocket, services))
    try:
        await asyncio.wait({listening, talking}, return_when=asyncio.FIRST_COMPLETED)
    finally:
        for task in (listening, talking):
            task.cancel()
            with suppress(asyncio.CancelledError, WebSocketDisconnect, TimeoutError, RuntimeError):
                await task


async def _until_gone(websocket: WebSocket) -> None:
    while (await websocket.receive())["type"] != "websocket.disconnect":
        pass


async def _talk(websocket: WebSocket, services: StationServices) -> None:
    async def send(text: str) -> None:
        await asyncio.wait_for(websocket.send_text(text), SEND_TIMEOUT_S)

    with services.feed.subscribe() as client:
        await send(snapshot(services, "start").model_dump_json())
        while True:
            try:
                text = await client.next(HEARTBEAT_S)
            except live_feed.QueueOverflowError:
                text = snapshot(services, "catch_up").model_dump_json()
            await send(text if text is not None else live.HeartbeatMessage(at=utc_now()).model_dump_json())
