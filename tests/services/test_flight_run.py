"""Following a flight: what a vehicle tells becomes records and a state, and nothing is commanded."""

from __future__ import annotations

import asyncio
import time
from types import SimpleNamespace

import numpy as np
import pytest

from gcs.core.errors import LinkError
from gcs.core.frames import GeoPoint, geodetic_from_enu
from gcs.core.trajectory import PiecewisePolynomial
from gcs.core.vehicle import (
    Autopilot,
    FlightMode,
    Heard,
    ImageReport,
    LandedState,
    Telemetry,
    VehicleIdentity,
)
from gcs.mavlink import events
from gcs.services.flight_recorder import FlightRecorder
from gcs.services.flight_run import FlightRun
from gcs.services.live_feed import LiveFeed
from gcs.storage.database import Database
from gcs.storage.image_store import ImageStore
from gcs.storage.records import FlightPath, FlightRecord, FlightState, PlanRecord, PlanState

ANCHOR = GeoPoint(31.3622, 121.6155, 4.0)
HASH = "ab" * 32
FLIGHT = "flight-1"


def place(x, y, z):
    latitude, longitude, altitude = geodetic_from_enu(np.array([x, y, z]), ANCHOR)
    return GeoPoint(float(latitude), float(longitude), float(altitude))


class Told:
    """A vehicle that only tells; anything else that is asked of it is an AttributeError."""

    def __init__(self):
        self.identity = VehicleIdentity(1, 1, Autopilot.PX4, 2)
        self.telemetry = Telemetry()
        self.stream = events.EventStream()

    def events(self):
        return self.stream.read()

    async def list_files(self, folder):
        raise LinkError("no answer")

    async def tell(self, event):
        self.stream.publish(event)
        await asyncio.sleep(0.01)

    async def show(self, mode=FlightMode.MISSION, armed=True, at=None, landed=LandedState.IN_AIR):
        now = time.monotonic()
        self.telemetry = Telemetry(
            armed=Heard(armed, now),
            mode=Heard(mode, now),
            mode_name=Heard(mode.name, now),
            landed=Heard(landed, now),
            position=None if at is None else Heard(place(*at), now),
        )
        await self.tell(events.TelemetryEvent(self.telemetry))


@pytest.fixture
def recorder(tmp_path):
    database = Database(tmp_path)
    at = "2026-11-22T10:00:00Z"
    database.plans.add(PlanRecord("plan-1", "two", at, {}, PlanState.READY, plan_hash=HASH))
    database.flights.add(
        FlightRecord(FLIGHT, "plan-1", HASH, "px4-1", 1, FlightPath.MISSION, FlightState.FLYING, at, at, 2)
    )
    yield FlightRecorder(FLIGHT, database, ImageStore(tmp_path), LiveFeed())
    database.close()


@pytest.fixture
async def followed(recorder):
    """A straight flight east at 10 m with viewpoints at 10 m and 50 m, in the air."""
    line = np.zeros((1, 8, 3))
    line[0, 0], line[0, 1, 0] = (0.0, 0.0, 10.0), 60.0
    viewpoints = tuple(
        SimpleNamespace(id=k, name=f"P{k}", position_m=np.array([x, 0.0, 10.0]), yaw_rad=0.0, gimbal_pitch_rad=0.0)
        for k, x in enumerate((10.0, 50.0))
    )
    plan = SimpleNamespace(
        trajectory=PiecewisePolynomial(line, np.array([20.0])),
        viewpoints=viewpoints,
        scenario=SimpleNamespace(anchor=SimpleNamespace(point=ANCHOR)),
    )
    vehicle = Told()
    run = FlightRun(plan, vehicle, recorder)
    run.start()
    await asyncio.sleep(0.01)
    await vehicle.show()
    yield run, vehicle
    await run.close()


def state(recorder):
    return recorder.flight.state


async def test_positions_become_visits_and_a_track(followed, recorder):
    _run, vehicle = followed
    await vehicle.show(at=(9.8, 0.3, 10.0))
    await vehicle.show(at=(10.0, 0.1, 10.0))
    await vehicle.show(at=(30.0, 2.0, 10.0))
    assert {v.viewpoint_id for v in recorder.database.flights.visits(FLIGHT)} == {0}
    assert recorder.database.flights.visits(FLIGHT)[0].miss_m == pytest.approx(0.1, abs=0.02)


async def test_a_vehicle_that_is_not_heard_is_unknown_and_then_what_it_shows(followed, recorder):
    _run, vehicle = followed
    await vehicle.tell(events.LinkLostEvent(3.0))
    assert state(recorder) is FlightState.UNKNOWN
    await vehicle.show(FlightMode.RETURN)
    await vehicle.tell(events.LinkBackEvent(9.0))
    assert state(recorder) is FlightState.RETURNING


async def test_progress_of_a_long_command_is_in_the_log(followed, recorder):
    _run, vehicle = followed
    await vehicle.tell(events.CommandProgressEvent("PREFLIGHT_CALIBRATION", None))
    await vehicle.tell(events.CommandProgressEvent("PREFLIGHT_CALIBRATION", 0.4))
    lines = [event.text for event in recorder.database.flights.events(FLIGHT) if event.kind == "command"]
    assert lines == ["the vehicle is at work on PREFLIGHT_CALIBRATION" + done for done in ("", ", 40% done")]


@pytest.mark.parametrize(
    ("mode", "shown"),
    [(FlightMode.MANUAL, FlightState.HELD), (FlightMode.HOLD, FlightState.HELD)],
)
async def test_who_takes_over_is_said_and_the_flight_is_held(mode, shown, followed, recorder):
    run, vehicle = followed
    await vehicle.show(mode)
    await vehicle.tell(events.ModeEvent(mode, mode.name, commanded=False))
    await vehicle.tell(events.PilotTookOverEvent("the pilot did"))
    assert state(recorder) is shown
    assert run.cut_short == "the pilot did"
    assert recorder.flight.problems == (), "a flight that is resumed and flown to its end has none"
    texts = [e.text for e in recorder.database.flights.events(FLIGHT)]
    assert "the station keeps its hands off: the pilot did" in texts


async def test_a_return_by_the_vehicles_own_failsafe_is_a_return(followed, recorder):
    run, vehicle = followed
    await vehicle.show(FlightMode.RETURN)
    await vehicle.tell(events.ModeEvent(FlightMode.RETURN, "AUTO.RTL", commanded=False))
    await vehicle.tell(events.PilotTookOverEvent("the vehicle's failsafe"))
    assert state(recorder) is FlightState.RETURNING
    await vehicle.show(FlightMode.RETURN, armed=False, landed=LandedState.ON_GROUND)
    await vehicle.tell(events.ArmedEvent(False))
    await asyncio.wait_for(run.over.wait(), 60.0)
    assert state(recorder) is FlightState.ABORTED
    problems = recorder.flight.problems
    assert any("viewpoints were not reached" in p for p in problems)
    assert any("went into return" in p for p in problems)


async def test_a_picture_taken_at_a_viewpoint_shows_that_it_was_reached(followed, recorder, monkeypatch):
    """Nobody listened when the vehicle was there: the station was being started again."""
    run, vehicle = followed

    async def fetch_file(path, resume=None, keep=None):
        return SimpleNamespace(data=path.encode(), crc32=None, confirmed=False)

    vehicle.fetch_file = fetch_file
    for k, x in enumerate((10.0, 50.0)):
        await vehicle.tell(events.ImageEvent(ImageReport(k, f"mftp:/DCIM/{k}.JPG", place(x, 0.2, 10.0), 5.0 + k)))
    await vehicle.show(armed=False, landed=LandedState.ON_GROUND)
    await vehicle.tell(events.ArmedEvent(False))
    await asyncio.wait_for(run.over.wait(), 60.0)
    assert state(recorder) is FlightState.COMPLETED
    assert [v.miss_m for v in recorder.database.flights.visits(FLIGHT)] == pytest.approx([0.2, 0.2], abs=0.02)
