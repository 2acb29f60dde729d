"""Departures from plans as vehicles reported them, and plans offered for what they skipped."""

from __future__ import annotations

from pydantic import Field

from gcs.api.schemas.base import Failure, Point3, Sent
from gcs.services.replan_difference import Chain
from gcs.storage.records import OfferState, ViewpointFateName


class PlanPieceInfo(Sent):
    """A piece of a plan that was not flown."""

    from_s: float = Field(description="Plan time at its beginning.")
    to_s: float
    path_m: list[Point3]
    length_m: float
    duration_s: float


class ReplanObstacleInfo(Sent):
    """What was in the way, as the vehicle saw it: an upright cylinder."""

    position_m: Point3
    radius_m: float
    velocity_m_s: tuple[float, float] = Field(description="East and north.")


class ViewpointFateInfo(Sent):
    """A viewpoint that was not taken as planned."""

    viewpoint_id: int
    name: str | None = Field(description="Null when the flight's plan has no such viewpoint.")
    fate: ViewpointFateName
    position_m: Point3 | None = Field(description="Where the picture was taken from instead; null when it was skipped.")


class ReplanInfo(Sent):
    """A departure from the plan that the vehicle reported, as a difference from the plan."""

    id: int
    flight_id: str
    boot_id: int
    number: int
    received_at: str
    reason: str = Field(description="In words.")
    mission_item: int
    left_at_s: float = Field(description="Vehicle clock.")
    rejoined_at_s: float | None = Field(description="Null when the vehicle did not come back to the plan.")
    plan_hash: str
    plan_hash_after: str | None
    chain: Chain = Field(
        description="known: it left the flight's plan, as earlier reports changed it; gap: a report before it is "
        "missing; unknown: it left a plan that the station does not have, so nothing is compared."
    )
    left_out: PlanPieceInfo | None = Field(description="Null when the plan is not known.")
    path_m: list[Point3] = Field(description="What was flown instead.")
    flown_length_m: float
    flown_duration_s: float | None
    obstacle: ReplanObstacleInfo | None
    viewpoints: list[ViewpointFateInfo]


class PlanOfferInfo(Sent):
    """A plan from home through exactly the viewpoints that a flight skipped."""

    id: str
    flight_id: str
    state: OfferState = Field(
        description="planning, offered, then accepted or refused by the operator; failed: there is none, see failure; "
        "superseded: more was skipped, and a newer offer took its place."
    )
    created_at: str
    viewpoints: list[int] = Field(description="Ids in the plan that was flown.")
    names: list[str]
    length_m: float | None
    duration_s: float | None
    decided_at: str | None
    plan_id: str | None = Field(description="The plan that it became, once it is accepted.")
    failure: Failure | None
