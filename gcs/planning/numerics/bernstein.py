"""Polynomials in Bernstein form: convex hulls, derivatives, products and subdivision.

A polynomial on [0, 1] lies in the convex hull of its Bernstein control points, so a statement about the control points
is a statement about the whole curve, without samples. Arrays have shape (..., n + 1, d): n is the degree, d the number
of components; leading axes are batches.
"""

from __future__ import annotations

from functools import cache
from math import comb
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

# Control points of a degree-7 piece of unit duration from its Hermite end states: rows are control points, columns are
# position, velocity, acceleration, jerk at the start and then at the end. The first four control points depend on the
# start alone and the last four on the end alone.
_HALF = np.array(
    [[1, 0, 0, 0], [1, 1 / 7, 0, 0], [1, 2 / 7, 1 / 42, 0], [1, 3 / 7, 3 / 42, 1 / 210]],
    dtype=np.float64,
)
CONTROL_FROM_START = _HALF
CONTROL_FROM_END = (_HALF * np.array([1.0, -1.0, 1.0, -1.0]))[::-1].copy()


@cache
def _control_from_monomial(degree: int) -> NDArray[np.float64]:
    """Matrix M with control = M @ monomial: M[i, k] = C(i, k) / C(n, k)."""
    n = degree
    return np.array([[comb(i, k) / comb(n, k) for k in range(n + 1)] for i in range(n + 1)])


@cache
def _monomial_from_control(degree: int) -> NDArray[np.float64]:
    """Matrix M with monomial = M @ control: M[k, i] = C(n, k) C(k, i) (-1)^(k - i)."""
    n = degree
    return np.array(
        [[comb(n, k) * comb(k, i) * (-1) ** (k - i) for i in range(n + 1)] for k in range(n + 1)], dtype=np.float64
    )


def control_from_monomial(coefficients: NDArray[np.float64]) -> NDArray[np.float64]:
    """Control points of `sum_k coefficients[..., k, :] u**k` on [0, 1]; shapes (..., n + 1, d)."""
    return _control_from_monomial(coefficients.shape[-2] - 1) @ coefficients


def monomial_from_control(control: NDArray[np.float64]) -> NDArray[np.float64]:
    """Monomial coefficients (lowest power first) of control points; shapes (..., n + 1, d)."""
    return _monomial_from_control(control.shape[-2] - 1) @ control


def derivative(control: NDArray[np.float64], order: int = 1) -> NDArray[np.float64]:
    """Control points (..., n + 1 - order, d) of the derivative with respect to u."""
    for _ in range(order):
        control = (control.shape[-2] - 1) * np.diff(control, axis=-2)
    return control


def squared_norm(control: NDArray[np.float64]) -> NDArray[np.float64]:
    """Bernstein coefficients (..., 2 n + 1) of the squared Euclidean norm of a curve (..., n + 1, d).

    `b_k = sum_{i + j = k} C(n, i) C(n, j) / C(2 n, k) (b_i . b_j)` (Farouki and Rajan 1988).
    """
    n = control.shape[-2] - 1
    gram = np.einsum("...id,...jd->...ij", control, control)
    result = np.zeros((*control.shape[:-2], 2 * n + 1))
    for i in range(n + 1):
        for j in range(n + 1):
            result[..., i + j] += comb(n, i) * comb(n, j) / comb(2 * n, i + j) * gram[..., i, j]
    return result


@cache
def _halving(degree: int) -> NDArray[np.float64]:
    """Matrix (2 (n + 1), n + 1) that gives the control points of the left and the right half (de Casteljau)."""
    n = degree
    left = np.array([[comb(i, k) / 2**i for k in range(n + 1)] for i in range(n + 1)])
    right = left[::-1, ::-1]
    return np.concatenate([left, right])


def halve(control: NDArray[np.float64]) -> NDArray[np.float64]:
    """Split every curve at u = 1/2.

    Args:
        control: shape (B, n + 1, d).

    Returns:
        Shape (2 B, n + 1, d): left and right half of the first curve, of the second, ...
    """
    batch, size, dimension = control.shape
    both = _halving(size - 1) @ control
    return both.reshape(batch * 2, size, dimension)
