"""Time warps: consistency of time, rate and acceleration, and their limits."""

import numpy as np
import pytest

from gcs.core.errors import InfeasibleError
from gcs.core.trajectory import PiecewisePolynomial
from gcs.planning.trajectories.retiming import STEP_S, TimeWarp, identity_warp, warp_under_caps

REST_TO_REST = np.array([0, 0, 0, 0, 35, -84, 70, -20.0])


@pytest.fixture
def flight():
    """20 m along x in 10 s and back, resting between: at most 4.4 m/s and 1.5 m/s^2."""
    out = REST_TO_REST[:, None] * np.array([20.0, 0, 5])
    back = -out
    back[0] += [20, 0, 5]
    return PiecewisePolynomial(np.stack([out, back]), np.array([10.0, 10.0]))


def test_the_identity_changes_nothing(flight):
    warp = identity_warp(20.0)
    t = np.linspace(0, 20, 50)
    np.testing.assert_allclose(warp.plan_time(t), t)
    for order, flown in enumerate(warp.setpoint(flight, t)):
        np.testing.assert_allclose(flown, flight.value(t, order), atol=1e-9)
    assert warp.duration_s == pytest.approx(20.0)


def test_rate_and_acceleration_are_the_derivatives_of_plan_time():
    grid = np.linspace(0, 20, 200)
    warp = TimeWarp(grid, 0.6 + 0.4 * np.cos(grid))
    t = np.linspace(0.1, warp.duration_s - 0.1, 500)
    h = 1e-5
    np.testing.assert_allclose(warp.rate(t), (warp.plan_time(t + h) - warp.plan_time(t - h)) / (2 * h), atol=1e-6)
    np.testing.assert_allclose(warp.acceleration(t), (warp.rate(t + h) - warp.rate(t - h)) / (2 * h), atol=1e-3)
    assert float(warp.plan_time(warp.duration_s)) == pytest.approx(20.0, abs=1e-9)
    np.testing.assert_allclose(warp.plan_time([-1.0, 1e9]), [0.0, 20.0])
    np.testing.assert_allclose(warp.rate([-1.0, 1e9]), 0.0)
    for plan_time in (0.0, 3.3, 19.9, 20.0):
        assert float(warp.plan_time(warp.time_of(plan_time))) == pytest.approx(plan_time, abs=1e-7)


def caps_for(flight, function):
    count = round(flight.duration_s / STEP_S)
    return function((np.arange(count) + 0.5) * flight.duration_s / count)


def test_setpoints_belong_together_and_keep_caps_and_limit(flight):
    caps = caps_for(flight, lambda s: np.where((s > 4.5) & (s < 5.2), 0.25, 1.0))
    warp = warp_under_caps(flight, caps, 1.6)
    t = np.linspace(0, warp.duration_s, 40_001)
    p, v, a = warp.setpoint(flight, t)
    h = t[1]
    np.testing.assert_allclose(np.gradient(p, h, axis=0)[2:-2], v[2:-2], atol=2e-4)
    np.testing.assert_allclose(np.gradient(v, h, axis=0)[2:-2], a[2:-2], atol=2e-2)
    assert np.linalg.norm(a, axis=1).max() <= 1.6 + 1e-6
    assert np.abs(np.diff(a, axis=0)).max() < 0.05  # no jump of the acceleration
    interval = np.minimum((warp.plan_time(t) / flight.duration_s * len(caps)).astype(int), len(caps) - 1)
    assert (warp.rate(t) <= caps[interval] + 1e-6).all()
    assert warp.rate(t).min() > 0.2
    far = warp.plan_time(t) > 10.5
    np.testing.assert_allclose(warp.rate(t[far & (t < warp.duration_s)]), 1.0, atol=1e-9)


def test_caps_of_one_give_the_identity(flight):
    warp = warp_under_caps(flight, np.ones(1000), 1.6)
    assert warp.duration_s == pytest.approx(20.0)


def test_a_plan_over_the_limit_is_slowed_into_it(flight):
    caps = caps_for(flight, lambda s: np.where(s > 15, 0.5, 1.0))
    warp = warp_under_caps(flight, caps, 1.0)
    t = np.linspace(0, warp.duration_s, 20_001)
    assert np.linalg.norm(warp.setpoint(flight, t).acceleration_m_s2, axis=1).max() <= 1.0 + 1e-6


def test_a_limit_far_under_the_plans_own_acceleration_is_refused(flight):
    caps = caps_for(flight, lambda s: np.where(s > 15, 0.5, 1.0))
    with pytest.raises(InfeasibleError, match="allowed"):
        warp_under_caps(flight, caps, 0.01)
