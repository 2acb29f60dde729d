"""Messages of the live stream (WebSocket /api/live, station to dashboard), told apart by `type`.

The first message is a snapshot. When a client was too slow to take everything, its queue is dropped and a new snapshot
follows with `reason: catch_up`; what is append-only (log, track, images, replans, offers) is then read again over REST.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, RootModel

from gcs.api.schemas.base import Sent
from gcs.api.schemas.flights import FlightEvent, FlightInfo, ImageInfo, TrackSample
from gcs.api.schemas.leases import LeaseInfo
from gcs.api.schemas.plans import JobInfo, PlanSummary
from gcs.api.schemas.replans import PlanOfferInfo, ReplanInfo
from gcs.api.schemas.vehicles import LinkInfo, VehicleInfo, VehicleMessage


class SnapshotMessage(Sent):
    """All that is known now."""

    type: Literal["snapshot"] = "snapshot"
    at: str
    reason: Literal["start", "catch_up"]
    links: list[LinkInfo]
    vehicles: list[VehicleInfo]
    plans: list[PlanSummary]
    flights: list[FlightInfo]
    leases: list[LeaseInfo]
    messages: list[VehicleMessage]


class TelemetryMessage(Sent):
    """The newest of one vehicle; at most five times a second, the latest wins."""

    type: Literal["telemetry"] = "telemetry"
    vehicle: VehicleInfo


class LinkMessage(Sent):
    """A link was opened, failed or closed."""

    type: Literal["link"] = "link"
    link: LinkInfo


class VehicleTextMessage(Sent):
    """A vehicle says something to people."""

    type: Literal["message"] = "message"
    message: VehicleMessage


class JobMessage(Sent):
    """How far a job is."""

    type: Literal["job"] = "job"
    job: JobInfo


class PlanMessage(Sent):
    """A plan was made, failed or was cancelled."""

    type: Literal["plan"] = "plan"
    plan: PlanSummary


class PlanDeletedMessage(Sent):
    """A plan was deleted."""

    type: Literal["plan_deleted"] = "plan_deleted"
    plan_id: str


class FlightMessage(Sent):
    """A flight changed."""

    type: Literal["flight"] = "flight"
    flight: FlightInfo


class UploadMessage(Sent):
    """How far a mission transfer is."""

    type: Literal["upload"] = "upload"
    flight_id: str
    phase: str
    fraction: float


class TrackMessage(Sent):
    """New points of a flown path."""

    type: Literal["track"] = "track"
    flight_id: str
    points: list[TrackSample]


class EventMessage(Sent):
    """A new line of a flight's log."""

    type: Literal["event"] = "event"
    event: FlightEvent


class ImageMessage(Sent):
    """A picture was announced, is being fetched, is stored or failed."""

    type: Literal["image"] = "image"
    image: ImageInfo


class ReplanMessage(Sent):
    """A detour was reported and stored."""

    type: Literal["replan"] = "replan"
    replan: ReplanInfo


class LeaseMessage(Sent):
    """A companion tells where its lease of a flight stands."""

    type: Literal["lease"] = "lease"
    lease: LeaseInfo


class OfferMessage(Sent):
    """A plan for what was skipped is being made, is offered, was decided on or cannot be made."""

    type: Literal["offer"] = "offer"
    offer: PlanOfferInfo


class HeartbeatMessage(Sent):
    """Sent when nothing else was for two seconds, so that a dead stream shows."""

    type: Literal["heartbeat"] = "heartbeat"
    at: str


AnyLiveMessage = (
    SnapshotMessage
    | TelemetryMessage
    | LinkMessage
    | VehicleTextMessage
    | JobMessage
    | PlanMessage
    | PlanDeletedMessage
    | FlightMessage
    | UploadMessage
    | TrackMessage
    | EventMessage
    | ImageMessage
    | ReplanMessage
    | LeaseMessage
    | OfferMessage
    | HeartbeatMessage
)


class LiveMessage(RootModel[Annotated[AnyLiveMessage, Field(discriminator="type")]]):
    """Any message of the live stream."""
