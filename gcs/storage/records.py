"""What is stored, as frozen values: the words that the database, the services and the API share.

Times are UTC ISO 8601 where they are called `..._at`, and seconds since 1970 (UTC) where they are called `..._s`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

from gcs.core.mission import MissionItem


class PlanState(StrEnum):
    """How far a plan is. Only `ready` plans have files."""

    PLANNING = "planning"
    READY = "ready"
    FAILED = "failed"
    CANCELLED = "cancelled"
    INTERRUPTED = "interrupted"


class JobState(StrEnum):
    """How far a background job is; `interrupted` means that the station ended while it ran."""

    QUEUED = "queued"
    RUNNING = "running"
    DONE = "done"
    FAILED = "failed"
    CANCELLED = "cancelled"
    INTERRUPTED = "interrupted"

    @property
    def over(self) -> bool:
        """Whether it will not change any more."""
        return self not in {JobState.QUEUED, JobState.RUNNING}


class FlightPath(StrEnum):
    """Who steers along the plan: the vehicle by its mission, the station by setpoints, or a companion on board."""

    MISSION = "mission"
    OFFBOARD = "offboard"
    COMPANION = "companion"

    @property
    def by_setpoints(self) -> bool:
        """Whether the autopilot follows setpoints, and carries no mission."""
        return self is not FlightPath.MISSION


class FlightState(StrEnum):
    """Where a flight stands, as far as the vehicle's own messages show it."""

    CREATED = "created"
    UPLOADING = "uploading"
    UPLOADED = "uploaded"
    """The mission was read back and is the one that was sent: proved."""
    UPLOAD_FAILED = "upload_failed"
    ARMED = "armed"
    FLYING = "flying"
    PAUSED = "paused"
    HELD = "held"
    """An offboard flight after a gap or a restart of the station: it waits for the operator."""
    RETURNING = "returning"
    LANDING = "landing"
    COMPLETED = "completed"
    INCOMPLETE = "incomplete"
    ABORTED = "aborted"
    UNKNOWN = "unknown"
    """The vehicle is not heard, so nobody can say."""

    @property
    def over(self) -> bool:
        """Whether the flight has ended for good."""
        return self in {FlightState.COMPLETED, FlightState.INCOMPLETE, FlightState.ABORTED}


class UploadState(StrEnum):
    """How an upload ended; `proved` means read back and equal."""

    RUNNING = "running"
    PROVED = "proved"
    FAILED = "failed"
    INTERRUPTED = "interrupted"


class ViewpointFateName(StrEnum):
    """What became of a viewpoint that a replanning report names."""

    SKIPPED = "skipped"
    MOVED = "moved"


class OfferState(StrEnum):
    """Where an offered plan stands."""

    PLANNING = "planning"
    OFFERED = "offered"
    ACCEPTED = "accepted"
    REFUSED = "refused"
    FAILED = "failed"
    """There is no such plan, or it was not finished."""
    SUPERSEDED = "superseded"
    """More was skipped, and a newer offer has taken its place."""

    @property
    def open(self) -> bool:
        """Whether the operator may still decide, or will be able to."""
        return self in {OfferState.PLANNING, OfferState.OFFERED}


class ImageState(StrEnum):
    """What became of a picture."""

    ANNOUNCED = "announced"
    FETCHING = "fetching"
    STORED = "stored"
    FAILED = "failed"


@dataclass(frozen=True)
class Failure:
    """Why something failed, in the words of a `GcsError`."""

    title: str
    message: str
    field: str | None = None


@dataclass(frozen=True)
class StructureRecord:
    """A mesh that was brought in, and how it stands in a scene."""

    id: str
    name: str
    created_at: str
    file_name: str
    """Name of the file inside the structure's own folder; made by the station."""
    original_name: str
    sha256: str
    scale: float
    up: str
    position_m: tuple[float, float, float]
    rotation_deg: float
    triangles: int
    low_m: tuple[float, float, float]
    high_m: tuple[float, float, float]
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class PlanRecord:
    """A plan that was asked for; its files are in `plans/<id>/` once it is ready."""

    id: str
    name: str
    created_at: str
    scenario: dict[str, Any]
    state: PlanState
    plan_hash: str | None = None
    report: dict[str, Any] | None = None
    """Content of `report.json`."""
    failure: Failure | None = None


@dataclass(frozen=True)
class JobRecord:
    """A background job of a plan."""

    id: str
    plan_id: str
    state: JobState
    stage: str
    fraction: float
    created_at: str
    finished_at: str | None = None


@dataclass(frozen=True)
class LinkRecord:
    """A link that the operator opened; it is opened again at the next start."""

    id: str
    url: str
    created_at: str


@dataclass(frozen=True)
class FlightRecord:
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
    viewpoints: int
    """How many the plan has."""
    proved: bool = False
    started_at: str | None = None
    ended_at: str | None = None
    accepted_failsafes: tuple[str, ...] = ()
    plan_time_s: float | None = None
    """How far along the plan an offboard flight is."""
    max_cross_track_m: float | None = None
    problems: tuple[str, ...] = ()
    mission_sampling: dict[str, Any] | None = None
    """How its mission was made of the plan at the upload; None before that."""
    observer: str | None = None
    """Name of the vehicle whose sightings stand in for a lost position fix."""


@dataclass(frozen=True)
class FlightOverview:
    """A flight with the counts that its records give."""

    flight: FlightRecord
    viewpoints_reached: int
    images_received: int
    """Viewpoints that have a stored picture."""


@dataclass(frozen=True)
class FlightEventRecord:
    """One line of a flight's log. The log only grows."""

    id: int
    flight_id: str
    at: str
    kind: str
    """Such as state, command, message, mode, upload, image, viewpoint, replan, problem, log."""
    severity: int
    """As in MAVLink: 0 emergency to 7 debug."""
    text: str
    data: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class TrackPoint:
    """Where a vehicle was, scene ENU."""

    at_s: float
    position_m: tuple[float, float, float]
    cross_track_m: float | None = None
    """Distance from the nearest point of the planned curve."""


@dataclass(frozen=True)
class VisitRecord:
    """A viewpoint that was reached."""

    viewpoint_id: int
    at: str
    miss_m: float | None
    """Distance between where the vehicle was and the viewpoint, when its position was fresh."""


@dataclass(frozen=True)
class UploadRecord:
    """One attempt to put a flight's mission on its vehicle, with what was read back."""

    id: int
    flight_id: str
    state: UploadState
    started_at: str
    finished_at: str | None = None
    items_sent: int = 0
    items_read: int = 0
    how: str = ""
    canonical_crc32: int | None = None
    items: tuple[MissionItem, ...] = ()
    """As read back from the vehicle."""
    problem: str | None = None


@dataclass(frozen=True)
class ImageRecord:
    """A picture of a flight: announced by the vehicle, fetched over the link or brought on a card."""

    id: str
    flight_id: str
    index: int | None
    """The vehicle's running number; None when it came on a card without one."""
    viewpoint_id: int | None
    viewpoint_name: str | None
    state: ImageState
    source: str
    """`link` or `card`."""
    announced_at: str
    vehicle_path: str | None = None
    """As the vehicle named it; untrusted, never used as a path here."""
    vehicle_time_s: float | None = None
    position_m: tuple[float, float, float] | None = None
    file_name: str | None = None
    """Made by the station; None until it is stored."""
    size_bytes: int | None = None
    crc32: int | None = None
    stored_at: str | None = None
    problem: str | None = None


@dataclass(frozen=True)
class ReplanRecord:
    """A vehicle's report that it left the planned path, stored once."""

    id: int
    flight_id: str
    system_id: int
    boot_id: int
    number: int
    received_at: str
    plan_hash: str
    reason: str
    mission_item: int
    left_at_s: float
    """Vehicle clock."""
    rejoined_at_s: float | None
    """None when it did not come back to the plan."""
    path_m: tuple[tuple[float, float, float], ...]
    """Scene ENU."""
    plan_hash_after: str | None = None
    """Of the plan as it was changed; None in reports of a time when vehicles did not tell."""
    obstacle: ReplanObstacle | None = None
    viewpoints: tuple[ViewpointFateRecord, ...] = ()


@dataclass(frozen=True)
class ReplanObstacle:
    """What was in the way, as the vehicle saw it: an upright cylinder."""

    position_m: tuple[float, float, float]
    """Scene ENU."""
    radius_m: float
    velocity_m_s: tuple[float, float]
    """East and north."""


@dataclass(frozen=True)
class ViewpointFateRecord:
    """A viewpoint that a vehicle skipped, or took the picture of from another place."""

    viewpoint_id: int
    fate: ViewpointFateName
    position_m: tuple[float, float, float] | None = None
    """Where the picture is taken from instead, scene ENU; None when it is skipped."""


@dataclass(frozen=True)
class PlanOfferRecord:
    """A plan from home through the viewpoints that a flight skipped."""

    id: str
    flight_id: str
    state: OfferState
    created_at: str
    viewpoints: tuple[int, ...]
    """Ids in the plan that was flown."""
    names: tuple[str, ...]
    length_m: float | None = None
    duration_s: float | None = None
    decided_at: str | None = None
    """When the operator accepted or refused it."""
    plan_id: str | None = None
    """The station's plan that it became."""
    failure: Failure | None = None
