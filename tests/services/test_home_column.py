"""What of a plan is streamed, and how fast."""

import numpy as np
import pytest

from gcs.services.home_column import SLEW, column_times, streamed_times


def test_the_column_is_left_near_its_top_and_entered_before_the_descent(small_plan):
    leave, enter = column_times(small_plan)
    aside = np.abs(small_plan.trajectory.value(np.array([leave, enter]))[:, 0])
    assert (aside <= 0.2).all()
    assert 6.0 < leave < 7.0
    assert 15.0 < enter <= 16.1


def test_a_stream_starts_and_stops_at_rest_and_misses_nothing(small_plan):
    leave, enter = column_times(small_plan)
    t, plan_s, rate = streamed_times(small_plan, 0.05)
    assert (plan_s[0], plan_s[-1]) == (pytest.approx(leave), pytest.approx(enter))
    assert (rate[0], rate[-1], rate.max()) == (0.0, pytest.approx(0.0, abs=1e-12), pytest.approx(1.0))
    assert np.diff(t).max() <= 0.05 + 1e-9
    # The plan's time is the integral of the rate, which changes no faster than the clock can.
    assert np.cumsum((rate[1:] + rate[:-1]) / 2 * np.diff(t)) == pytest.approx(plan_s[1:] - leave, abs=1e-3)
    assert np.abs(np.diff(rate) / np.diff(t)).max() <= SLEW + 1e-9
    assert t[-1] == pytest.approx(enter - leave + 1 / SLEW, abs=1e-6)
