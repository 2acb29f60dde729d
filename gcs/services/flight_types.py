"""What the API asks of the flight service, and what it gets back beyond the stored records."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, Protocol

from gcs.storage.records import FlightPath, FlightState, UploadState

if TYPE_CHECKING:
    from gcs.core.mission import MissionItem
    from gcs.mavlink.companion_lease import LeaseStatus
    from gcs.services.flight_prediction import FlightPrediction
    from gcs.storage.records import FlightRecord, UploadRecord

CheckState = Literal["ok", "refused", "needs_acceptance", "accepted", "unknown"]


@dataclass(frozen=True)
class PreflightCheck:
    """One thing that is compared before upload or arming (safety rules 3, 5, 6, 7).

    Attributes:
        name: what was compared, such as `datum` or `NAV_DLL_ACT`.
        state: how it came out.
        detail: the figures, in one sentence.
        accept: the name by which an operator can accept it; None when it cannot be accepted.
    """

    name: str
    state: CheckState
    detail: str
    accept: str | None = None


@dataclass(frozen=True)
class PreflightReport:
    """All checks of one moment.

    Attributes:
        flight_id: the flight they are for.
        at: when, UTC ISO 8601.
        checks: in the order in which they matter.
        prediction: of both ways to fly the plan; None where that is not known or was not asked.
    """

    flight_id: str
    at: str
    checks: tuple[PreflightCheck, ...]
    prediction: FlightPrediction | None = None

    @property
    def ok(self) -> bool:
        """Whether nothing stands in the way."""
        return all(check.state in {"ok", "accepted"} for check in self.checks)


@dataclass(frozen=True)
class OnVehicleMission:
    """What a vehicle was last known to hold.

    Attributes:
        flight_id: the flight it was read for.
        state: how the last upload ended, `none` before the first.
        read_at: when it was read from the vehicle, UTC ISO 8601.
        how: by which protocol it was read.
        equal: whether it is the plan's mission in the vehicle's own form; None when not known.
        differences: in plain words, at most a handful.
        canonical_crc32: fingerprint of the items.
        items: as read from the vehicle.
        viewpoint_items: viewpoint id -> sequence of the item that takes its picture.
        problem: why it is not known.
    """

    flight_id: str
    state: UploadState | Literal["none"]
    read_at: str | None
    how: str
    equal: bool | None
    differences: tuple[str, ...]
    canonical_crc32: int | None
    items: tuple[MissionItem, ...]
    viewpoint_items: dict[int, int]
    problem: str | None = None

    @classmethod
    def last_proved(
        cls, flight: FlightRecord, upload: UploadRecord | None, viewpoint_items: dict[int, int]
    ) -> OnVehicleMission:
        """What the last upload of a flight proved; None when there was none."""
        if upload is None:
            return cls(flight.id, "none", None, "", None, (), None, (), {}, "nothing was uploaded yet")
        return cls(
            flight_id=flight.id,
            state=upload.state,
            read_at=upload.finished_at,
            how=upload.how,
            equal=True if upload.state is UploadState.PROVED and flight.proved else None,
            differences=(),
            canonical_crc32=upload.canonical_crc32,
            items=upload.items,
            viewpoint_items=viewpoint_items,
            problem=upload.problem,
        )


@dataclass(frozen=True)
class LeaseView:
    """Where a companion's lease of a flight stands.

    Attributes:
        flight_id: the flight.
        status: as the companion told it last.
        heard_s: when, by the station's monotonic clock.
    """

    flight_id: str
    status: LeaseStatus
    heard_s: float


_ON_THE_GROUND = {FlightState.CREATED, FlightState.UPLOAD_FAILED, FlightState.UPLOADED}


def allowed_actions(state: FlightState, mode: FlightPath) -> tuple[str, ...]:
    """What an operator may ask of a flight in this state; the vehicle may still refuse.

    A mission has to be uploaded and proved before it can start; a flight by setpoints carries none.
    """
    if state in _ON_THE_GROUND:
        if mode.by_setpoints:
            return ("start",)
        return ("upload", "start") if state is FlightState.UPLOADED else ("upload",)
    if state is FlightState.UPLOADING:
        return ("cancel-transfer",)
    in_the_air: dict[FlightState, tuple[str, ...]] = {
        FlightState.ARMED: ("pause", "return", "land"),
        FlightState.FLYING: ("pause", "return", "land"),
        FlightState.PAUSED: ("resume", "return", "land"),
        FlightState.HELD: ("resume", "return", "land"),
        FlightState.RETURNING: ("pause", "land"),
        FlightState.LANDING: ("pause", "return"),
        FlightState.UNKNOWN: ("pause", "return", "land"),
    }
    return in_the_air.get(state, ())


class FlightService(Protocol):
    """Flies plans with vehicles. Reads of stored flights do not go through it, they are in the database.

    All methods run on the station's event loop. A command returns when the vehicle's own state shows that it
    happened; `upload` returns at once with the state `uploading` and goes on in the background.

    Raises:
        NotFoundError: no such flight, plan or vehicle.
        ConflictError: not in this state, or another flight owns the vehicle.
        RefusedError: a check failed, the confirmation does not name the vehicle, or the vehicle refused.
        LinkError: the vehicle does not answer.
    """

    async def open(self) -> None:
        """At the start of the station: follow flights that are still open, hold those that were offboard."""

    async def close(self) -> None:
        """At the end of the station: stop streams; vehicles go on under their own control."""

    async def create(self, plan_id: str, vehicle: str, mode: FlightPath | None) -> FlightRecord:
        """Prepare a flight; nothing is changed on the vehicle.

        Without a mode both ways are predicted with the settings that the vehicle is asked for, and one is chosen.
        """
        ...

    def lease(self, flight_id: str) -> LeaseView | None:
        """Where the lease of the companion that flies it stands; None when none was heard since the start."""
        ...

    async def preflight(self, flight_id: str) -> PreflightReport:
        """Read the vehicle's limits, failsafes and references, and compare them with the plan."""
        ...

    async def upload(self, flight_id: str, *, confirm: str | None, accept: tuple[str, ...]) -> FlightRecord:
        """Check, then begin to put the mission on the vehicle and prove it."""
        ...

    async def on_vehicle(self, flight_id: str) -> OnVehicleMission:
        """What the last upload proved (from the records; asks the vehicle nothing)."""
        ...

    async def read_back(self, flight_id: str) -> OnVehicleMission:
        """Read the vehicle's mission now and compare it with the plan's."""
        ...

    async def cancel_transfer(self, flight_id: str) -> FlightRecord:
        """Stop the upload, read-back or check under way, in whatever step it is, and tell the vehicle.

        Returns:
            The flight, whose state and log say what is known of what the vehicle holds.

        Raises:
            ConflictError: none is under way.
        """
        ...

    async def start(
        self, flight_id: str, *, confirm: str, accept: tuple[str, ...], observer: str | None = None
    ) -> FlightRecord:
        """Check, arm, take off and fly; the confirmation names the vehicle.

        While the vehicle's own position fix is lost, the sightings of an observer, another vehicle, take its place.
        """
        ...

    async def resume(self, flight_id: str, *, confirm: str, accept: tuple[str, ...]) -> FlightRecord:
        """Go on from where the vehicle is; the confirmation names the vehicle."""
        ...

    async def pause(self, flight_id: str) -> FlightRecord:
        """Hold where it is."""
        ...

    async def return_home(self, flight_id: str) -> FlightRecord:
        """Let the vehicle fly its own return."""
        ...

    async def land(self, flight_id: str) -> FlightRecord:
        """Let the vehicle land where it is."""
        ...

    async def wait_for_upload(self, flight_id: str) -> FlightRecord:
        """Wait until an upload has ended; raises what it failed of."""
        ...

    async def wait(self, flight_id: str) -> FlightRecord:
        """Wait until a started flight is over; raises why it did not leave the ground."""
        ...
