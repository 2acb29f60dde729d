"""A speed brought to a wanted one: it gets there, soonest, within its bounds, and together with the other axes."""

import numpy as np
import pytest

from gcs.planning.dynamics.velocity_smoothing import advance, brakable_speed, in_time, quickest

JERK, MOST = 4.0, 3.0


def flown(axis, plan, seconds, dt=0.001):
    states = [axis.copy()]
    for _ in range(round(seconds / dt)):
        # the plan counts from its own start: what is over is taken off its parts
        advance(axis, plan, JERK, dt)
        left = dt
        for part in (1, 2, 3):
            used = min(left, plan[part])
            plan[part] -= used
            left -= used
        states.append(axis.copy())
    return np.array(states)


@pytest.mark.parametrize("start", [(0.0, 0.0), (2.0, 0.0), (-3.0, 1.0), (1.0, -2.0), (5.0, 2.9)])
@pytest.mark.parametrize("wanted", [-4.0, 0.0, 1.5, 5.0])
def test_the_speed_is_reached_within_the_bounds(start, wanted):
    plan = np.zeros(4)
    speed, acceleration = start
    quickest(acceleration, speed, wanted, JERK, MOST, plan)
    states = flown(np.array([0.0, speed, acceleration]), plan.copy(), plan[1:].sum() + 0.01)
    assert states[-1, 1] == pytest.approx(wanted, abs=1e-6)
    assert states[-1, 2] == pytest.approx(0.0, abs=1e-6)
    assert abs(states[:, 2]).max() <= MOST + 1e-9
    assert abs(np.diff(states[:, 2])).max() <= JERK * 0.001 + 1e-9


def test_from_rest_it_takes_the_closed_form_of_time():
    plan = np.zeros(4)
    quickest(0.0, 0.0, 1.0, JERK, MOST, plan)  # 2 sqrt(v / j), no constant acceleration
    assert plan.tolist() == pytest.approx([1.0, 0.5, 0.0, 0.5])
    quickest(0.0, 0.0, 6.0, JERK, MOST, plan)  # v / a + a / j
    assert plan[1:].sum() == pytest.approx(6.0 / MOST + MOST / JERK)


def test_an_axis_is_stretched_to_the_slowest_ones_time():
    plan = np.zeros(4)
    quickest(0.0, 0.0, 1.0, JERK, MOST, plan)
    in_time(0.0, 0.0, 1.0, JERK, MOST, 2.0, plan)
    assert plan[1:].sum() == pytest.approx(2.0)
    assert plan[2] > 0
    states = flown(np.array([0.0, 0.0, 0.0]), plan.copy(), 2.0)
    assert states[-1, 1] == pytest.approx(1.0, abs=1e-6)


def test_from_a_brakable_speed_the_end_is_met():
    v = brakable_speed(JERK, MOST, 30.0, 1.0)
    assert v**2 - 2 * MOST * (30.0 - 2 * v * MOST / JERK) == pytest.approx(1.0)
    assert brakable_speed(JERK, MOST, 0.0, 2.0) == 2.0
