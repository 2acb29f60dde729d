"""The vehicle's clock as the companion estimates it, against the simulated vehicle's own."""

from __future__ import annotations


def clock_error_s(world):
    """The largest error in some seconds."""
    world.run(8.0)
    errors = []
    for _ in range(60):
        world.run(0.05)
        errors.append(abs(world.core._vehicle.now_s() - world.vehicle.time_s))
    return max(errors)


def test_timesync_takes_the_links_delay_out_of_the_vehicles_clock(make_world):
    without = make_world(loss=0.05)
    without.drop = lambda message: message.get_type() == "TIMESYNC"
    assert clock_error_s(without) >= 0.009, "the stamps are late by the link's 10 ms at least"
    assert clock_error_s(make_world(loss=0.05)) < 0.002
