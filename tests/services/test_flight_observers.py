"""Observers after a restart of the station: waited for, taken up again, or refused with the reason."""

from __future__ import annotations

import asyncio
from types import SimpleNamespace

import pytest

from gcs.core.errors import LinkError, NotFoundError, RefusedError
from gcs.services import flight_observers
from gcs.services.flight_observers import FlightObservers


class Vehicle:
    connected = True

    def __init__(self, system):
        self.identity = SimpleNamespace(name=f"px4-{system}", system_id=system)
        self.lag_s = 0.1

    async def read_position_lag(self):
        if isinstance(self.lag_s, Exception):
            raise self.lag_s
        return self.lag_s

    def shares_link_with(self, other):
        return False


class Vehicles:
    """The station's vehicles; those that were not heard yet are not there."""

    def __init__(self, *heard):
        self.heard = {v.identity.name: v for v in heard}
        self.sources = []

    def vehicle(self, name):
        if name not in self.heard:
            raise NotFoundError("no such vehicle", field=name)
        return self.heard[name]

    def set_position_source(self, system_id, sighted):
        self.sources.append(system_id)


class Recorder:
    def __init__(self):
        self.lines, self.changes = [], {}

    def log(self, kind, text, *, severity):
        self.lines.append(text)

    def problem(self, text):
        self.lines.append(f"problem: {text}")

    def notice(self, text):
        self.lines.append(text)

    def change(self, **changes):
        self.changes |= changes


@pytest.fixture
def run(monkeypatch):
    monkeypatch.setattr(flight_observers, "TRY_AGAIN_S", 0.01)
    begun = []
    return SimpleNamespace(
        vehicle=Vehicle(1), recorder=Recorder(), down=asyncio.Event(), position_by=begun.append, begun=begun
    )


async def test_an_observer_is_waited_for_and_then_looks_again(run):
    vehicles = Vehicles(run.vehicle)
    taking_up = asyncio.create_task(FlightObservers(vehicles).take_up(run, "px4-2"))
    await asyncio.sleep(0.1)
    assert run.recorder.lines == ["px4-1 is told no position until px4-2 is heard again"]
    assert run.begun == []
    vehicles.heard["px4-2"] = Vehicle(2)
    run.vehicle.lag_s = LinkError("no answer")  # nor does the vehicle answer at first
    await asyncio.sleep(0.05)
    run.vehicle.lag_s = 0.2
    await asyncio.wait_for(taking_up, 60)
    assert [sighted.lag_s for sighted in run.begun] == [0.2]
    assert vehicles.sources == [1]
    assert run.recorder.changes == {"observer": "px4-2"}
    assert run.recorder.lines[-1] == "positions are told again since px4-2 is heard"


async def test_what_would_not_work_is_a_problem_of_the_flight(run):
    run.vehicle.lag_s = RefusedError("set EKF2_EV_CTRL")
    await asyncio.wait_for(FlightObservers(Vehicles(run.vehicle, Vehicle(2))).take_up(run, "px4-2"), 60)
    assert run.begun == []
    assert run.recorder.lines[1:] == [
        "problem: after the restart of the station px4-1 is told no positions: set EKF2_EV_CTRL"
    ]


async def test_nobody_is_waited_for_after_the_landing(run):
    taking_up = asyncio.create_task(FlightObservers(Vehicles(run.vehicle)).take_up(run, "px4-2"))
    await asyncio.sleep(0.05)
    run.down.set()
    await asyncio.wait_for(taking_up, 60)
    assert run.begun == []
