"""Distances between vehicles against closed forms and dense samples."""

import numpy as np
import pytest

from gcs.core.errors import OperationCancelled
from gcs.core.progress import SilentProgress
from gcs.core.trajectory import PiecewisePolynomial
from gcs.planning.flights.separation import TOLERANCE_M, TimedCurve, least_separation

REST_TO_REST = np.array([0, 0, 0, 0, 35, -84, 70, -20], dtype=float)


def straight(start, end, seconds):
    """At constant speed."""
    coefficients = np.zeros((1, 8, 3))
    coefficients[0, 0], coefficients[0, 1] = start, np.subtract(end, start)
    return PiecewisePolynomial(coefficients, np.array([float(seconds)]))


def moves(rng, legs):
    stops = rng.uniform(-10, 10, (legs + 1, 3))
    coefficients = REST_TO_REST[None, :, None] * np.diff(stops, axis=0)[:, None]
    coefficients[:, 0] += stops[:-1]
    return PiecewisePolynomial(coefficients, rng.uniform(1, 5, legs))


def sampled(a, b, step=1e-3):
    times = np.arange(min(a.start_s, b.start_s) - 1, max(a.end_s, b.end_s) + 1, step)
    return np.linalg.norm(a.position(times) - b.position(times), axis=1).min()


def test_two_lines_that_cross_are_as_near_as_geometry_says():
    """Along x and along y at 1 m/s, the second 3 s late: |(t, 0) - (0, t - 3)| is least at t = 1.5, 3 / sqrt(2)."""
    a = TimedCurve(straight([-10, 0, 5], [10, 0, 5], 20), 0.0)
    b = TimedCurve(straight([0, -10, 5], [0, 10, 5], 20), 3.0)
    found = least_separation([a, b], SilentProgress())
    assert 3 / np.sqrt(2) - TOLERANCE_M <= found.distance_m <= 3 / np.sqrt(2)
    assert found.time_s == pytest.approx(11.5, abs=0.2)
    assert found.pair == (0, 1)


def test_they_meet_when_neither_is_late():
    a = TimedCurve(straight([-10, 0, 5], [10, 0, 5], 20), 7.0)
    b = TimedCurve(straight([0, -10, 5], [0, 10, 5], 20), 7.0)
    assert least_separation([a, b], SilentProgress()).distance_m <= 1e-9


def test_those_that_wait_to_start_and_have_landed_are_in_the_way_too():
    crossing = TimedCurve(straight([-10, 2, 0], [10, 2, 0], 10), 0.0)
    later = TimedCurve(straight([0, 0, 0], [0, -50, 0], 10), 100.0)
    earlier = TimedCurve(straight([0, -50, 0], [0, 1, 0], 10), -100.0)
    assert least_separation([crossing, later], SilentProgress()).distance_m == pytest.approx(2.0, abs=TOLERANCE_M)
    assert least_separation([crossing, earlier], SilentProgress()).distance_m == pytest.approx(1.0, abs=TOLERANCE_M)


@pytest.mark.parametrize("seed", range(6))
def test_random_flights_against_dense_samples(seed):
    rng = np.random.default_rng(seed)
    curves = [TimedCurve(moves(rng, 6), float(rng.uniform(0, 5))) for _ in range(3)]
    found = least_separation(curves, SilentProgress())
    every = {(i, j): sampled(curves[i], curves[j]) for i in range(3) for j in range(i + 1, 3)}
    nearest = min(every, key=every.get)
    assert found.pair == nearest
    assert every[nearest] - 0.02 - TOLERANCE_M <= found.distance_m <= every[nearest] + 1e-9


def test_it_can_be_stopped():
    class Stop:
        def report(self, stage, fraction):
            assert stage == "separation"
            raise OperationCancelled("stop")

    curves = [TimedCurve(moves(np.random.default_rng(k), 3), 0.0) for k in range(2)]
    with pytest.raises(OperationCancelled):
        least_separation(curves, Stop())
