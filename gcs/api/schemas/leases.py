"""Where a companion's lease of a flight stands."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from gcs.api.schemas.base import Sent

LeaseStateName = Literal["idle", "refused", "leading", "paused", "finished", "ended", "taken_over"]


class LeaseInfo(Sent):
    """What the companion that flies a flight told last; it tells twice a second."""

    flight_id: str
    lease: str = Field(description="Its number, eight hex digits.")
    state: LeaseStateName = Field(
        description="idle: it prepares; leading; paused: it hovers by order; finished: the plan is flown; ended: it "
        "left the vehicle in a hold; taken_over: a pilot or the autopilot's failsafe has the vehicle; refused: it did "
        "not begin."
    )
    text: str = Field(description="The companion's own words.")
    away: str | None = Field(description="Why it is off the plan at the moment; null while it flies the plan.")
    plan_time_s: float = Field(description="How far the plan is flown, in its own time.")
    reports_pending: int = Field(description="Reports of departures that this station has not acknowledged yet.")
    lidar_age_s: float | None = Field(description="Since the last good scan; null when there was none.")
    odometry_quality: int | None = Field(description="Percent; null when it failed or there is none.")
    age_s: float = Field(description="Seconds between hearing it and sending this.")
