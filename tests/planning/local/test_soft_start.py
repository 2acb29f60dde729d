"""Going on along a leg from rest."""

from __future__ import annotations

import numpy as np
import pytest

from gcs.core.trajectory import PiecewisePolynomial
from gcs.planning.local.curve_checks import within_limits
from gcs.planning.local.soft_start import NEAR_M, soft_start
from gcs.planning.trajectories.flight_limits import FlightLimits

LIMITS = FlightLimits(5.0, 2.5)
BESIDE_M = np.array([0.2, -0.2, 0.1])


@pytest.fixture
def leg():
    """Steeply up and aside, 30 m in 16 s, from rest to rest."""
    coefficients = np.zeros((1, 8, 3))
    coefficients[0, 4:] = np.outer([35.0, -84.0, 70.0, -20.0], [6.0, 9.0, 28.0])
    return PiecewisePolynomial(coefficients, np.array([16.0]))


@pytest.mark.parametrize("from_s", [0.0, 3.0, 6.0])
def test_from_rest_to_the_legs_own_pace_on_its_own_way(leg, from_s):
    place = leg.value(from_s) + BESIDE_M
    found = soft_start(place, leg, from_s, LIMITS, 50.0)
    assert found.curve.value(0.0) == pytest.approx(place, abs=1e-9)
    for order in (1, 2):
        assert found.curve.value(0.0, order) == pytest.approx(np.zeros(3), abs=1e-9)
    assert within_limits(found.curve, LIMITS)
    ends = np.cumsum(found.curve.durations_s)[:-1]
    for order in range(3):
        assert found.curve.value(ends - 1e-7, order) == pytest.approx(found.curve.value(ends + 1e-7, order), abs=1e-4)
    for clock_s in 50.0 + np.linspace(0.0, found.curve.duration_s, 60):
        at_s = found.at(clock_s)
        off = np.linalg.norm(found.curve.value(at_s) - leg.value(found.leg_at(at_s)))
        assert off <= (np.linalg.norm(BESIDE_M) + 0.01 if at_s < found.joins_s else 0.01)
    later = found.joins_s + 0.5
    assert found.curve.value(later, 1) == pytest.approx(leg.value(found.leg_at(later), 1), abs=1e-3)
    assert found.leg_at(found.curve.duration_s) == pytest.approx(leg.duration_s)


def test_where_the_leg_is_quick_it_takes_longer(leg):
    slow, quick = (soft_start(leg.value(at_s), leg, at_s, LIMITS, 0.0) for at_s in (1.0, 5.0))
    assert quick.joins_s > slow.joins_s


def test_elsewhere_or_too_near_the_end_it_says_so(leg):
    assert soft_start(leg.value(6.0) + np.array([NEAR_M + 0.01, 0.0, 0.0]), leg, 6.0, LIMITS, 0.0) is None
    assert soft_start(leg.value(15.8), leg, 15.8, LIMITS, 0.0) is None
    assert soft_start(leg.value(6.0), leg, 6.0, FlightLimits(5.0, 0.1), 0.0) is None
