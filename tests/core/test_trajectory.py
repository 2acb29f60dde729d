"""Piecewise polynomials against numpy's polynomials, angle profiles against finite differences."""

import numpy as np
import pytest
from numpy.polynomial import Polynomial

from gcs.core.trajectory import AngleProfile, PiecewisePolynomial


@pytest.fixture
def curve():
    rng = np.random.default_rng(3)
    return PiecewisePolynomial(rng.normal(size=(4, 8, 3)), np.array([0.5, 2.0, 1.0, 7.0]))


@pytest.mark.parametrize("order", [0, 1, 2, 3, 4, 7])
def test_values_and_derivatives_match_numpy(curve, order):
    for t, segment, start in [(0.2, 0, 0.0), (1.7, 1, 0.5), (3.1, 2, 2.5), (9.0, 3, 3.5)]:
        for axis in range(3):
            oracle = Polynomial(curve.coefficients[segment, :, axis])(
                Polynomial([-start, 1]) / curve.durations_s[segment]
            )
            expected = oracle.deriv(order)(t) if order else oracle(t)
            assert curve.value(t, order)[axis] == pytest.approx(expected, rel=1e-9, abs=1e-9)


def test_many_times_at_once_and_held_ends(curve):
    t = np.array([[-1.0, 0.0], [curve.duration_s, 99.0]])
    p = curve.value(t)
    assert p.shape == (2, 2, 3)
    np.testing.assert_allclose(p[0, 0], p[0, 1])
    np.testing.assert_allclose(p[1, 0], p[1, 1])
    np.testing.assert_allclose(p[1, 0], curve.coefficients[-1].sum(axis=0))


def test_angle_profile_rests_at_knots_and_moves_between():
    profile = AngleProfile(np.array([0.0, 2.0, 3.0, 5.0]), np.array([0.0, 1.0, 1.0, -2.0]))
    np.testing.assert_allclose(profile.value([0, 2, 2.5, 3, 5, 9]), [0, 1, 1, 1, -2, -2])
    np.testing.assert_allclose(profile.rate([0, 2, 3, 5]), 0, atol=1e-12)
    t = np.linspace(0.01, 4.99, 301)
    slope = (profile.value(t + 1e-6) - profile.value(t - 1e-6)) / 2e-6
    np.testing.assert_allclose(profile.rate(t), slope, atol=1e-5)
