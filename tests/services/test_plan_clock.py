"""The plan clock: follows the vehicle's time, halts at gates, and never stops or starts at once."""

import numpy as np
import pytest

from gcs.services.plan_clock import MAX_STEP_S, PlanClock


def test_it_follows_the_vehicles_time_from_the_first_reading():
    clock = PlanClock(5.0)
    assert clock.read(100.0).time_s == 5.0
    assert clock.read(100.5).time_s == pytest.approx(5.5)
    assert clock.read(101.2).time_s == pytest.approx(6.2)


def test_it_halts_at_a_gate_until_the_gate_moves():
    clock = PlanClock()
    clock.gate_s = 1.0
    clock.read(0.0)
    for t in np.arange(0.1, 3.0, 0.1):
        reading = clock.read(float(t))
        assert reading.time_s <= 1.0
    assert clock.stopped
    assert reading.rate == 0.0
    clock.gate_s = 2.0
    assert not clock.stopped
    assert clock.read(3.4).time_s == pytest.approx(1.0 + 0.5)


def test_a_pause_slows_down_smoothly_and_goes_on_smoothly():
    clock = PlanClock(slew=0.5)
    times, rates = [], []
    dt = 0.02
    for k in range(600):
        if k == 100:
            clock.pause()
        if k == 400:
            clock.resume()
        reading = clock.read(k * dt)
        times.append(reading.time_s)
        rates.append(reading.rate)
        assert abs(reading.rate_change) <= 0.5 + 1e-9
    rates = np.array(rates)
    assert rates[50] == 1.0
    assert rates[350] == 0.0
    assert rates[-1] == 1.0
    assert np.abs(np.diff(rates)).max() <= 0.5 * dt + 1e-12
    np.testing.assert_allclose(np.diff(times), (rates[1:] + rates[:-1]) / 2 * dt, atol=1e-12)


def test_a_clock_that_jumps_or_goes_back_does_not_move_the_plan_far():
    clock = PlanClock()
    clock.read(10.0)
    assert clock.read(500.0).time_s <= MAX_STEP_S
    before = clock.time_s
    assert clock.read(3.0).time_s == before


def test_it_can_begin_at_a_standstill_and_pick_up_speed():
    clock = PlanClock(7.0, slew=0.5, paused=True)
    clock.read(0.0)
    assert clock.read(1.0).time_s == 7.0
    clock.resume()
    assert clock.read(1.5).rate == pytest.approx(0.25)
    assert clock.read(2.0).time_s == pytest.approx(7.0 + 0.5 * 0.5 * 1.0**2)


def test_read_ahead_it_tells_where_it_stands_now():
    now = 10.0
    clock = PlanClock(5.0, vehicle_now=lambda: now)
    assert clock.time_s == 5.0
    clock.gate_s = 5.15
    for t in np.arange(10.0, 10.41, 0.1):
        clock.read(float(t))
    assert clock.time_s == 5.0
    assert not clock.stopped, "the gate is ahead"
    now = 10.15
    assert clock.now.time_s == pytest.approx(5.1)
    now = 10.25
    assert clock.now.rate == 0.0
    assert clock.stopped


@pytest.mark.parametrize("change", ["gate", "pause"])
def test_what_was_read_ahead_is_taken_back_when_it_is_read_again(change):
    ahead, anew = PlanClock(slew=0.5), PlanClock(slew=0.5)
    for clock in (ahead, anew):
        clock.gate_s = 1.0
        for k in range(51):
            clock.read(k * 0.02)
    for k in range(51, 80):
        ahead.read(k * 0.02)
    for clock in (ahead, anew):
        if change == "gate":
            clock.gate_s = 9.0
        else:
            clock.pause()
        for k in range(51, 200):
            clock.read(k * 0.02)
    assert ahead.now == anew.now
