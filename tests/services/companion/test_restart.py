"""A companion that dies in mid-flight and is started again: it leads nothing by itself, and goes on when ordered."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from gcs.core.vehicle import FlightMode
from gcs.mavlink.companion_lease import LeaseState
from gcs.services.companion.core import CompanionCore
from gcs.services.companion.lease_memory import LeaseMemory
from gcs.storage.lease_file import KeptLease, LeaseFile
from sitl_mocks.flight_world import COMPANION


def dead():
    """What is there while there is no companion."""
    return SimpleNamespace(deadline=math.inf, handle=lambda message: None, on_time=lambda: None)


def begin(world, file):
    """Start a companion with what is kept in a file."""
    if file.exists():
        LeaseFile(file).flush()
    world.store = LeaseFile(file)
    world.core = CompanionCore(
        system_id=1,
        send=world._sender(COMPANION),
        clock=world.clock,
        plans=world.plans,
        outbox=world.outbox,
        memory=LeaseMemory(world.store),
    )


def die(world):
    """What was to be written is on the disk by then: real time stands still here."""
    world.store.flush()
    world.core = dead()


def hold(world):
    """Have the vehicle hold as a station does, whatever its failsafe chose."""
    world.station.guard.take_back()
    world.do(world.station.stack.pause(world.station.commands(lambda: None)))
    world.run(2.0)


@pytest.fixture
def flying(make_world, autopilot, tmp_path):
    """A companion that leads, behind the first picture; its file, and the world."""
    world = make_world(autopilot)
    begin(world, tmp_path / "lease.json")
    world.take_off()
    world.order()
    assert world.run(60.0, lambda: world.core._vehicle.pictures == 1)
    at_s = world.core.status.plan_time_s
    assert world.run(20.0, lambda: world.core.status.plan_time_s > at_s + 2.0)
    return world


def test_a_restarted_companion_says_what_it_had_and_goes_on_when_ordered(flying, tmp_path):
    world = flying
    before = world.core.status
    die(world)
    world.run(8.0)
    begin(world, tmp_path / "lease.json")
    began_s = world.now_s
    world.run(4.0)
    assert world.setpoints_since(began_s) == 0, "it does not fly by itself"
    told = world.states[-1]
    assert (told.lease, told.state, told.plan_hash) == (before.lease, LeaseState.ENDED, before.plan_hash)
    assert "1 viewpoints were done" in told.text
    assert before.plan_time_s - 1.1 <= told.plan_time_s <= before.plan_time_s + 0.1
    hold(world)
    assert world.order(lease=1).state is LeaseState.ENDED, "an old order is no new one"
    assert world.order(lease=2).state is LeaseState.LEADING
    assert world.core.status.plan_time_s >= before.plan_time_s - 1.1
    world.fly_until(LeaseState.FINISHED)
    truth = world.world.truth()
    assert truth["captures"] == 2, "no picture twice"
    shots = np.array([shot["position_m"] for shot in truth["shots"]])
    viewpoints = next(iter(world.plans.plans.values())).plan.viewpoints
    assert np.abs(shots - [v.position_m for v in viewpoints]).max() < 0.3


def test_what_is_flown_after_a_landing_begins_anew(flying, tmp_path):
    world = flying
    die(world)
    world.run(5.0)
    hold(world)
    begin(world, tmp_path / "lease.json")
    world.run(2.0)
    world.do(world.station.commands(lambda: None).switch_mode(land_mode(world)))
    assert world.run(60.0, lambda: not world.world.truth()["armed"])
    world.run(3.0)
    assert world.core.status.plan_time_s == 0.0
    world.store.flush()
    kept = LeaseFile(tmp_path / "lease.json").load()
    assert (kept.plan_s, kept.done) == (None, ())


def land_mode(world):
    return world.station.stack.custom_mode(FlightMode.LAND)


def test_a_finished_plan_leaves_nothing_to_go_on_with(make_world, tmp_path):
    world = make_world()
    begin(world, tmp_path / "lease.json")
    world.take_off()
    world.order()
    world.fly_until(LeaseState.FINISHED)
    die(world)
    begin(world, tmp_path / "lease.json")
    assert world.core.status.state is LeaseState.FINISHED
    assert world.core.status.plan_time_s == 0.0


KEPT = KeptLease(7, 2, "ab" * 32, 12.5, (1, 4))


class Store:
    def __init__(self):
        self.kept = []

    def load(self):
        return None

    def keep(self, lease):
        self.kept.append(lease)


def test_progress_is_written_each_second_and_what_is_done_at_once():
    store = Store()
    memory = LeaseMemory(store)
    lease = replace(KEPT, done=())
    for plan_s in np.arange(0.0, 3.01, 0.1):
        memory.remember(replace(lease, plan_s=float(plan_s)))
    assert len(store.kept) == 4
    memory.remember(replace(lease, plan_s=3.02, done=(1,)))
    memory.remember(replace(lease, plan_s=3.02, done=(1,), state=5))
    assert [(kept.done, kept.state) for kept in store.kept[4:]] == [((1,), 2), ((1,), 5)]
