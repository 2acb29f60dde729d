"""Plans offered for what flights skipped."""

from __future__ import annotations

from fastapi import APIRouter

from gcs.api.dependencies import FlightId, OfferId, Services
from gcs.api.replan_views import offer_info
from gcs.api.schemas.replans import PlanOfferInfo

router = APIRouter(tags=["offers"])


@router.get("/flights/{flight_id}/offers", operation_id="listFlightOffers")
def list_flight_offers(services: Services, flight_id: FlightId) -> list[PlanOfferInfo]:
    """The plans that were offered for what a flight skipped, oldest first."""
    return [offer_info(offer) for offer in services.offers.of_flight(flight_id)]


@router.post("/flights/{flight_id}/offers", status_code=202, operation_id="requestOffer")
async def request_offer(services: Services, flight_id: FlightId) -> PlanOfferInfo:
    """Begin to make a plan for what a flight skipped; the live stream tells when it is offered.

    One for the same viewpoints that is being made, offered or accepted is answered instead of a new one.
    """
    return offer_info(await services.offers.request(flight_id))


@router.post("/offers/{offer_id}/accept", operation_id="acceptOffer")
async def accept_offer(services: Services, offer_id: OfferId) -> PlanOfferInfo:
    """Make an offered plan one of the station's plans; one that is accepted already is answered as it is."""
    return offer_info(services.offers.accept(offer_id))


@router.post("/offers/{offer_id}/refuse", operation_id="refuseOffer")
async def refuse_offer(services: Services, offer_id: OfferId) -> PlanOfferInfo:
    """Write down that an offered plan is not wanted; one that is refused already is answered as it is."""
    return offer_info(services.offers.refuse(offer_id))
