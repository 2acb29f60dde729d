"""What routes are given: the services of the running station."""

from __future__ import annotations

from typing import Annotated, cast

from fastapi import Depends, Path
from starlette.requests import HTTPConnection

from gcs.services.station import StationServices


def station_services(connection: HTTPConnection) -> StationServices:
    """The services of the station that took the request."""
    return cast("StationServices", connection.app.state.services)


Services = Annotated[StationServices, Depends(station_services)]

StructureId = Annotated[str, Path(max_length=80)]
PlanId = Annotated[str, Path(max_length=80)]
PlanHash = Annotated[str, Path(pattern="^[0-9a-f]{64}$")]
LinkId = Annotated[str, Path(max_length=80)]
VehicleId = Annotated[str, Path(max_length=80, description="The vehicle's name, such as `px4-1`.")]
FlightId = Annotated[str, Path(max_length=80)]
ImageId = Annotated[str, Path(max_length=80)]
OfferId = Annotated[str, Path(max_length=80)]
