"""The speed profile of a leg, against its own definition: bounded derivatives, the whole way, and closed forms."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from gcs.planning.dynamics.s_curve import PROFILE_SIZE, leg_profile, leg_state, limit_along

SNAP, JERK, ACCELERATION = np.pi / 0.6, 1.0, 2.5


def profile(length, speed=4.0, snap=SNAP, jerk=JERK, acceleration=ACCELERATION):
    out = np.empty(PROFILE_SIZE)
    leg_profile(length, snap, jerk, acceleration, speed, out)
    return out


def sampled(p, count=20001):
    t = np.linspace(0.0, p[8], count)
    a, v, way = np.array([leg_state(p, x) for x in t]).T
    return t, a, v, way


@pytest.mark.parametrize("length", [0.01, 0.3, 1.0, 4.0, 20.0, 300.0])
@pytest.mark.parametrize("jerk", [0.5, 1.0, 5.0, 20.0])
def test_a_leg_is_flown_from_rest_to_rest_within_its_bounds(length, jerk):
    snap = np.pi * jerk / 0.6
    p = profile(length, snap=snap, jerk=jerk)
    t, a, v, way = sampled(p)
    assert_allclose([v[0], v[-1], way[0], way[-1]], [0, 0, 0, length], atol=1e-9)
    assert (np.diff(way) >= -1e-12).all()
    assert v.max() <= 4.0 + 1e-9
    assert abs(a).max() <= ACCELERATION + 1e-9
    assert abs(np.gradient(a, t)).max() <= jerk * 1.001
    assert abs(np.gradient(np.gradient(a, t), t)[2:-2]).max() <= snap * 1.02


def test_speed_and_way_are_the_integrals_of_the_acceleration():
    for length in (0.5, 3.0, 60.0):
        t, a, v, way = sampled(profile(length))
        step = t[1] - t[0]
        assert_allclose(np.concatenate([[0], np.cumsum((a[1:] + a[:-1]) / 2 * step)]), v, atol=1e-5)
        assert_allclose(np.concatenate([[0], np.cumsum((v[1:] + v[:-1]) / 2 * step)]), way, atol=1e-4)


def test_a_long_leg_has_the_closed_form_of_its_acceleration():
    # all of jerk, acceleration and speed are reached: T = V/A + A/J + t_j with t_j = pi J / 2 S
    p = profile(1000.0, speed=12.0)
    assert p[4] == pytest.approx(12.0)
    assert p[5] == pytest.approx(12.0 / ACCELERATION + ACCELERATION / JERK + 0.3)
    assert p[8] == pytest.approx(2 * p[5] + (1000.0 - 12.0 * p[5]) / 12.0)


def test_a_very_short_leg_is_bounded_by_its_snap_alone():
    # four raised cosines a half: L / 2 = 4 J t_j^3 with J = 2 S t_j / pi, so t_j = (pi L / 16 S)^(1/4)
    p = profile(0.01)
    ramp = (np.pi * 0.01 / (16 * SNAP)) ** 0.25
    assert p[8] == pytest.approx(8 * ramp)
    assert p[4] == pytest.approx(2 * (2 * SNAP * ramp / np.pi) * ramp**2)


def test_a_limit_along_a_direction_holds_for_each_of_its_parts():
    assert limit_along(1.0, 0.0, 0.0, 4.0, 2.0, 1.0) == pytest.approx(4.0)
    assert limit_along(0.0, 0.0, 5.0, 4.0, 2.0, 1.0) == pytest.approx(2.0)
    assert limit_along(0.0, 0.0, -5.0, 4.0, 2.0, 1.0) == pytest.approx(1.0)
    both = limit_along(3.0, 0.0, 4.0, 4.0, 2.0, 1.0)
    assert both * 0.8 == pytest.approx(2.0)
    assert both * 0.6 <= 4.0
