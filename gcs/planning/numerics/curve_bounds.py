"""Proved bounds over a whole piecewise-polynomial curve by adaptive subdivision of its Bernstein form.

Each part of the curve gets a lower and an upper bound; parts that cannot hold the extremum are dropped, the others are
halved. What comes out is a statement about every point of the curve, not about samples.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.errors import InfeasibleError
from gcs.planning.numerics.bernstein import derivative, halve, squared_norm

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from gcs.core.progress import Progress

_MOST_HALVINGS = 40
_CHUNK = 20_000


@dataclass(frozen=True)
class Extremum:
    """A proved bound and where about the extremum is.

    Attributes:
        value: bound that holds over the whole curve; within the tolerance of the true extremum.
        time_s: where on the curve the most extreme value was met; NaN when there is no value.
    """

    value: float
    time_s: float


def least(
    control: NDArray[np.float64],
    durations_s: NDArray[np.float64],
    bounds: Callable[[NDArray[np.float64]], tuple[NDArray[np.float64], NDArray[np.float64]]],
    tolerance: float,
    progress: Progress,
    stage: str = "certificates",
) -> Extremum:
    """Lower bound of a function over a curve.

    Args:
        control: control points of the pieces, shape (S, 8, 3).
        durations_s: of the pieces, shape (S,).
        bounds: gives for parts (B, 8, 3) a lower bound over each part and the value at some point of it (infinity
            where the function is not asked), shape (B,) each.
        tolerance: how far the bound may be under the true minimum.
        progress: told about `stage`, and polled.
        stage: its name.

    Raises:
        InfeasibleError: the bounds do not close.
    """
    parts = control
    starts = np.concatenate([[0.0], np.cumsum(durations_s)[:-1]])
    lengths = np.asarray(durations_s, dtype=np.float64)
    best, where, proved = math.inf, math.nan, math.inf
    for _ in range(_MOST_HALVINGS):
        lower, upper = np.empty(len(parts)), np.empty(len(parts))
        for first in range(0, len(parts), _CHUNK):
            chunk = slice(first, first + _CHUNK)
            lower[chunk], upper[chunk] = bounds(parts[chunk])
            progress.report(stage, 0.5)
        index = int(upper.argmin())
        if upper[index] < best:
            best, where = float(upper[index]), float(starts[index] + lengths[index] / 2)
        open_ = lower < best - tolerance
        proved = min(proved, float(lower[~open_].min(initial=math.inf)))
        if not open_.any():
            return Extremum(proved, where)
        parts = halve(parts[open_])
        lengths = np.repeat(lengths[open_] / 2, 2)
        starts = np.repeat(starts[open_], 2)
        starts[1::2] += lengths[1::2]
    raise InfeasibleError("a bound over the whole curve does not close; this is a defect of the planner")


def lipschitz_bounds(
    distance: Callable[[NDArray[np.float64]], NDArray[np.float64]], sign: float = 1.0
) -> Callable[[NDArray[np.float64]], tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Bounds for `least` of a function of points that changes by at most the distance moved.

    Args:
        distance: of points (N, 3), shape (N,).
        sign: -1 to bound its maximum: the result is then minus that.
    """

    def bounds(parts: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        middle = np.einsum("i,bid->bd", _AT_MIDDLE, parts)
        radius = np.linalg.norm(parts - middle[:, None], axis=2).max(axis=1)
        value = sign * distance(middle)
        return value - radius, value

    return bounds


_AT_MIDDLE = np.array([math.comb(7, i) for i in range(8)]) / 2.0**7


def largest_norm(
    control: NDArray[np.float64], durations_s: NDArray[np.float64], order: int, tolerance: float = 1e-5
) -> Extremum:
    """Upper bound of the norm of a derivative over a curve.

    Args:
        control: control points of the pieces, shape (S, 8, 3).
        durations_s: of the pieces, shape (S,).
        order: 1 speed (m/s), 2 acceleration, 3 jerk.
        tolerance: relative.
    """
    square = squared_norm(derivative(control, order) / durations_s[:, None, None] ** order)[:, :, None]
    starts = np.concatenate([[0.0], np.cumsum(durations_s)[:-1]])
    lengths = np.asarray(durations_s, dtype=np.float64)
    best, where, proved = 0.0, 0.0, 0.0
    for _ in range(_MOST_HALVINGS):
        ends = np.maximum(square[:, 0, 0], square[:, -1, 0])
        index = int(ends.argmax())
        if ends[index] > best:
            best = float(ends[index])
            where = float(starts[index] + (0.0 if square[index, 0, 0] >= square[index, -1, 0] else lengths[index]))
        upper = square.max(axis=(1, 2))
        open_ = upper > best * (1 + tolerance) + 1e-18
        proved = max(proved, float(upper[~open_].max(initial=0.0)))
        if not open_.any():
            return Extremum(math.sqrt(max(proved, 0.0)), where)
        square = halve(square[open_])
        lengths = np.repeat(lengths[open_] / 2, 2)
        starts = np.repeat(starts[open_], 2)
        starts[1::2] += lengths[1::2]
    raise InfeasibleError("a bound over the whole curve does not close; this is a defect of the planner")
