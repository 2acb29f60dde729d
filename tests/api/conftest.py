"""A station behind its doors, with a vehicle, a planner and a flight service that do as they are told."""

from __future__ import annotations

import asyncio
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from fastapi.testclient import TestClient

from gcs.api.app import create_app
from gcs.api.settings import StationSettings
from gcs.core.clock import new_id, utc_now
from gcs.core.errors import LinkError, NotFoundError, OperationCancelled
from gcs.core.frames import GeoPoint
from gcs.core.mission import MissionItem
from gcs.core.vehicle import Autopilot, BatteryState, FlightMode, Heard, LandedState, Telemetry, VehicleIdentity
from gcs.mavlink.events import EventStream
from gcs.mavlink.link_quality import LinkQuality
from gcs.mavlink.routing import WayInfo
from gcs.mavlink.station import LinkInfo
from gcs.services.flight_types import OnVehicleMission, PreflightCheck, PreflightReport
from gcs.services.station import StationServices
from gcs.storage.plan_files import plan_report, write_plan
from gcs.storage.records import FlightPath, FlightRecord, FlightState, UploadState


class FakeMavlink:
    """Vehicles that were heard; links of which `udpin:127.0.0.1:1` cannot be opened."""

    def __init__(self):
        now = time.monotonic()
        self.stream = EventStream()
        self.opened = {}
        self.vehicles = {
            1: SimpleNamespace(
                identity=VehicleIdentity(1, 1, Autopilot.PX4, 2),
                connected=True,
                id_clash=None,
                mavlink_version=2,
                last_heard_s=now,
                link_quality=LinkQuality(80.0, 0.1, 0.05),
                telemetry=Telemetry(
                    armed=Heard(False, now),
                    mode=Heard(FlightMode.HOLD, now),
                    mode_name=Heard("AUTO.LOITER", now),
                    landed=Heard(LandedState.ON_GROUND, now),
                    position=Heard(GeoPoint(31.3622, 121.6155, 4.0), now - 60),
                    velocity_m_s=Heard(np.array([1.0, 2.0, 3.0]), now),
                    yaw_rad=Heard(np.pi / 2, now),
                    battery=Heard(BatteryState(0.8, 15.2, None), now),
                ),
            )
        }

    @property
    def links(self):
        return tuple(self.opened.values())

    async def open(self, url):
        if url.endswith(":1"):
            raise LinkError("cannot be opened", field=url)
        self.opened[url] = LinkInfo(url, True, ("127.0.0.1:14550",), 12.5)
        return url

    async def close(self, url):
        del self.opened[url]

    def ways(self, vehicle):
        return (WayInfo("udpin:127.0.0.1:14550", "127.0.0.1:14550", True, None, 0.05, 0.1),)

    async def close_all(self):
        self.opened.clear()

    def vehicle(self, name):
        for vehicle in self.vehicles.values():
            if name in (vehicle.identity.name, str(vehicle.identity.system_id)):
                return vehicle
        raise NotFoundError("no such vehicle", field=name)

    def events(self):
        return self.stream.read()


class FakeJobs:
    """Plans at once, or for ever when `hold` is set, or fails with `error`."""

    def __init__(self, plan, structure):
        self.plan, self.structure = plan, structure
        self.hold = False
        self.error = None
        self.cancelled = {}

    async def run(self, job_id, function, scenario, base, out, *, tell):
        self.cancelled[job_id] = asyncio.Event()
        tell("viewpoints", 0.5)
        if self.hold:
            await self.cancelled[job_id].wait()
            raise OperationCancelled("planning was cancelled")
        if self.error is not None:
            raise self.error
        report = plan_report(self.plan, mission_items=5)
        extra = {"report.html": b"<!doctype html><style>p{}</style>"}
        return write_plan(self.plan, self.structure, Path(out), report=report, extra_files=extra), report

    async def cancel(self, job_id):
        self.cancelled[job_id].set()

    async def close(self):
        pass


class FakeFlights:
    """Does what it is asked, at once, and writes down what that was."""

    def __init__(self, services):
        self.services = services
        self.asked = []
        self.error = None
        self.leases = {}

    def lease(self, flight_id):
        return self.leases.get(flight_id)

    async def open(self):
        self.asked.append("open")

    async def close(self):
        self.asked.append("close")

    async def create(self, plan_id, vehicle, mode):
        plan = self.services.plans.read(plan_id)
        found = self.services.vehicles.vehicle(vehicle)
        now = utc_now()
        record = FlightRecord(
            id=new_id("flight"),
            plan_id=plan_id,
            plan_hash=self.services.plans.get(plan_id).plan.plan_hash,
            vehicle=found.identity.name,
            system_id=found.identity.system_id,
            mode=mode or FlightPath.MISSION,
            state=FlightState.CREATED,
            created_at=now,
            updated_at=now,
            viewpoints=len(plan.viewpoints),
        )
        self.services.database.flights.add(record)
        return record

    async def preflight(self, flight_id):
        check = PreflightCheck("NAV_DLL_ACT", "needs_acceptance", "ground-station loss does nothing", "NAV_DLL_ACT")
        return PreflightReport(flight_id, utc_now(), (check,))

    async def on_vehicle(self, flight_id):
        items = (
            MissionItem(0, 5, 22, (0.0, 0.0, 0.0, float("nan")), 313622000, 1216155000, 14.0),
            MissionItem(1, 2, 2000, (0.0, 0.0, 1.0, 0.0), 0, 0, 0.0),
        )
        return OnVehicleMission(
            flight_id, UploadState.PROVED, utc_now(), "mission protocol", True, (), 123, items, {0: 1}
        )

    read_back = on_vehicle

    def _do(self, flight_id, state, *what):
        if self.error is not None:
            raise self.error
        self.asked.append(what)
        return self.services.database.flights.update(flight_id, state=state)

    async def upload(self, flight_id, *, confirm, accept):
        return self._do(flight_id, FlightState.UPLOADING, "upload", accept)

    async def cancel_transfer(self, flight_id):
        return self._do(flight_id, FlightState.UPLOAD_FAILED, "cancel-transfer")

    async def start(self, flight_id, *, confirm, accept, observer=None):
        return self._do(flight_id, FlightState.FLYING, "start", confirm, accept)

    async def resume(self, flight_id, *, confirm, accept):
        return self._do(flight_id, FlightState.FLYING, "resume", confirm, accept)

    async def pause(self, flight_id):
        return self._do(flight_id, FlightState.PAUSED, "pause")

    async def return_home(self, flight_id):
        return self._do(flight_id, FlightState.RETURNING, "return")

    async def land(self, flight_id):
        return self._do(flight_id, FlightState.LANDING, "land")


@pytest.fixture
def settings(tmp_path):
    dashboard = tmp_path / "dashboard"
    (dashboard / "assets").mkdir(parents=True)
    (dashboard / "index.html").write_text("<!doctype html><title>gcs</title>")
    (dashboard / "assets" / "main.js").write_text("export {}")
    return StationSettings(data_dir=tmp_path / "data", port=8080, dashboard_dir=dashboard)


@pytest.fixture
def jobs(small_plan, small_structure):
    return FakeJobs(small_plan, small_structure)


@pytest.fixture
def mavlink():
    return FakeMavlink()


@pytest.fixture
def app(settings, jobs, mavlink):
    services = StationServices(
        settings.data_dir, make_flights=FakeFlights, make_mavlink=lambda: mavlink, make_jobs=lambda: jobs
    )
    return create_app(settings, services)


@pytest.fixture
def outside(app):
    """A client without a session."""
    with TestClient(app, base_url="http://127.0.0.1:8080", client=("127.0.0.1", 50000)) as client:
        yield client


@pytest.fixture
def client(outside, settings):
    """A script with the token."""
    outside.headers["Authorization"] = f"Bearer {(settings.data_dir / 'token').read_text().strip()}"
    return outside


@pytest.fixture
def scenario(scenario_data, settings):
    """A scenario whose mesh the station has."""
    folder = settings.data_dir / "structures" / "mesh-1"
    folder.mkdir(parents=True)
    (folder / "mesh.stl").write_bytes(b"solid")
    return {**scenario_data, "structure": {"meshes": [{"file": "mesh-1/mesh.stl"}]}}


@pytest.fixture
def wait_for_plan(client):
    def wait(plan_id):
        for _ in range(200):
            plan = client.get(f"/api/plans/{plan_id}").json()
            if plan["state"] != "planning":
                return plan
            time.sleep(0.02)
        raise AssertionError(plan)

    return wait


@pytest.fixture
def ready_plan(client, scenario, wait_for_plan):
    return wait_for_plan(client.post("/api/plans", json={"scenario": scenario}).json()["plan"]["id"])


@pytest.fixture
def flight(client, ready_plan):
    response = client.post("/api/flights", json={"plan_id": ready_plan["id"], "vehicle": "px4-1"})
    assert response.status_code == 201, response.text
    return response.json()
