"""However a lease ends, each viewpoint is photographed or reported, and nothing is reported twice."""

from __future__ import annotations

from collections import Counter
from types import SimpleNamespace

import numpy as np
import pytest

from gcs.core.replanning import ReplanReason, ViewpointFate
from gcs.mavlink.companion_lease import OVER, LeaseState, OrderKind
from gcs.mavlink.replan_messages import MOST_VIEWPOINTS
from gcs.planning.local.local_replan import LocalReplan
from gcs.services.companion.core import CompanionCore
from gcs.services.companion.departure_report import departure_reports
from gcs.services.companion.lease_memory import LeaseMemory
from gcs.storage.lease_file import KeptLease

TRUCK = {"kind": "vehicle", "radius_m": 1.0, "height_m": 20.0, "path_m": [[6.0, 0.3]]}


def told(world):
    """How often each viewpoint was reported as skipped."""
    changes = [change for report in world.outbox.reports for change in report.viewpoints]
    assert all(change.fate is ViewpointFate.SKIPPED for change in changes)
    return Counter(change.viewpoint for change in changes)


def move_sticks(world):
    world.vehicle.streams.sticks_us[2] = 1800


ENDS = {
    "order": (lambda world: world.order(OrderKind.END), LeaseState.ENDED),
    "pilot's mode": (lambda world: world.vehicle.set_mode_by_name("POSCTL"), LeaseState.TAKEN_OVER),
    "pilot's landing": (lambda world: world.vehicle.set_mode_by_name("AUTO.LAND"), LeaseState.TAKEN_OVER),
    "pilot's hold": (lambda world: world.vehicle.set_mode_by_name("AUTO.LOITER"), LeaseState.TAKEN_OVER),
    "sticks": (move_sticks, LeaseState.TAKEN_OVER),
    "no lidar": (lambda world: setattr(world.vehicle.lidar, "state", "silent"), LeaseState.ENDED),
}


@pytest.mark.parametrize("way", ENDS)
def test_a_lease_that_ends_early_tells_what_is_left(make_world, way):
    pictures = len(way) % 2  # so that some end before the first picture, some behind it
    world = make_world()
    world.take_off()
    world.order()
    assert world.run(60.0, lambda: world.core._vehicle.pictures == pictures and world.core.status.plan_time_s > 9.0)
    world.run(1.0)
    end, state = ENDS[way]
    end(world)
    assert world.fly_until(*OVER, timeout_s=20.0).state is state
    world.run(2.0)
    assert told(world) == Counter(range(pictures, 2)), "what has no picture, each once"
    waited = [ReplanReason.HELD] if way == "no lidar" else []
    assert [report.reason for report in world.outbox.reports] == [*waited, ReplanReason.LEASE_ENDED]
    assert all(report.rejoined_at_s is None for report in world.outbox.reports)


def test_a_detour_that_is_cut_short_is_told_with_what_is_left(make_world):
    world = make_world(obstacles=[TRUCK])
    world.take_off()
    world.order()
    assert world.run(60.0, lambda: world.core.status.away)
    assert world.core.status.away == ReplanReason.STANDING_OBSTACLE
    world.run(1.5)
    world.vehicle.set_mode_by_name("POSCTL")
    world.fly_until(LeaseState.TAKEN_OVER, timeout_s=2.0)
    detour, rest = world.outbox.reports
    assert detour.reason is ReplanReason.STANDING_OBSTACLE and detour.rejoined_at_s is None
    assert len(detour.path) >= 2 and not detour.viewpoints
    assert rest.reason is ReplanReason.LEASE_ENDED and told(world) == Counter([0, 1])


def test_a_lease_that_goes_on_tells_only_what_is_its_own(make_world):
    world = make_world()
    world.take_off()
    world.order()
    assert world.run(60.0, lambda: world.core._vehicle.pictures == 1)
    world.run(1.0)
    world.order(OrderKind.END)
    world.run(2.0)
    world.order(lease=2)
    world.fly_until(LeaseState.FINISHED)
    assert told(world) == Counter([1]), "the first lease left it; the second took its picture"


def test_viewpoints_whose_pictures_nobody_announced_are_told_in_the_end(make_world):
    world = make_world()
    world.take_off()
    world.order()
    world.drop = lambda message: message.get_type().startswith("CAMERA_")
    world.fly_until(LeaseState.FINISHED)
    (report,) = world.outbox.reports
    assert report.reason is ReplanReason.NO_PICTURE
    assert told(world) == Counter([0, 1])


def test_nothing_is_told_of_a_flight_as_planned(make_world, autopilot):
    world = make_world(autopilot)
    world.take_off()
    world.order()
    world.fly_until(LeaseState.FINISHED)
    assert world.outbox.reports == []


def test_what_a_restart_cut_short_is_told_once(make_world):
    world = make_world()
    (plan_hash,) = world.plans.plans
    kept = KeptLease(1, LeaseState.LEADING, plan_hash, 9.0, (0,))
    world.core = CompanionCore(
        system_id=1,
        send=world._sender("companion"),
        clock=world.clock,
        plans=world.plans,
        outbox=world.outbox,
        memory=LeaseMemory(SimpleNamespace(load=lambda: kept, keep=lambda lease: None)),
    )
    world.run(10.0)
    assert [report.reason for report in world.outbox.reports] == [ReplanReason.LEASE_ENDED]
    assert told(world) == Counter([1])


def test_more_viewpoints_than_a_report_holds_make_several(make_flyable):
    skipped = tuple(range(2 * MOST_VIEWPOINTS + 7))
    path = np.array([[0.0, 0.0, 6.0], [1.0, 0.0, 6.0]])
    replan = LocalReplan(ReplanReason.LEASE_ENDED, 3.0, None, path, None, skipped, 9.0)
    reports = departure_reports(replan, make_flyable().plan, "5a" * 32, 7)
    assert [len(report.viewpoints) for report in reports] == [MOST_VIEWPOINTS, MOST_VIEWPOINTS, 7]
    assert tuple(change.viewpoint for report in reports for change in report.viewpoints) == skipped
    assert [len(report.path) for report in reports] == [2, 0, 0]
