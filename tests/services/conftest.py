"""Whole stations that fly nothing themselves, with a flight on record."""

from __future__ import annotations

import pytest

from gcs.storage.plan_files import plan_hash, read_plan
from gcs.storage.records import FlightPath, FlightRecord, FlightState

AT = "2026-11-22T10:00:00Z"


class NoFlights:
    def __init__(self, services):
        pass

    async def open(self):
        pass

    close = open


@pytest.fixture
def make_no_flights():
    """In place of a station's flights."""
    return NoFlights


@pytest.fixture
def flight_on_record(box_plan):
    """Puts a flight of the box on a station's record, which has begun."""

    def put(services):
        flight = FlightRecord(
            id="flight-1",
            plan_id=services.plans.adopt(box_plan).plan.id,
            plan_hash=plan_hash(box_plan),
            vehicle="px4-1",
            system_id=1,
            mode=FlightPath.COMPANION,
            state=FlightState.FLYING,
            created_at=AT,
            updated_at=AT,
            viewpoints=len(read_plan(box_plan).viewpoints),
            started_at=AT,
        )
        services.database.flights.add(flight)

    return put
