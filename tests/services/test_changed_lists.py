"""What a vehicle holds was changed behind our back: its open flights are told, and nothing counts as proved."""

from __future__ import annotations

import asyncio
from types import SimpleNamespace

import pytest

from gcs.core.vehicle import Autopilot, VehicleIdentity
from gcs.mavlink.events import EventStream, ListChangedEvent, StationEvent
from gcs.mavlink.mission_protocol import MissionType
from gcs.services.flight_service import FlightControlService
from gcs.services.live_feed import LiveFeed
from gcs.storage.database import Database
from gcs.storage.image_store import ImageStore
from gcs.storage.records import FlightPath, FlightRecord, FlightState, PlanRecord, PlanState

AT = "2026-11-22T10:00:00Z"


@pytest.fixture
async def station(tmp_path):
    """A flight service with proved flights of two vehicles, one of which is heard; its events are the test's."""
    database = Database(tmp_path)
    database.plans.add(PlanRecord("plan-1", "two", AT, {}, PlanState.READY, plan_hash="ab" * 32))
    for k in (1, 2):
        state = (FlightPath.MISSION, FlightState.UPLOADED, AT, AT, 2)
        database.flights.add(FlightRecord(f"flight-{k}", "plan-1", "ab" * 32, f"px4-{k}", k, *state, proved=True))
    events = EventStream()
    heard = {1: SimpleNamespace(identity=VehicleIdentity(1, 1, Autopilot.PX4, 2))}
    vehicles = SimpleNamespace(station=SimpleNamespace(events=events.read, vehicles=heard))
    service = FlightControlService(
        database, ImageStore(tmp_path), SimpleNamespace(), LiveFeed(), SimpleNamespace(), vehicles
    )
    await service.open()
    await asyncio.sleep(0.01)

    async def tell(mission_type):
        events.publish(StationEvent(1, ListChangedEvent(mission_type)))
        await asyncio.sleep(0.01)

    yield SimpleNamespace(tell=tell, flights=database.flights)
    await service.close()
    database.close()


def lines(station, flight_id):
    return [event.text for event in station.flights.events(flight_id) if event.kind == "problem"]


async def test_a_changed_mission_is_said_once_and_no_longer_proved(station):
    await station.tell(MissionType.MISSION)
    await station.tell(MissionType.MISSION)
    assert [station.flights.get(f"flight-{k}").proved for k in (1, 2)] == [False, True]
    [line] = lines(station, "flight-1")
    assert "somebody else changed the vehicle's mission" in line
    assert "not known until it is read again" in line
    assert lines(station, "flight-2") == []


async def test_a_changed_fence_is_said_and_the_mission_stays_proved(station):
    await station.tell(MissionType.FENCE)
    assert station.flights.get("flight-1").proved
    assert "fence" in lines(station, "flight-1")[0]
