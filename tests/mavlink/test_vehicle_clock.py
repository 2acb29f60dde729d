import random

import pytest

from gcs.mavlink.vehicle_clock import VehicleClock


def run(
    clock, *, rate, start_v, seconds, rng, start_w=1000.0, every=0.02, delay=0.01, jitter=0.0, outliers=0.0, loss=0.0
):
    """Stamps of a vehicle whose true clock is start_v + rate * (w - start_w), heard late."""
    heard = []
    for i in range(int(seconds / every)):
        sent_w = start_w + i * every
        if rng.random() < loss:
            continue
        late = delay + rng.random() * jitter + (0.4 if rng.random() < outliers else 0.0)
        # time_boot_ms is cut to whole milliseconds
        heard.append((sent_w + late, int((start_v + rate * (sent_w - start_w)) * 1000) / 1000))
    for w, v in sorted(heard):
        clock.stamp(w, v)
    return start_w + seconds


@pytest.mark.parametrize("rate", [1.0, 0.5, 4.0, 20.0, 50.0])
def test_rate_and_offset_with_jitter_loss_and_outliers(rate):
    clock = VehicleClock()
    end = run(clock, rate=rate, start_v=30.0, seconds=9.0, rng=random.Random(4), jitter=0.02, outliers=0.03, loss=0.1)
    clock.round_trip(0.021)
    clock.round_trip(0.4)
    run(clock, rate=rate, start_v=30.0 + rate * 9.0, seconds=0.2, rng=random.Random(5), start_w=end)
    now = end + 0.25
    truth = 30.0 + rate * (now - 1000.0)
    assert clock.rate == pytest.approx(rate, rel=0.01)
    assert clock.at(now) == pytest.approx(truth, abs=0.02 * max(rate, 1.0))


def test_round_trips_take_the_delay_out():
    late, corrected = VehicleClock(), VehicleClock()
    corrected.round_trip(0.2)
    for clock in (late, corrected):
        run(clock, rate=1.0, start_v=0.0, seconds=5.0, rng=random.Random(1), delay=0.1)
    assert late.at(1005.0) == pytest.approx(4.9, abs=0.005)
    assert corrected.at(1005.0) == pytest.approx(5.0, abs=0.005)


def test_unknown_until_there_is_enough():
    clock = VehicleClock()
    assert clock.at(1.0) is None
    clock.stamp(1.0, 10.0)
    clock.stamp(1.1, 10.1)
    assert not clock.known
    assert clock.rate == 1.0


def test_a_reboot_is_noticed_and_the_new_clock_learnt():
    clock = VehicleClock()
    end = run(clock, rate=1.0, start_v=500.0, seconds=5.0, rng=random.Random(1))
    run(clock, rate=1.0, start_v=0.5, seconds=3.0, rng=random.Random(2), start_w=end + 2.0)
    assert clock.reboots == 1
    assert clock.at(end + 5.0) == pytest.approx(3.5, abs=0.03)


def test_a_changed_speed_is_learnt():
    clock = VehicleClock()
    end = run(clock, rate=1.0, start_v=0.0, seconds=8.0, rng=random.Random(1))
    run(clock, rate=10.0, start_v=8.0, seconds=5.0, rng=random.Random(1), start_w=end)
    assert clock.rate == pytest.approx(10.0, rel=0.01)
    assert clock.at(end + 5.0) == pytest.approx(58.0, abs=0.3)
    assert clock.reboots == 0


def test_a_frozen_clock_gives_no_nonsense():
    clock = VehicleClock()
    for i in range(200):
        clock.stamp(i * 0.05, 7.0)
    assert clock.rate > 0
