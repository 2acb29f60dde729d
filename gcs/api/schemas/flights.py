"""Flights: commands, states, what is on the vehicle, and what was flown."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field

from gcs.api.schemas.base import Point3, Sent, Taken
from gcs.api.schemas.leases import LeaseInfo
from gcs.api.schemas.predictions import PredictionInfo
from gcs.storage.records import FlightPath, FlightState, ImageState, UploadState

VehicleName = Annotated[str, Field(min_length=1, max_length=40)]
Confirmation = Annotated[
    str | None,
    Field(max_length=40, description="The vehicle's name (or bare system id), typed or slid by the operator."),
]
Accepted = Annotated[
    tuple[Annotated[str, Field(min_length=1, max_length=40)], ...],
    Field(max_length=50, description="Names of checks that the operator accepts; NAME=VALUE sets a failsafe instead."),
]


class FlightRequest(Taken):
    """Prepare a flight; nothing is changed on the vehicle."""

    plan_id: str
    vehicle: VehicleName
    mode: FlightPath | None = Field(
        None, description="Chosen by the prediction with the vehicle's own settings when it is left out."
    )


class UploadRequest(Taken):
    """Put the plan on the vehicle and prove it."""

    confirm: Confirmation = None
    accept: Accepted = ()


class StartRequest(Taken):
    """Arm, start or resume: the confirmation is needed and names the vehicle."""

    confirm: Annotated[str, Field(min_length=1, max_length=40, description="The vehicle's name or bare system id.")]
    accept: Accepted = ()
    observer: VehicleName | None = Field(
        None,
        description="At a start: another vehicle, whose sightings of this one stand in for a lost position fix.",
    )


class CommandRequest(Taken):
    """Pause, hold, return or land: makes a flight safer, so the confirmation may be left out; if given it must fit."""

    confirm: Confirmation = None


class FlightInfo(Sent):
    """One flight of one plan by one vehicle."""

    id: str
    plan_id: str
    plan_hash: str
    vehicle: str
    system_id: int
    mode: FlightPath
    state: FlightState
    created_at: str
    updated_at: str
    started_at: str | None
    ended_at: str | None
    proved: bool = Field(description="What is on the vehicle was read back and is the plan's mission.")
    viewpoints: int
    viewpoints_reached: int
    images_expected: int
    images_received: int
    max_cross_track_m: float | None
    plan_time_s: float | None
    accepted_failsafes: list[str]
    observer: str | None = Field(
        description="The vehicle whose sightings of this one stand in for a lost position fix."
    )
    problems: list[str]
    actions: list[str] = Field(
        description="What may be asked of it now: upload, cancel-transfer, start, pause, resume, return, land."
    )


class PreflightCheck(Sent):
    """One thing that was compared before arming."""

    name: str
    state: Literal["ok", "refused", "needs_acceptance", "accepted", "unknown"]
    detail: str
    accept: str | None = Field(description="The name by which it can be accepted, when it can.")


class PreflightInfo(Sent):
    """All checks before upload and arming."""

    flight_id: str
    at: str
    ok: bool
    checks: list[PreflightCheck]
    prediction: PredictionInfo | None = Field(
        description="Of both ways, with the vehicle's own settings; null when its way of flying is not known."
    )


class Visit(Sent):
    """A viewpoint that was reached."""

    viewpoint_id: int
    at: str
    miss_m: float | None


class TelemetryLogFile(Sent):
    """The record of every packet of a flight's link, in the form that MAVLink tools read."""

    name: str
    size_bytes: int = Field(description="As written so far.")


class FlightDetail(FlightInfo):
    """A flight with what was reached."""

    visits: list[Visit]
    telemetry_log: TelemetryLogFile | None = Field(description="Null when no packet of it was recorded.")
    lease: LeaseInfo | None = Field(description="Null when no companion was heard to fly it since the station's start.")


class FlightEvent(Sent):
    """One line of a flight's log."""

    id: int
    flight_id: str
    at: str
    kind: str
    severity: int = Field(description="0 emergency to 7 debug.")
    text: str
    data: dict[str, Any]


class TrackSample(Sent):
    """Where the vehicle was."""

    at_s: float = Field(description="Seconds since 1970, UTC.")
    position_m: Point3
    cross_track_m: float | None


class Track(Sent):
    """The flown path, oldest first."""

    flight_id: str
    points: list[TrackSample]


class MissionItemInfo(Sent):
    """A mission item as it was read back."""

    sequence: int
    frame: int
    command: int
    params: list[float | None] = Field(description="param1 to param4; null means unset (NaN).")
    x: int
    y: int
    z: float
    position_m: Point3 | None = Field(description="Scene ENU, for items that have a place.")
    viewpoint_id: int | None


class OnVehicle(Sent):
    """What the vehicle was last known to hold: read back from it, not what was sent."""

    flight_id: str
    state: UploadState | Literal["none"]
    read_at: str | None
    how: str
    equal: bool | None = Field(description="Whether it is the plan's mission; null when not known.")
    differences: list[str]
    canonical_crc32: int | None
    items: list[MissionItemInfo]
    problem: str | None


class ImageInfo(Sent):
    """A picture of a flight."""

    id: str
    flight_id: str
    index: int | None
    viewpoint_id: int | None
    viewpoint_name: str | None
    state: ImageState
    source: Literal["link", "card"]
    announced_at: str
    stored_at: str | None
    vehicle_path: str | None = Field(description="As the vehicle named it; untrusted, show as text only.")
    position_m: Point3 | None
    size_bytes: int | None
    crc32: int | None
    problem: str | None
