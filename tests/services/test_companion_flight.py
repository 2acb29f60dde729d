"""A flight led by its vehicle's companion, as the station follows it: who leads, who took over, what is said."""

from __future__ import annotations

import asyncio
import time
from types import SimpleNamespace

import numpy as np
import pytest

from gcs.core.errors import LinkError, RefusedError
from gcs.core.frames import GeoPoint
from gcs.core.trajectory import PiecewisePolynomial
from gcs.core.vehicle import Autopilot, FlightMode, Heard, LandedState, Telemetry, VehicleIdentity
from gcs.mavlink import events
from gcs.mavlink.companion_lease import LeaseState, LeaseStatus, OrderKind
from gcs.services import companion_flight, live_feed
from gcs.services.flight_recorder import FlightRecorder
from gcs.services.flight_run import FlightRun
from gcs.services.led_flights import LedFlights
from gcs.storage.database import Database
from gcs.storage.image_store import ImageStore
from gcs.storage.records import FlightPath, FlightRecord, FlightState, PlanRecord, PlanState

HASH = "ab" * 32
FLIGHT = "flight-1"
AT = "2026-11-22T10:00:00Z"


class LedVehicle:
    """Hovers in the air with a companion beside it that follows orders."""

    def __init__(self):
        self.identity = VehicleIdentity(1, 1, Autopilot.PX4, 2)
        self.telemetry = Telemetry()
        self.stream = events.EventStream()
        self.in_air = True
        self.pilot_in_control = False
        self.lent = None
        self.orders = []
        self.unready = None
        self.announced = []
        self.show(FlightMode.HOLD)

    def events(self):
        return self.stream.read()

    def show(self, mode):
        now = time.monotonic()
        self.telemetry = Telemetry(
            armed=Heard(True, now),
            mode=Heard(mode, now),
            mode_name=Heard(mode.name, now),
            landed=Heard(LandedState.IN_AIR, now),
        )

    async def pause(self):
        self.orders.append("pause")

    async def ready_companion(self, plan_hash, tell):
        self.announced.append(plan_hash)
        tell("companion: gets the plan")
        if self.unready is not None:
            raise self.unready

    async def take_off(self, altitude_amsl_m):
        self.orders.append("take off")
        self.in_air = True

    def lend(self, lease):
        self.lent = lease

    async def order_companion(self, order):
        self.orders.append(order.kind)
        self.show(FlightMode.OFFBOARD)
        return LeaseStatus(order.lease, LeaseState.LEADING, plan_hash=order.plan_hash, text="leads")

    async def until(self, holds, timeout_s, what):
        end = time.monotonic() + min(timeout_s, 0.5)
        while not holds():
            if time.monotonic() > end:
                raise LinkError(what)
            await asyncio.sleep(0.01)

    async def tell(self, state, text="", **more):
        lease = more.pop("lease", None) or self.lent
        status = LeaseStatus(lease, state, plan_hash=HASH, text=text, **more)
        await self.say(events.LeaseEvent(status))

    async def say(self, event):
        self.stream.publish(event)
        await asyncio.sleep(0.02)

    async def taken_over(self, mode):
        """As the vehicle's own mode guard has it."""
        self.show(mode)
        self.pilot_in_control = True
        await self.say(events.ModeEvent(mode, mode.name, commanded=False))
        await self.say(events.PilotTookOverEvent("the pilot changed the mode"))


@pytest.fixture
def told():
    return []


@pytest.fixture
def recorder(tmp_path, told):
    database = Database(tmp_path)
    database.plans.add(PlanRecord("plan-1", "one", AT, {}, PlanState.READY, plan_hash=HASH))
    database.flights.add(
        FlightRecord(FLIGHT, "plan-1", HASH, "px4-1", 1, FlightPath.COMPANION, FlightState.CREATED, AT, AT, 1)
    )
    feed = live_feed.LiveFeed()
    feed.listen(told.append)
    recorder = FlightRecorder(FLIGHT, database, ImageStore(tmp_path), feed)
    yield recorder
    database.close()


@pytest.fixture
async def run(recorder):
    recorder._feed.open(lambda event: "")
    line = np.zeros((1, 8, 3))
    line[0, 0], line[0, 1, 0] = (0.0, 0.0, 10.0), 60.0
    viewpoint = SimpleNamespace(id=0, name="P0", position_m=np.array([10.0, 0.0, 10.0]))
    plan = SimpleNamespace(
        trajectory=PiecewisePolynomial(line, np.array([20.0])),
        viewpoints=(viewpoint,),
        scenario=SimpleNamespace(anchor=SimpleNamespace(point=GeoPoint(31.0, 121.0, 4.0))),
    )
    run = FlightRun(plan, LedVehicle(), recorder)
    run.start(airborne=True)
    await asyncio.sleep(0.01)
    yield run
    await run.close()


@pytest.fixture
def led(recorder):
    tasks = []

    def spawn(work):
        tasks.append(asyncio.get_running_loop().create_task(work))
        return tasks[-1]

    async def not_begun(run, error):
        flights.not_begun.append(error)

    flights = LedFlights(recorder.database, spawn, not_begun)
    flights.tasks, flights.not_begun = tasks, []
    yield flights
    for task in tasks:
        task.cancel()


async def leading(led, run):
    led.lend(run, HASH)
    await asyncio.sleep(0.05)
    assert run.recorder.flight.state is FlightState.FLYING
    return run.vehicle


def texts(run, kind):
    return [e.text for e in run.recorder.database.flights.events(FLIGHT) if e.kind == kind]


async def test_every_state_of_the_lease_is_told_and_only_changes_are_logged(led, run, told):
    vehicle = await leading(led, run)
    for k in range(4):
        await vehicle.tell(LeaseState.LEADING, "leads", plan_time_s=float(k), reports_pending=k)
    await vehicle.say(events.LeaseEvent(LeaseStatus(vehicle.lent ^ 2, LeaseState.ENDED, plan_hash=HASH)))  # another's
    seen = [event.lease.status for event in told if isinstance(event, live_feed.LeaseTold)]
    assert [s.plan_time_s for s in seen] == [0.0, 0.0, 1.0, 2.0, 3.0]
    assert (run.companion.view.flight_id, run.companion.view.status.reports_pending) == (FLIGHT, 3)
    assert texts(run, "offboard") == ["companion: leading, leads"]
    vehicle.show(FlightMode.LAND)
    await vehicle.tell(LeaseState.FINISHED, "the plan is flown", reports_pending=1)
    await asyncio.wait_for(led.tasks[0], 60)
    assert vehicle.lent is None
    assert run.cut_short is None
    assert not [e for e in texts(run, "problem") if e]


@pytest.mark.parametrize(
    ("mode", "state"), [(FlightMode.HOLD, FlightState.HELD), (FlightMode.LAND, FlightState.LANDING)]
)
@pytest.mark.parametrize("word_first", [False, True])
async def test_a_pilots_own_hold_or_landing_is_a_take_over_said_once(led, run, mode, state, word_first):
    vehicle = await leading(led, run)
    if word_first:
        await vehicle.tell(LeaseState.TAKEN_OVER, "the pilot")
    await vehicle.taken_over(mode)
    await asyncio.wait_for(led.tasks[0], 60)
    assert vehicle.lent is None
    if not word_first:
        await vehicle.tell(LeaseState.TAKEN_OVER, "the pilot", lease=run.companion._lease)
    assert run.recorder.flight.state is state
    assert run.cut_short == "the pilot changed the mode"
    assert sum("hands off" in text for text in texts(run, "problem")) == 1
    assert not run.companion.streaming
    assert run.companion.view.status.state is LeaseState.TAKEN_OVER
    assert not any("ended its lease" in text for text in texts(run, "offboard")), "that would be said twice"


@pytest.mark.parametrize("unready", [LinkError("no companion is heard"), RefusedError("the station does not answer")])
async def test_nothing_is_armed_unless_the_companion_says_that_it_could_fly_this_plan(led, run, monkeypatch, unready):
    monkeypatch.setattr(companion_flight, "column_times", lambda plan: (2.0, 18.0))
    monkeypatch.setattr(companion_flight, "column_top_amsl_m", lambda plan, leave_s: 14.0)
    vehicle = run.vehicle
    vehicle.in_air, vehicle.unready = False, unready
    led.lend(run, HASH)
    await asyncio.wait_for(led.tasks[0], 60)
    assert (vehicle.orders, vehicle.lent, led.not_begun) == ([], None, [unready])
    assert texts(run, "command") == ["companion: gets the plan"]
    vehicle.unready = None
    await leading(led, run)
    assert vehicle.orders == ["take off", OrderKind.FLY]
    assert vehicle.announced == [HASH, HASH]


async def test_after_a_take_over_the_operator_resumes_by_a_new_lease(led, run):
    vehicle = await leading(led, run)
    first = vehicle.lent
    await vehicle.taken_over(FlightMode.MANUAL)
    await asyncio.wait_for(led.tasks[0], 60)
    vehicle.pilot_in_control = False  # taken back by name
    run.cut_short = None
    await leading(led, run)
    assert vehicle.lent not in (None, first)
    assert vehicle.orders == ["pause", OrderKind.FLY, "pause", OrderKind.FLY]
    await vehicle.tell(LeaseState.TAKEN_OVER, "the pilot", lease=first)  # still in the air, of the lease before
    assert run.companion.streaming


async def test_a_hold_by_the_companion_itself_is_no_take_over(led, run):
    vehicle = await leading(led, run)
    vehicle.show(FlightMode.HOLD)
    await vehicle.tell(LeaseState.ENDED, "the lidar is silent, for 10 s")
    await asyncio.wait_for(led.tasks[0], 60)
    assert run.recorder.flight.state is FlightState.HELD
    assert texts(run, "offboard")[-1] == "the companion ended its lease: the lidar is silent, for 10 s"
    assert texts(run, "problem") == []


async def test_a_companion_that_is_not_heard_for_a_while_is_followed_on(led, run, monkeypatch):
    monkeypatch.setattr(companion_flight, "SILENT_S", 0.05)
    vehicle = await leading(led, run)
    await asyncio.sleep(0.3)
    assert sum("not heard" in text for text in texts(run, "offboard")) == 1
    vehicle.show(FlightMode.LAND)
    await vehicle.tell(LeaseState.FINISHED, "the plan is flown")
    await asyncio.wait_for(led.tasks[0], 60)


async def test_after_a_restart_the_station_follows_the_lease_that_it_hears_and_commands_nothing(led, run):
    vehicle = run.vehicle
    led.rejoin(run, HASH)
    await asyncio.sleep(0.01)
    await vehicle.tell(LeaseState.IDLE, "gets the plan", lease=77)
    assert vehicle.lent is None
    await vehicle.tell(LeaseState.LEADING, "leads", lease=77, plan_time_s=30.0)
    assert run.recorder.flight.state is FlightState.FLYING
    assert (vehicle.lent, vehicle.orders, run.companion.plan_time_s) == (77, [], 30.0)
    await vehicle.taken_over(FlightMode.HOLD)
    await asyncio.wait_for(led.tasks[0], 60)
    assert run.recorder.flight.state is FlightState.HELD
