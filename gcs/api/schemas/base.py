"""Words used by all schemas."""

from __future__ import annotations

from typing import Generic, TypeVar

from pydantic import BaseModel, ConfigDict, Field

T = TypeVar("T")

Point3 = tuple[float, float, float]
"""East, north, up of the scene's anchor, in metres, or a direction in the same axes."""


class Sent(BaseModel):
    """Base of everything the station sends."""

    model_config = ConfigDict(frozen=True, from_attributes=True)


class Taken(BaseModel):
    """Base of everything the station takes: an unknown field is an error."""

    model_config = ConfigDict(frozen=True, extra="forbid")


class Problem(Sent):
    """An error as RFC 9457 has it (`application/problem+json`)."""

    type: str = Field(description="A name of the kind of error, such as `urn:gcs:problem:bad-input`.")
    title: str
    status: int
    detail: str = Field(description="One sentence for the person who must act on it.")
    instance: str = Field(description="The path that was called.")
    field: str | None = Field(description="The field, file, parameter or vehicle that it is about.")


class Failure(Sent):
    """Why a job or a plan failed."""

    title: str
    message: str
    field: str | None


class Reading(Sent, Generic[T]):
    """A value heard from a vehicle and how old it is."""

    value: T
    age_s: float = Field(description="Seconds between hearing it and sending this.")
    stale: bool = Field(description="Too old to be taken for the present; must look stale.")


class GeoPosition(Sent):
    """A place on WGS84."""

    latitude_deg: float
    longitude_deg: float
    altitude_m: float = Field(description="Above mean sea level (EGM96).")


class Box(Sent):
    """An axis-aligned box in the scene."""

    low_m: Point3
    high_m: Point3


class CableLine(Sent):
    """A straight stay."""

    from_m: Point3
    to_m: Point3
    radius_m: float
