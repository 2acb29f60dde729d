"""Limits and heights of curves, against many points."""

import numpy as np
import pytest

from gcs.core.trajectory import PiecewisePolynomial
from gcs.planning.local.curve_checks import heights_in_slab, within_limits
from gcs.planning.trajectories.flight_limits import FlightLimits


def straight_up(heights):
    coefficients = np.zeros((len(heights), 8, 3))
    coefficients[:, 0, 2] = [low for low, _ in heights]
    coefficients[:, 1, 2] = [high - low for low, high in heights]
    return PiecewisePolynomial(coefficients, np.ones(len(heights)))


def test_pieces_are_in_the_slab_or_not_wholly():
    curve = straight_up([(9.6, 10.4), (10.4, 10.6), (10.6, 12.0), (5.0, 9.0), (5.0, 15.0)])
    assert heights_in_slab(curve, (9.5, 10.5)).tolist() == [True, False, False, False, False]
    assert heights_in_slab(curve, None).all()


@pytest.mark.parametrize("seed", range(8))
def test_limits_hold_where_no_sample_exceeds_them(seed):
    curve = PiecewisePolynomial(np.random.default_rng(seed).normal(size=(3, 8, 3)), np.array([1.0, 2.0, 1.5]))
    times = np.linspace(0.0, curve.duration_s, 20_000)
    most = [float(np.linalg.norm(curve.value(times, order), axis=1).max()) for order in (1, 2, 3)]
    assert within_limits(curve, FlightLimits(*(1.001 * np.array(most))))
    for k in range(3):
        assert not within_limits(curve, FlightLimits(*[0.99 * m if j == k else 1.001 * m for j, m in enumerate(most)]))
