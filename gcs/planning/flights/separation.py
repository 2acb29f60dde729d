"""How far apart several vehicles stay, proved over the whole time.

The difference of two piecewise polynomials is one as well, on the breakpoints of both. Its distance from the origin is
bounded by adaptive subdivision (`curve_bounds`), so nothing falls between samples. Before its start a
vehicle rests at its first point, after its end at its last one.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from math import comb
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.trajectory import DEGREE
from gcs.planning.numerics.bernstein import control_from_monomial
from gcs.planning.numerics.curve_bounds import least, lipschitz_bounds

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from gcs.core.progress import Progress
    from gcs.core.trajectory import PiecewisePolynomial

TOLERANCE_M = 0.005
"""How far the bound may be under the true distance."""

_BRIEF_S = 1e-9


@dataclass(frozen=True, eq=False)
class TimedCurve:
    """A curve on the clock of several vehicles.

    Attributes:
        trajectory: at rest at both ends.
        start_s: when it starts.
    """

    trajectory: PiecewisePolynomial
    start_s: float

    @property
    def end_s(self) -> float:
        """When it ends."""
        return self.start_s + self.trajectory.duration_s

    def position(self, t_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Positions (m) at times (s) of the common clock, shapes (...) -> (..., 3)."""
        return self.trajectory.value(t_s - self.start_s)


@dataclass(frozen=True)
class Separation:
    """The nearest that two of several vehicles come.

    Attributes:
        distance_m: bound that holds at every moment; at most `TOLERANCE_M` under the true distance.
        time_s: about when, on the common clock.
        pair: which two, by number.
    """

    distance_m: float
    time_s: float
    pair: tuple[int, int]


def least_separation(curves: Sequence[TimedCurve], progress: Progress) -> Separation:
    """Bound the distance between the centres of any two vehicles over all time.

    Args:
        curves: two or more.
        progress: told about the stage `separation`; may cancel.
    """
    nearest: list[Separation] = []
    for a, b in itertools.combinations(range(len(curves)), 2):
        start, control, durations = _difference(curves[a], curves[b])
        found = least(control, durations, _distance_bounds, TOLERANCE_M, progress, "separation")
        nearest.append(Separation(found.value, start + found.time_s, (a, b)))
    return min(nearest, key=lambda one: one.distance_m)


_distance_bounds = lipschitz_bounds(lambda points: np.asarray(np.linalg.norm(points, axis=1)))


def _difference(a: TimedCurve, b: TimedCurve) -> tuple[float, NDArray[np.float64], NDArray[np.float64]]:
    """Start, control points (S, 8, 3) and durations (S,) of where a is, seen from b, while one of them moves."""
    times = np.unique(np.concatenate([a.start_s + a.trajectory.starts_s, b.start_s + b.trajectory.starts_s]))
    times = times[np.concatenate([[True], np.diff(times) > _BRIEF_S])]
    pieces = _pieces_between(a, times) - _pieces_between(b, times)
    return float(times[0]), control_from_monomial(pieces), np.diff(times)


def _pieces_between(curve: TimedCurve, times: NDArray[np.float64]) -> NDArray[np.float64]:
    """Monomial coefficients (S, 8, 3) of a curve on the intervals between times, each on its own [0, 1]."""
    trajectory = curve.trajectory
    middle = (times[:-1] + times[1:]) / 2 - curve.start_s
    segment = np.clip(
        np.searchsorted(trajectory.starts_s, middle, side="right") - 1, 0, len(trajectory.durations_s) - 1
    )
    duration = trajectory.durations_s[segment]
    from_ = (times[:-1] - curve.start_s - trajectory.starts_s[segment]) / duration
    width = np.diff(times) / duration
    resting = (middle < 0) | (middle > trajectory.duration_s)
    from_ = np.where(resting, np.where(middle < 0, 0.0, 1.0), from_)
    width = np.where(resting, 0.0, width)
    result = np.zeros((len(segment), DEGREE + 1, 3))
    for k in range(DEGREE + 1):
        for j in range(k, DEGREE + 1):
            result[:, k] += (comb(j, k) * from_ ** (j - k) * width**k)[:, None] * trajectory.coefficients[segment, j]
    return result
