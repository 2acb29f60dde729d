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


class SigningRequest(Taken):
    """Give a vehicle a signing key, over a link that nobody else can hear: the key goes there unencrypted."""

    vehicle: str = Field(min_length=1, max_length=80, description="Its name; it must be disarmed.")
    rejects_unsigned: bool = Field(default=True, description="Whether unsigned packets are refused from then on.")


class SigningResult(Sent):
    """What came of giving a vehicle a key."""

    proved: bool = Field(description="Signed questions were answered, and unsigned ones were not.")
    words: str


class SigningInfo(Sent):
    """How signing of a link goes."""

    rejects_unsigned: bool
    good: int = Field(description="Packets signed with the link's key.")
    unsigned: int
    wrong_key: int
    repeated: int = Field(description="Signed, but no newer than one that was heard before.")
    past: int = Field(description="Signed by a clock in the past.")
    problem: str | None = Field(description="What went wrong in the last seconds, and what to do.")
    rotated_at: str | None = Field(
        default=None, description="When the key took the place of an older one; null while it is the first."
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
    signing: SigningInfo | None = Field(default=None, description="Null when the link is not signed.")


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


class WayInfo(Sent):
    """A link on which a vehicle is heard."""

    url: str
    peer: str
    used: bool = Field(description="Whether messages to the vehicle go this way.")
    loss: float | None = Field(description="Share of its packets lost on the way lately, when there is more than one.")
    round_trip_s: float | None
    age_s: float = Field(description="Since the last packet.")
    signing: SigningInfo | None = Field(default=None, description="Of its link; null when that is not signed.")


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
    id_clash: str | None = Field(
        default=None, description="How two vehicles with its system id were told apart; it is not commanded then."
    )
    mavlink_version: int | None = Field(
        default=None, description="Of its heartbeats: one that sends MAVLink 1 is heard, but may not understand us."
    )
    ways: list[WayInfo] = Field(default=[], description="The links on which it is heard, the one that is used first.")
    position_source: str | None = Field(
        default=None, description="What stands in for its own position fix while that is lost; null while it has one."
    )
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
