"""The tracker against a straight plan, where distances are known by hand."""

from types import SimpleNamespace

import numpy as np
import pytest

from gcs.core.trajectory import PiecewisePolynomial
from gcs.services.flight_tracker import FlightTracker


@pytest.fixture
def plan():
    coefficients = np.zeros((1, 8, 3))
    coefficients[0, 1, 0] = 100.0  # x = 100 u
    viewpoints = [SimpleNamespace(id=k, position_m=np.array([x, 0.0, 0.0])) for k, x in enumerate((10.0, 50.0, 50.0))]
    return SimpleNamespace(trajectory=PiecewisePolynomial(coefficients, np.array([37.0])), viewpoints=tuple(viewpoints))


def test_cross_track_is_the_distance_from_the_line_also_between_samples(plan):
    tracker = FlightTracker(plan)
    for x in np.linspace(0.3, 99.7, 41):
        assert tracker.observe(np.array([x, 0.6, 0.8])).cross_track_m == pytest.approx(1.0, abs=1e-9)
    assert tracker.observe(np.array([-3.0, 4.0, 0.0])).cross_track_m == pytest.approx(5.0)


def test_viewpoints_are_reached_within_half_a_metre_and_the_best_miss_counts(plan):
    tracker = FlightTracker(plan)
    assert tracker.observe(np.array([9.4, 0.0, 0.0])).visits == {}
    assert tracker.observe(np.array([9.6, 0.0, 0.0])).visits == {0: pytest.approx(0.4)}
    assert tracker.observe(np.array([9.9, 0.0, 0.0])).visits == {0: pytest.approx(0.1)}
    assert tracker.observe(np.array([9.7, 0.0, 0.0])).visits == {}
    assert tracker.visits == {0: pytest.approx(0.1)}


def test_two_viewpoints_at_one_place_are_reached_together(plan):
    assert set(FlightTracker(plan).observe(np.array([50.0, 0.2, 0.0])).visits) == {1, 2}


def test_what_was_reached_before_a_restart_is_kept(plan):
    tracker = FlightTracker(plan, {0: 0.05})
    assert tracker.observe(np.array([10.1, 0.0, 0.0])).visits == {}
    assert tracker.visits == {0: 0.05}
