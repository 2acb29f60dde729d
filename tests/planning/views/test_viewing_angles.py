"""Turning on the legs and settling before exposures."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs.planning.views.viewing_angles import HOLD_S, SETTLE_S, YAW_RATE_RAD_S, schedule_views

ANGLE = st.floats(-math.pi, math.pi)
FLIGHT = st.one_of(st.floats(0.3, 20), st.just(0.0))


@settings(max_examples=60, deadline=None)
@given(
    st.lists(
        st.tuples(st.one_of(st.floats(0.3, 20), st.just(0.0)), ANGLE, st.floats(-1.5, 0.5)), min_size=1, max_size=8
    ),
    st.floats(0.2, 2),
    st.floats(0, 6),
)
def test_rates_settling_intervals_and_angles(stops, gimbal_rate, interval):
    legs = np.array([5.0] + [s[0] for s in stops[1:]] + [4.0])
    yaw, pitch = np.array([s[1] for s in stops]), np.array([s[2] for s in stops])
    s = schedule_views(legs, yaw, pitch, gimbal_rate_rad_s=gimbal_rate, min_interval_s=interval)
    arrivals = np.cumsum(legs[:-1]) + np.concatenate([[0], np.cumsum(s.dwells_s)[:-1]])
    leaves = arrivals + s.dwells_s
    end = legs.sum() + s.dwells_s.sum()
    t = np.linspace(0, end, 4001)
    assert np.abs(s.yaw.rate(t)).max() <= YAW_RATE_RAD_S * (1 + 1e-9)
    assert np.abs(s.gimbal_pitch.rate(t)).max() <= gimbal_rate * (1 + 1e-9)
    assert (np.diff(s.yaw.times_s) > 0).all()
    assert s.yaw.times_s[-1] == pytest.approx(end)
    assert (s.exposures_s >= arrivals + SETTLE_S - 1e-9).all()
    np.testing.assert_allclose(leaves - s.exposures_s, HOLD_S)
    assert (np.diff(s.exposures_s) >= interval - 1e-9).all()
    for k, exposure in enumerate(s.exposures_s):
        settled = np.linspace(exposure - SETTLE_S, leaves[k], 9)
        assert np.abs(np.exp(1j * s.yaw.value(settled)) - np.exp(1j * yaw[k])).max() < 1e-6
        np.testing.assert_allclose(s.gimbal_pitch.value(settled), pitch[k], atol=1e-6)


def test_it_turns_the_short_way_over_the_whole_leg():
    s = schedule_views(np.array([5.0, 20.0, 5.0]), np.radians([170.0, -170]), np.zeros(2), gimbal_rate_rad_s=1.0)
    t = np.linspace(0, 30, 3001)
    assert np.degrees(np.ptp(s.yaw.value(t))) == pytest.approx(20, abs=1e-6)
    assert np.abs(s.yaw.rate(t)).max() == pytest.approx(1.5 * math.radians(20) / 20, rel=1e-3)
    np.testing.assert_allclose(s.dwells_s, SETTLE_S + HOLD_S)


def test_a_leg_too_short_to_turn_in_lengthens_the_dwell():
    s = schedule_views(np.array([5.0, 1.0, 5.0]), np.array([0.0, math.pi / 2]), np.zeros(2), gimbal_rate_rad_s=1.0)
    assert s.dwells_s[1] == pytest.approx(1.5 * (math.pi / 2) / YAW_RATE_RAD_S - 1.0 + SETTLE_S + HOLD_S)
