"""Transfers are cancelled over REST in every step: the vehicle is told, and what is not known is said to be unknown."""

from __future__ import annotations

import asyncio
import contextlib
import time

import httpx2
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from gcs.api.app import create_app
from gcs.core.frames import GeoPoint
from gcs.core.mission import MissionItem
from gcs.core.vehicle import Autopilot, VehicleIdentity
from gcs.mavlink.framing import FrameParser
from gcs.mavlink.mission_protocol import MissionType
from gcs.mavlink.vehicle import Vehicle
from gcs.mavlink.vehicle_channel import VehicleChannel
from gcs.services import fence_rally
from gcs.services.flight_service import FlightControlService
from gcs.services.mission_fitting import USUAL_SAMPLING, FittedMission, sampled_mission
from gcs.services.station import StationServices
from gcs.storage.plan_files import plan_report, write_plan
from sitl_mocks.channel import Channel
from sitl_mocks.px4 import Px4Vehicle
from sitl_mocks.vehicle_options import VehicleOptions

HOME = GeoPoint(31.36201962, 121.61528979, 4.0)
CANCELLED = mavlink.MAV_MISSION_OPERATION_CANCELLED


class SimulatedLink:
    """A vehicle of the station and the simulated one that it talks to, without a socket; `loses` messages both ways."""

    def __init__(self):
        self.simulated = Px4Vehicle(VehicleOptions(1, HOME, HOME, None))
        self.loses = lambda message: False
        self.sent = []
        self._packer = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
        self._arrived = []
        parser = FrameParser()
        self._link = Channel(1, lambda packet: self._arrived.extend(parser.feed(packet)))
        channel = VehicleChannel((1, 1), (255, 190), self._send, time.monotonic)
        self.vehicle = Vehicle(VehicleIdentity(1, 1, Autopilot.PX4, 2), channel, lost_after_s=1e9)
        self.simulated.add_channel(self._link)

    def _send(self, message):
        self.sent.append(message)
        if not self.loses(message):
            for heard in self._link.receive(bytes(message.pack(self._packer))):
                self.simulated.handle(heard, self._link)

    async def live(self):
        while True:
            self.simulated.step(0.002, time.monotonic())
            arrived, self._arrived = self._arrived, []
            for message in arrived:
                if not self.loses(message):
                    self.vehicle.handle(message, time.monotonic())
            await asyncio.sleep(0.002)

    @property
    def cancelled(self):
        """Whether it was told that a transfer of its mission was cancelled."""
        acks = [m for m in self.sent if m.get_type() == "MISSION_ACK"]
        return any(ack.type == CANCELLED and ack.mission_type == 0 for ack in acks)


class NoChecks:
    """Every flight may be uploaded at once, unless the checks are to take for ever."""

    hang = False

    def __init__(self, flight, plan):
        self._plan = plan

    async def fitted(self, vehicle, most_items=None):
        if NoChecks.hang:
            await asyncio.Event().wait()
        return FittedMission(sampled_mission(self._plan, Autopilot.PX4, USUAL_SAMPLING), USUAL_SAMPLING, None)

    async def before_upload(self, vehicle, fitted, accepted):
        return self

    async def report(self, vehicle, accepted):
        await vehicle.download_list(MissionType.FENCE)

    async def before_start(self, vehicle, accepted):
        await vehicle.download_list(MissionType.RALLY)

    def demand(self):
        pass


@pytest.fixture
async def link():
    link = SimulatedLink()
    living = asyncio.create_task(link.live())
    yield link
    living.cancel()
    with contextlib.suppress(asyncio.CancelledError):
        await living


@pytest.fixture
async def rest(link, settings, mavlink, jobs, small_plan, small_structure, tmp_path, monkeypatch):
    """The API of a station with that vehicle and its real flight service; the path of a prepared flight."""
    monkeypatch.setattr(NoChecks, "hang", False)
    monkeypatch.setattr(FlightControlService, "_checks", lambda self, flight, plan: NoChecks(flight, plan))
    mavlink.vehicles = {1: link.vehicle}
    services = StationServices(settings.data_dir, make_mavlink=lambda: mavlink, make_jobs=lambda: jobs)
    app = create_app(settings, services)
    token = (settings.data_dir / "token").read_text().strip()
    async with (
        app.router.lifespan_context(app),
        httpx2.AsyncClient(
            transport=httpx2.ASGITransport(app, client=("127.0.0.1", 50000)),
            base_url="http://127.0.0.1:8080/api",
            headers={"Authorization": f"Bearer {token}"},
        ) as client,
    ):
        report = plan_report(small_plan, mission_items=5)
        write_plan(small_plan, small_structure, tmp_path / "plan", report=report)
        body = {"plan_id": services.plans.adopt(tmp_path / "plan").plan.id, "vehicle": "px4-1", "mode": "mission"}
        flight = (await client.post("/flights", json=body)).json()
        yield client, f"/flights/{flight['id']}"


async def until(holds):
    end = time.monotonic() + 60.0
    while not await holds():
        assert time.monotonic() < end
        await asyncio.sleep(0.01)


async def state_is(client, flight, *states):
    return (await client.get(flight)).json()["state"] in states


def mission_item(message):
    return message.get_type() == "MISSION_ITEM_INT" and message.seq >= 2


STEPS = {
    "opening": lambda message: message.get_type() == "MISSION_COUNT",
    "items": mission_item,
    "final acknowledgement": lambda message: message.get_type() == "MISSION_ACK" and message.get_srcSystem() == 1,
    "read back": lambda message: message.get_type() == "MISSION_REQUEST_LIST",
}


@pytest.mark.parametrize("step", STEPS)
async def test_an_upload_is_cancelled_in_every_step(rest, link, step):
    client, flight = rest
    reached = asyncio.Event()

    def loses(message):
        if not STEPS[step](message) or (message.get_type() == "MISSION_ACK" and message.type == CANCELLED):
            return False
        reached.set()
        return True

    link.loses = loses
    assert (await client.post(f"{flight}/upload", json={})).json()["actions"] == ["cancel-transfer"]
    await asyncio.wait_for(reached.wait(), 60.0)
    assert not link.cancelled
    ended = (await client.post(f"{flight}/cancel-transfer")).json()
    assert (ended["state"], ended["proved"], ended["actions"]) == ("upload_failed", False, ["upload"])
    assert ended["problems"] == [], "it was wanted"
    assert link.cancelled
    held = (await client.get(f"{flight}/on-vehicle")).json()
    assert (held["state"], held["equal"]) == ("failed", None)
    assert "what the vehicle holds now is unknown" in held["problem"]
    quiet = len(link.sent)
    await asyncio.sleep(0.3)
    assert not [m for m in link.sent[quiet:] if m.get_type().startswith("MISSION_")], "nothing more is sent"

    link.loses = lambda message: False
    assert (await client.post(f"{flight}/upload", json={})).status_code == 202
    await until(lambda: state_is(client, flight, "uploaded", "upload_failed"))
    assert (await client.get(flight)).json()["proved"] is True
    assert (await client.post(f"{flight}/read-back")).json()["equal"] is True


async def test_an_upload_that_still_waits_for_its_checks_has_sent_nothing(rest, link, monkeypatch):
    client, flight = rest
    monkeypatch.setattr(NoChecks, "hang", True)
    asked = asyncio.create_task(client.post(f"{flight}/upload", json={}))
    await asyncio.sleep(0.1)
    ended = await client.post(f"{flight}/cancel-transfer")
    assert (ended.status_code, ended.json()["state"]) == (200, "created")
    answer = await asyncio.wait_for(asked, 60.0)
    assert (answer.status_code, answer.json()["title"]) == (409, "Cancelled")
    assert "before anything of the mission was sent" in answer.json()["detail"]
    assert not [m for m in link.sent if m.get_type() == "MISSION_COUNT"]


@pytest.mark.parametrize(
    ("method", "route", "body", "mode"),
    [
        ("POST", "read-back", {}, "mission"),
        ("GET", "preflight", None, "mission"),
        ("POST", "start", {"confirm": "px4-1"}, "offboard"),
    ],
)
async def test_what_is_read_from_the_vehicle_is_cancelled_and_nothing_is_started(rest, link, method, route, body, mode):
    client, flight = rest
    if mode != "mission":
        known = (await client.get(flight)).json()
        new = {"plan_id": known["plan_id"], "vehicle": "px4-1", "mode": mode}
        flight = f"/flights/{(await client.post('/flights', json=new)).json()['id']}"
    link.loses = lambda message: message.get_type() == "MISSION_REQUEST_LIST"
    asked = asyncio.create_task(client.request(method, f"{flight}/{route}", json=body))
    await until(lambda: asyncio.sleep(0, any(m.get_type() == "MISSION_REQUEST_LIST" for m in link.sent)))
    ended = await client.post(f"{flight}/cancel-transfer")
    assert (ended.status_code, ended.json()["state"]) == (200, "created")
    answer = await asyncio.wait_for(asked, 60.0)
    assert (answer.status_code, answer.json()["title"]) == (409, "Cancelled")
    assert "are as they were" in answer.json()["detail"]
    assert [m.type for m in link.sent if m.get_type() == "MISSION_ACK"] == [CANCELLED]
    assert mavlink.MAV_CMD_COMPONENT_ARM_DISARM not in [getattr(m, "command", None) for m in link.sent]


@pytest.fixture
def fenced(monkeypatch):
    """The scenario has a fence."""
    corners = [(-9000, -9000), (9000, -9000), (9000, 9000), (-9000, 9000)]
    items = [
        MissionItem(k, 0, 5001, (4.0, 0.0, 0.0, 0.0), 313620196 + x, 1216152897 + y, 0.0)
        for k, (x, y) in enumerate(corners)
    ]
    monkeypatch.setattr(fence_rally, "lists_of_plan", lambda plan, autopilot: {MissionType.FENCE: items})


async def test_an_upload_is_cancelled_when_only_the_fence_is_left(rest, link, fenced):
    client, flight = rest

    def of_the_fence(message):
        return message.get_type() == "MISSION_ITEM_INT" and message.mission_type == MissionType.FENCE

    link.loses = of_the_fence
    await client.post(f"{flight}/upload", json={})
    await until(lambda: asyncio.sleep(0, any(of_the_fence(m) for m in link.sent)))
    ended = (await client.post(f"{flight}/cancel-transfer")).json()
    assert (ended["state"], ended["proved"]) == ("upload_failed", False)
    problem = (await client.get(f"{flight}/on-vehicle")).json()["problem"]
    assert problem.startswith("the upload of fence and rally points was cancelled")
    acks = [(m.type, m.mission_type) for m in link.sent if m.get_type() == "MISSION_ACK"]
    assert acks[-1] == (CANCELLED, MissionType.FENCE)
    assert (await client.post(f"{flight}/read-back")).json()["equal"] is True, "the mission itself had arrived"


async def test_there_is_nothing_to_cancel_before_and_after(rest):
    client, flight = rest
    assert (await client.post(f"{flight}/cancel-transfer")).status_code == 409
    await client.post(f"{flight}/upload", json={})
    await until(lambda: state_is(client, flight, "uploaded"))
    late = await client.post(f"{flight}/cancel-transfer")
    assert (late.status_code, late.json()["detail"]) == (409, "no transfer of this flight is under way")
    assert (await client.get(flight)).json()["proved"] is True
    assert (await client.post("/flights/flight-9/cancel-transfer")).status_code == 404


async def test_a_station_that_ends_in_mid_upload_tells_the_vehicle_and_says_what_is_unknown(rest, link):
    client, flight = rest
    link.loses = mission_item
    await client.post(f"{flight}/upload", json={})
    await until(lambda: asyncio.sleep(0, any(mission_item(m) for m in link.sent)))
    services = client._transport.app.state.services
    await services.flights.close()
    assert link.cancelled
    ended = (await client.get(flight)).json()
    assert ended["state"] == "upload_failed"
    assert "is unknown" in (await client.get(f"{flight}/on-vehicle")).json()["problem"]
