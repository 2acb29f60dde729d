"""Segment times of detours against closed forms."""

import numpy as np
import pytest

from gcs.planning.local.detour_times import profile_times


def test_from_rest_to_rest_is_the_trapezoid():
    times = profile_times(np.array([40.0, 60.0]), 5.0, 1.0, 0.0, 0.0)
    assert times.sum() == pytest.approx(100 / 5 + 5 / 1, rel=0.02)
    assert times[0] == pytest.approx(40 / 5 + 2.5, rel=0.02)


def test_at_the_cruise_all_along_it_is_length_over_speed():
    assert profile_times(np.array([3.0, 7.0, 5.0]), 4.0, 1.0, 4.0, 4.0) == pytest.approx([0.75, 1.75, 1.25])


def test_ends_quicker_than_the_cruise_are_slowed_down_from_and_sped_up_to():
    times = profile_times(np.array([50.0]), 2.0, 1.0, 4.0, 4.0)
    # From 4 m/s to 2 m/s takes 2 s and 6 m, twice; 38 m between at 2 m/s.
    assert times.sum() == pytest.approx(2 + 2 + 19, rel=0.01)


def test_one_end_at_rest_and_one_quick():
    times = profile_times(np.array([50.0]), 2.0, 1.0, 0.0, 4.0)
    # 2 s and 2 m to get going, 2 s and 6 m to speed up at the end, 42 m between.
    assert times.sum() == pytest.approx(2 + 2 + 21, rel=0.02)


def test_too_short_for_the_cruise_is_a_triangle():
    assert profile_times(np.array([4.0]), 9.0, 1.0, 0.0, 0.0).sum() == pytest.approx(2 * 2.0, rel=0.1)
