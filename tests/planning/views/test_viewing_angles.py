"""Turning on the legs and settling before exposures."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs.planning.views.viewing_angles import (
    HOLD_S,
    SETTLE_S,
    STEADY_S,
    YAW_RATE_RAD_S,
    ViewingRates,
    least_leg_times_s,
    schedule_views,
)

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
    s = schedule_views(legs, yaw, pitch, ViewingRates(gimbal_rate, min_interval_s=interval))
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
    s = schedule_views(np.array([5.0, 20.0, 5.0]), np.radians([170.0, -170]), np.zeros(2), ViewingRates(1.0))
    t = np.linspace(0, 30, 3001)
    assert np.degrees(np.ptp(s.yaw.value(t))) == pytest.approx(20, abs=1e-6)
    assert np.abs(s.yaw.rate(t)).max() == pytest.approx(1.5 * math.radians(20) / 20, rel=1e-3)
    np.testing.assert_allclose(s.dwells_s, SETTLE_S + HOLD_S)


def test_a_leg_too_short_to_turn_in_lengthens_the_dwell():
    s = schedule_views(np.array([5.0, 1.0, 5.0]), np.array([0.0, math.pi / 2]), np.zeros(2), ViewingRates(1.0))
    assert s.dwells_s[1] == pytest.approx(1.5 * (math.pi / 2) / YAW_RATE_RAD_S - 1.0 + SETTLE_S + HOLD_S)


@settings(max_examples=80, deadline=None)
@given(
    st.lists(
        st.tuples(st.floats(0.3, 6), ANGLE, st.floats(-1.5, 0.5), st.booleans(), st.sampled_from([0.0, 0.5, 4.0])),
        min_size=1,
        max_size=8,
    ),
    st.floats(0, 4),
)
def test_what_is_flown_through_is_looked_at_in_time(views, interval):
    """Legs are as long as they have to be, or longer; yaw and pitch rest about every exposure."""
    yaw, pitch = np.array([v[1] for v in views]), np.array([v[2] for v in views])
    stops, holds = np.array([v[3] for v in views]), np.array([v[4] * v[3] for v in views])
    rates = ViewingRates(1.0, min_interval_s=interval)
    least = least_leg_times_s(yaw, pitch, stops, rates)
    legs = np.maximum([5.0, *(v[0] for v in views[1:]), 4.0], least)
    s = schedule_views(legs, yaw, pitch, rates, stops=stops, holds_s=holds)
    arrivals = np.cumsum(legs[:-1]) + np.concatenate([[0], np.cumsum(s.dwells_s)[:-1]])
    assert (s.dwells_s[~stops] == 0).all()
    np.testing.assert_allclose(s.exposures_s[~stops], arrivals[~stops])
    assert (np.diff(s.exposures_s) >= interval - 1e-9).all()
    assert (s.dwells_s[stops] >= np.maximum(SETTLE_S + HOLD_S, holds[stops]) - 1e-9).all()
    assert (np.diff(s.yaw.times_s) > 0).all()
    t = np.linspace(0, s.yaw.times_s[-1], 6001)
    assert np.abs(np.diff(s.yaw.value(t))).max() <= YAW_RATE_RAD_S * t[1] * (1 + 1e-6)
    assert np.abs(np.diff(s.gimbal_pitch.value(t))).max() <= 1.0 * t[1] * (1 + 1e-6)
    for k, exposure in enumerate(s.exposures_s):
        before = 0.0 if legs[k] < STEADY_S + HOLD_S else STEADY_S
        steady = exposure + np.linspace(-before, HOLD_S, 9)
        assert np.abs(np.exp(1j * s.yaw.value(steady)) - np.exp(1j * yaw[k])).max() < 1e-6
        np.testing.assert_allclose(s.gimbal_pitch.value(steady), pitch[k], atol=1e-6)


def test_views_the_same_way_may_follow_each_other_at_once():
    stops = np.zeros(4, dtype=bool)
    assert not least_leg_times_s(np.full(4, 2.0), np.full(4, -0.3), stops, ViewingRates(1.0))[:4].any()
    turning = least_leg_times_s(np.array([0.0, 1.0, 1.0, 1.0]), np.zeros(4), stops, ViewingRates(1.0))
    np.testing.assert_allclose(turning[1], HOLD_S + 1.5 / YAW_RATE_RAD_S + STEADY_S)
    assert turning[2] == turning[3] == 0.0
