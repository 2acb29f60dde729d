"""An error of the companion's own in mid-flight: the vehicle is left in a hold, and the companion goes on."""

from __future__ import annotations

import logging

import pytest

from gcs.core.errors import InputError
from gcs.core.vehicle import FlightMode
from gcs.mavlink.companion_lease import LeaseState


@pytest.fixture
def flying(make_world, autopilot):
    world = make_world(autopilot)
    world.take_off()
    world.order()
    assert world.run(20.0, lambda: world.core.status.plan_time_s > 9.0)
    return world


def broken(error=ZeroDivisionError):
    def fail(*given):
        raise error("of its own")

    return fail


def told(world):
    return [change.viewpoint for report in world.outbox.reports for change in report.viewpoints]


@pytest.mark.parametrize("what", ["decide", "motion", "see"])
def test_the_lease_ends_in_a_hold_and_a_new_one_can_be_had(flying, what, caplog):
    world, navigator = flying, flying.core._flight._navigator
    setattr(navigator, what, broken())
    status = world.fly_until(LeaseState.ENDED, timeout_s=3.0)
    assert status.text == "an error in the companion, see its log"
    ended_s = world.now_s
    world.run(3.0)
    assert world.setpoints_since(ended_s) == 0
    assert world.station.mode is FlightMode.HOLD
    assert told(world) == [0, 1], "each once"
    assert len([record for record in caplog.records if record.levelno == logging.ERROR]) == 1
    assert sum("an error in the companion" in text for text in world.texts) == 1
    assert world.order(lease=2).state is LeaseState.LEADING
    world.fly_until(LeaseState.FINISHED)


def test_an_error_that_looks_like_a_bad_scan_is_none(flying):
    flying.core._flight._navigator.decide = broken(InputError)
    flying.fly_until(LeaseState.ENDED, timeout_s=3.0)
    assert not any("lidar" in text for text in flying.texts)


def test_where_not_even_a_hold_can_be_commanded_it_stops_at_once(flying):
    navigator = flying.core._flight._navigator
    navigator.decide = navigator.break_off = broken()
    flying.fly_until(LeaseState.ENDED, timeout_s=1.0)
    ended_s = flying.now_s
    flying.run(8.0)
    assert flying.setpoints_since(ended_s) == 0
    assert told(flying) == [0, 1]
