"""Links and vehicles."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Query

from gcs.api.dependencies import LinkId, Services, VehicleId
from gcs.api.schemas.vehicles import LinkInfo, LinkRequest, SigningRequest, SigningResult, VehicleInfo, VehicleMessage
from gcs.api.views import link_info, vehicle_info, vehicle_message

router = APIRouter()


@router.get("/links", tags=["links"], operation_id="listLinks")
def list_links(services: Services) -> list[LinkInfo]:
    """Links that the operator opened."""
    return [link_info(link) for link in services.vehicles.links()]


@router.post("/links", status_code=201, tags=["links"], operation_id="openLink")
async def open_link(services: Services, request: LinkRequest) -> LinkInfo:
    """Open a link and listen; vehicles show up as they are heard."""
    return link_info(await services.vehicles.open_link(request.url))


@router.delete("/links/{link_id}", status_code=204, tags=["links"], operation_id="closeLink")
async def close_link(services: Services, link_id: LinkId) -> None:
    """Close a link and forget it."""
    await services.vehicles.close_link(link_id)


@router.post("/links/{link_id}/signing", tags=["links"], operation_id="setUpSigning")
async def set_up_signing(services: Services, link_id: LinkId, request: SigningRequest) -> SigningResult:
    """Give a disarmed vehicle a new signing key over a link, in place of its old one, and prove that it took it."""
    proof = await services.vehicles.set_up_signing(link_id, request.vehicle, rejects_unsigned=request.rejects_unsigned)
    return SigningResult(proved=proof.proved, words=proof.words)


@router.delete("/links/{link_id}/signing", status_code=204, tags=["links"], operation_id="removeSigning")
async def remove_signing(
    services: Services, link_id: LinkId, vehicle: Annotated[str, Query(min_length=1, max_length=80)]
) -> None:
    """Have a disarmed vehicle forget its signing key; the link is unsigned from then on."""
    await services.vehicles.remove_signing(link_id, vehicle)


@router.get("/vehicles", tags=["vehicles"], operation_id="listVehicles")
async def list_vehicles(services: Services) -> list[VehicleInfo]:
    """Every vehicle heard since the start of the station, by system id."""
    return [vehicle_info(v) for v in services.vehicles.vehicles()]


@router.get("/vehicles/{name}", tags=["vehicles"], operation_id="getVehicle")
async def get_vehicle(services: Services, name: VehicleId) -> VehicleInfo:
    """One vehicle as it was last heard."""
    return vehicle_info(services.vehicles.vehicle_view(name))


@router.get("/vehicles/{name}/messages", tags=["vehicles"], operation_id="listVehicleMessages")
async def list_vehicle_messages(
    services: Services, name: VehicleId, after: Annotated[int, Query(ge=0)] = 0
) -> list[VehicleMessage]:
    """The vehicle's latest messages for people, oldest first."""
    return [vehicle_message(m) for m in services.vehicles.messages(name) if m.number > after]
