"""Proved bounds over curves against dense samples and the roots of derivatives."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gcs.core.errors import OperationCancelled
from gcs.core.progress import SilentProgress
from gcs.core.trajectory import PiecewisePolynomial
from gcs.planning.numerics.bernstein import monomial_from_control
from gcs.planning.numerics.curve_bounds import largest_norm, least, lipschitz_bounds
from gcs.planning.trajectories.flight_limits import peaks


def random_curve(seed, count):
    rng = np.random.default_rng(seed)
    return rng.normal(size=(count, 8, 3)) * 5, rng.uniform(0.3, 3.0, count)


def largest_by_roots(control, durations, order):
    largest = 0.0
    for piece, duration in zip(monomial_from_control(control), durations, strict=True):
        axes = [np.polynomial.Polynomial(piece[:, d]).deriv(order) for d in range(3)]
        square = axes[0] ** 2 + axes[1] ** 2 + axes[2] ** 2
        roots = square.deriv().roots()
        inside = np.clip(roots.real[np.abs(roots.imag) < 1e-6], 0, 1)
        largest = max(largest, np.sqrt(square(np.array([0, 1, *inside])).max()) / duration**order)
    return largest


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10_000), st.integers(1, 6), st.sampled_from([1, 2, 3]))
def test_the_largest_norm_by_subdivision_is_that_by_roots(seed, count, order):
    control, durations = random_curve(seed, count)
    bound = largest_norm(control, durations, order)
    true = largest_by_roots(control, durations, order)
    assert true * (1 - 1e-9) <= bound.value <= true * (1 + 1e-5)
    assert true * (1 - 1e-9) <= peaks(control, durations)[order - 1] <= true * (1 + 2e-7)


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10_000), st.integers(1, 6), st.sampled_from([1.0, -1.0]))
def test_the_least_distance_is_within_the_tolerance_of_dense_samples(seed, count, sign):
    control, durations = random_curve(seed, count)
    centre = np.array([1.0, -2, 0.5])

    def distance(points):
        return np.linalg.norm(points - centre, axis=1)

    found = least(control, durations, lipschitz_bounds(distance, sign), 1e-3, SilentProgress())
    pieces = [
        PiecewisePolynomial(m[None], d[None]) for m, d in zip(monomial_from_control(control), durations, strict=True)
    ]
    dense = np.concatenate([p.value(np.linspace(0, p.duration_s, 4001)) for p in pieces])
    sampled = (sign * distance(dense)).min()
    assert sampled - 2e-2 < found.value <= sampled + 1e-9
    assert 0 <= found.time_s <= durations.sum()


def test_where_the_extremum_is_is_told():
    """A straight from x = -1 to 1 in 2 s passes the origin at t = 1 s."""
    control = np.zeros((1, 8, 3))
    control[0, :, 0] = np.linspace(-1, 1, 8)
    control[0, :, 1] = 3.0
    found = least(
        control, np.array([2.0]), lipschitz_bounds(lambda p: np.linalg.norm(p, axis=1)), 1e-6, SilentProgress()
    )
    assert found.value == pytest.approx(3.0, abs=1e-6)
    assert found.time_s == pytest.approx(1.0, abs=1e-2)
    assert largest_norm(control, np.array([2.0]), 1).value == pytest.approx(1.0)


def test_a_curve_that_rests_has_bounds_too():
    control = np.ones((1, 8, 3))
    assert largest_norm(control, np.array([2.0]), 2).value == 0.0
    found = least(control, np.array([2.0]), lipschitz_bounds(lambda p: p[:, 0]), 1e-3, SilentProgress())
    assert found.value == pytest.approx(1.0)


def test_a_function_that_is_asked_nowhere_is_infinite():
    def nowhere(parts):
        return np.full(len(parts), math.inf), np.full(len(parts), math.inf)

    assert least(np.ones((1, 8, 3)), np.ones(1), nowhere, 1e-3, SilentProgress()).value == math.inf


def test_it_stops_when_told():
    class Stop:
        def report(self, stage, fraction):
            raise OperationCancelled("stop")

    with pytest.raises(OperationCancelled):
        least(np.ones((1, 8, 3)), np.ones(1), lipschitz_bounds(lambda p: p[:, 0]), 1e-3, Stop())
