"""Bernstein forms against numpy's polynomials."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs.planning.numerics.bernstein import (
    CONTROL_FROM_END,
    CONTROL_FROM_START,
    control_from_monomial,
    derivative,
    halve,
    monomial_from_control,
    squared_norm,
)

U = np.linspace(0, 1, 41)


def values(control):
    """(B, n + 1, d) -> (B, 41, d), by scipy's Bernstein polynomials."""
    from scipy.interpolate import BPoly

    return np.stack([BPoly(c[:, None, :], [0, 1])(U) for c in control])


@pytest.fixture
def control():
    return np.random.default_rng(0).normal(size=(5, 8, 3)) * 10


def test_monomials_and_control_points_are_the_same_curve(control):
    monomial = monomial_from_control(control)
    powers = U[:, None] ** np.arange(8)
    np.testing.assert_allclose(np.einsum("uk,bkd->bud", powers, monomial), values(control), atol=1e-9)
    np.testing.assert_allclose(control_from_monomial(monomial), control, atol=1e-9)


@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_derivative_matches_numpy(control, order):
    found = values(derivative(control, order))
    for b in range(5):
        for d in range(3):
            expected = np.polynomial.Polynomial(monomial_from_control(control)[b, :, d]).deriv(order)(U)
            np.testing.assert_allclose(found[b, :, d], expected, rtol=1e-8, atol=1e-6)


def test_squared_norm_is_the_squared_norm(control):
    found = values(squared_norm(control)[:, :, None])[:, :, 0]
    np.testing.assert_allclose(found, (values(control) ** 2).sum(axis=2), rtol=1e-9)


def test_halves_are_the_halves(control):
    halves = values(halve(control))
    whole = values(control)
    np.testing.assert_allclose(halves[0::2][:, ::2], whole[:, :21], atol=1e-9)
    np.testing.assert_allclose(halves[1::2][:, ::2], whole[:, 20:], atol=1e-9)


@given(st.lists(st.floats(-5, 5), min_size=8, max_size=8))
def test_end_states_give_the_curve_with_those_derivatives(states):
    start, end = np.array(states[:4]), np.array(states[4:])
    control = np.concatenate([CONTROL_FROM_START @ start, CONTROL_FROM_END @ end])[:, None]
    polynomial = np.polynomial.Polynomial(monomial_from_control(control)[:, 0])
    for order in range(4):
        q = polynomial.deriv(order) if order else polynomial
        assert q(0.0) == pytest.approx(start[order], abs=1e-9)
        assert q(1.0) == pytest.approx(end[order], abs=1e-7)
