"""Cutting a piecewise polynomial in time, and putting pieces one behind the other."""

from __future__ import annotations

from functools import cache
from math import comb
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.errors import InputError
from gcs.core.trajectory import DEGREE, PiecewisePolynomial

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

SHORTEST_S = 1e-9
"""No piece of a part is shorter: the border before it is left out."""


def motion_at(trajectory: PiecewisePolynomial, time_s: float) -> NDArray[np.float64]:
    """Position, velocity, acceleration and jerk at a time, shape (4, 3)."""
    return np.stack([trajectory.value(time_s, order) for order in range(4)])


def part_of_curve(
    curve: PiecewisePolynomial, begin_s: float, end_s: float, cuts_s: ArrayLike = ()
) -> PiecewisePolynomial:
    """The part of a curve between two times, which starts at its own time 0.

    Args:
        curve: the whole.
        begin_s: where the part begins.
        end_s: where it ends.
        cuts_s: times between these at which pieces of the part are to end besides, shape (n,).

    Raises:
        InputError: the times are not in order, or not on the curve.
    """
    if not 0 <= begin_s < end_s <= curve.duration_s * (1 + 1e-12):
        whole = f"a curve of {curve.duration_s:g} s"
        raise InputError(f"from {begin_s:g} s to {end_s:g} s is no part of {whole}", field="begin_s")
    inside = np.concatenate([curve.starts_s, np.asarray(cuts_s, dtype=np.float64)])
    borders = np.unique(np.concatenate([[begin_s, end_s], inside[(inside > begin_s) & (inside < end_s)]]))
    borders = borders[np.append(np.diff(borders) > SHORTEST_S, True)]
    durations = np.diff(borders)
    piece = np.searchsorted(curve.starts_s, borders[:-1] + durations / 2, side="right") - 1
    shift = (borders[:-1] - curve.starts_s[piece]) / curve.durations_s[piece]
    scale = durations / curve.durations_s[piece]
    return PiecewisePolynomial(_affine(shift, scale) @ curve.coefficients[piece], durations)


def joined_curves(*curves: PiecewisePolynomial) -> PiecewisePolynomial:
    """Curves one behind the other in time; whether they join smoothly is theirs to know."""
    return PiecewisePolynomial(
        np.concatenate([curve.coefficients for curve in curves]),
        np.concatenate([curve.durations_s for curve in curves]),
    )


def _affine(shift: NDArray[np.float64], scale: NDArray[np.float64]) -> NDArray[np.float64]:
    """Matrices from the coefficients of p(u) to those of p(shift + scale u), lowest power first, shape (n, 8, 8)."""
    powers = np.arange(DEGREE + 1)
    lower = np.maximum(powers[None, :] - powers[:, None], 0)
    return np.asarray(_binomials() * shift[:, None, None] ** lower * (scale[:, None] ** powers)[:, :, None])


@cache
def _binomials() -> NDArray[np.float64]:
    """`C(k, i)` in row i and column k."""
    return np.array([[comb(k, i) for k in range(DEGREE + 1)] for i in range(DEGREE + 1)], dtype=np.float64)
