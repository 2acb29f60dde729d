"""Standing still, as a curve."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gcs.core.trajectory import DEGREE, PiecewisePolynomial

if TYPE_CHECKING:
    from numpy.typing import NDArray


def hover(place_m: NDArray[np.float64]) -> PiecewisePolynomial:
    """Standing still at a place (3,) for a second; curves rest at their ends."""
    coefficients = np.zeros((1, DEGREE + 1, 3))
    coefficients[0, 0] = place_m
    return PiecewisePolynomial(coefficients, np.ones(1))
