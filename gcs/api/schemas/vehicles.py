"""Links and vehicles: every value with its age; unknown is null, never zero."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from gcs.api.schemas.base import GeoPosition, Point3, Reading, Sent, Taken


class LinkRequest(Taken):
    """Open a link."""

    url: str = Field(
        min_length=1, max_length=200, description="udpin:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT, serial:DEVICE:BAUD"
    )


class LinkInfo(Sent):
    """A link that the operator opened."""

    id: str
    url: str
    created_at: str
    state: Literal["open", "down", "failed", "closed"] = Field(
        description="down: opened, but the other side is away and it is tried again; failed: it could not be opened."
    )
    problem: str | None
    messages_per_s: float | None
    peers: list[str]


class Battery(Sent):
    """The battery as the vehicle reports it."""

    remaining: float | None = Field(description="Share left, 0 to 1.")
    voltage_v: float | None
    current_a: float | None


class MissionPosition(Sent):
    """Where the vehicle is in its mission."""

    current: int
    total: int | None
    state: str


class Attitude(Sent):
    """Attitude of the body, aerospace convention (north, east, down)."""

    roll_deg: float
    pitch_deg: float
    heading_deg: float = Field(description="From north, clockwise, 0 to 360.")


class VehicleInfo(Sent):
    """A vehicle as it was last heard."""

    name: str = Field(description="The name a confirmation must give, such as `px4-1`.")
    system_id: int
    autopilot: str
    vehicle_type: int
    connected: bool
    last_heard_age_s: float | None
    link_quality: float | None = Field(description="Share of the vehicle's messages that arrived, 0 to 1.")
    messages_per_s: float
    round_trip_s: float | None = Field(
        description="Median time from a TIMESYNC question to its answer, over the last 10 s; null when unanswered."
    )
    flight_id: str | None = Field(description="The flight it is on, when one is open.")
    armed: Reading[bool] | None
    mode: Reading[str] | None = Field(description="In words common to both stacks.")
    mode_name: Reading[str] | None = Field(description="The stack's own name of the mode.")
    landed: Reading[str] | None
    position: Reading[GeoPosition] | None
    local_position_m: Reading[Point3] | None = Field(
        description="ENU about the estimator's own origin, not the scene's."
    )
    velocity_m_s: Reading[Point3] | None = Field(description="ENU.")
    yaw_deg: Reading[float] | None = Field(description="From east, counter-clockwise.")
    attitude: Reading[Attitude] | None
    gimbal_pitch_deg: Reading[float] | None
    battery: Reading[Battery] | None
    home: Reading[GeoPosition] | None
    mission: Reading[MissionPosition] | None
    gps_fix: Reading[int] | None
    satellites: Reading[int] | None
    ready_to_arm: Reading[bool] | None


class VehicleMessage(Sent):
    """A message of a vehicle for people."""

    number: int = Field(description="Running number in this run of the station, so that none is shown twice.")
    vehicle: str
    at: str
    severity: int = Field(description="0 emergency to 7 debug.")
    text: str
