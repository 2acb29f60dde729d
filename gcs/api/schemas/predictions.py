"""What a vehicle is predicted to fly of a plan, both ways."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from gcs.api.schemas.base import Point3, Sent


class WayForecast(Sent):
    """How one way to fly a plan is predicted to go."""

    time_s: float = Field(description="From take-off to the ground.")
    waits_s: float = Field(description="How much of it the mission stands still for pictures.")
    mean_deviation_m: float = Field(description="From the plan's curve.")
    max_deviation_m: float
    min_clearance_m: float = Field(description="Hull to the nearest surface, cable or the ground.")
    place_m: Point3 = Field(description="Where that is.")
    at_s: float = Field(description="When.")
    finished: bool = Field(description="Whether the flight comes to its end.")


class PredictionInfo(Sent):
    """Both ways to fly a plan on one kind of autopilot, and which is better."""

    autopilot: str
    mission: WayForecast = Field(description="Flown by the autopilot alone.")
    offboard: WayForecast = Field(description="As setpoints from the station.")
    mission_items: int | None = Field(None, description="None in reports of earlier releases.")
    needed_clearance_m: float = Field(description="What either way must keep.")
    choice: Literal["mission", "offboard"]
    why: str = Field(description="The choice in a sentence.")
    basis: str = Field("", description="What of the vehicle is known for it, and what is only usual.")
