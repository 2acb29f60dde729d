"""Positions and derivatives of a piecewise polynomial at many instants in order, compiled."""

from __future__ import annotations

import numpy as np

from gcs.planning.numerics.compiled import compiled

Floats = np.ndarray[tuple[int, ...], np.dtype[np.float64]]


@compiled
def sampled(coefficients: Floats, durations_s: Floats, times_s: Floats, order: int) -> Floats:
    """A curve or a derivative at instants that do not decrease; the same as `PiecewisePolynomial.value`.

    Args:
        coefficients: on normalised time, lowest power first, shape (S, n + 1, D).
        durations_s: of the pieces, shape (S,).
        times_s: shape (T,); held at the ends outside the curve.
        order: 0 the curve itself, 1 its velocity, ...

    Returns:
        Shape (T, D).
    """
    terms, axes = coefficients.shape[1], coefficients.shape[2]
    factors = np.ones(terms)
    for k in range(terms):
        for below in range(order):
            factors[k] *= k - below
    result = np.zeros((len(times_s), axes))
    piece, start, last = 0, 0.0, len(durations_s) - 1
    for i in range(len(times_s)):
        while piece < last and times_s[i] >= start + durations_s[piece]:
            start += durations_s[piece]
            piece += 1
        u = min(max((times_s[i] - start) / durations_s[piece], 0.0), 1.0)
        scale = durations_s[piece] ** order
        for d in range(axes):
            value = 0.0
            for k in range(terms - 1, order - 1, -1):
                value = value * u + factors[k] * coefficients[piece, k, d]
            result[i, d] = value / scale
    return result
