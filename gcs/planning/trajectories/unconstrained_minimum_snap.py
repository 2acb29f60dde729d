"""Curves of least snap, jerk or acceleration through points at given times, without constraints between the points.

The free derivatives at the joints have a closed form (Richter, Bry and Roy 2016; equations 7-14 of the gantry-crane
paper). Joints only touch their neighbours, so the system is block-tridiagonal and is solved in time linear in the
number of segments. With m the order of the minimised derivative, every piece has degree 2 m - 1, and 2 m - 2
derivatives are continuous at the joints: with least snap velocity, acceleration, jerk and three more.

Segments are numbered from 0; points too: segment s goes from point s to point s + 1.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property
from math import comb, factorial, perm
from typing import TYPE_CHECKING, Literal

import numpy as np

from gcs.core.errors import InputError
from gcs.core.trajectory import DEGREE, PiecewisePolynomial
from gcs.planning.numerics.block_tridiagonal import least_derivative_coefficients

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike, NDArray

    EndDerivatives = Sequence[ArrayLike | None]

SNAP, JERK, ACCELERATION = 4, 3, 2

MOST_UNEVEN = 1e4
"""Longest over shortest segment time that is solved: beyond it double precision does not give the cost to 1e-9."""


@dataclass(frozen=True, eq=False)
class Spline:
    """A curve of least squared derivative through points.

    Attributes:
        coefficients: on segment s `p = sum_k coefficients[s, k] u**k`, `u = (t - t_s) / T_s`, shape (S, 2 m, D), in the
            points' unit (m or rad).
        durations_s: T, shape (S,); the curve starts at t = 0.
    """

    coefficients: NDArray[np.float64]
    durations_s: NDArray[np.float64]

    @property
    def order(self) -> int:
        """Order m of the minimised derivative: 2 acceleration, 3 jerk, 4 snap."""
        return int(self.coefficients.shape[1]) // 2

    @cached_property
    def starts_s(self) -> NDArray[np.float64]:
        """Start time of every segment and the end of the last, shape (S + 1,)."""
        return np.concatenate([[0.0], np.cumsum(self.durations_s)])

    def value(self, t_s: ArrayLike, derivative: int = 0) -> NDArray[np.float64]:
        """The curve or one of its derivatives with respect to time.

        Args:
            t_s: times (s), shape (...); held at the ends outside the curve.
            derivative: 0 the curve itself, 1 its velocity, ...

        Returns:
            Shape (..., D).
        """
        t = np.clip(np.asarray(t_s, dtype=np.float64), 0.0, self.starts_s[-1])
        segment = np.clip(np.searchsorted(self.starts_s, t, side="right") - 1, 0, len(self.durations_s) - 1)
        duration = self.durations_s[segment][..., None]
        u = (t - self.starts_s[segment])[..., None] / duration
        result = np.zeros((*t.shape, self.coefficients.shape[2]))
        for k in range(self.coefficients.shape[1] - 1, derivative - 1, -1):
            result = result * u + perm(k, derivative) * self.coefficients[segment, k]
        return np.asarray(result / duration**derivative)

    @cached_property
    def segment_costs(self) -> NDArray[np.float64]:
        """Integral of the squared m-th derivative over each segment, summed over the axes, shape (S,)."""
        m = self.order
        upper = self.coefficients[:, m:] * np.array([perm(k, m) for k in range(m, 2 * m)])[:, None]
        # A sum of squares: nothing cancels.
        parts = _cost_root(m) @ upper
        return np.asarray((parts * parts).sum(axis=(1, 2)) * self.durations_s ** (1.0 - 2 * m))

    @cached_property
    def cost(self) -> float:
        """Integral of the squared m-th derivative over the whole curve (unit^2 / s^(2 m - 1)), all axes."""
        return float(self.segment_costs.sum())

    @cached_property
    def cost_gradient(self) -> NDArray[np.float64]:
        """Derivative of the least cost with respect to each segment time, shape (S,).

        The free derivatives are at their optimum, so they add nothing to first order: what is left is the derivative
        of each segment's own cost between fixed end states, which is minus its Hamiltonian,
        `x_m^2 - 2 sum_k (-1)^(m - k) x_(2 m - k) x_k` with x_k the k-th derivative with respect to time, k = 1 .. m.
        It is the same at every point of the segment.
        """
        m = self.order
        c = self.coefficients
        value = (factorial(m) * c[:, m]) ** 2
        for k in range(1, m + 1):
            value -= 2 * (-1) ** (m - k) * (factorial(2 * m - k) * c[:, 2 * m - k]) * (factorial(k) * c[:, k])
        return np.asarray(value.sum(axis=1) * self.durations_s ** (-2.0 * m))

    def piecewise_polynomial(self) -> PiecewisePolynomial:
        """The same curve as a trajectory; it must have three axes."""
        segments, terms, axes = self.coefficients.shape
        if axes != 3:
            raise InputError(f"a trajectory has three axes, this curve has {axes}", field="points_m")
        coefficients = np.zeros((segments, DEGREE + 1, 3))
        coefficients[:, :terms] = self.coefficients
        return PiecewisePolynomial(coefficients, self.durations_s)


def minimum_snap_spline(
    points_m: ArrayLike,
    durations_s: ArrayLike,
    start: EndDerivatives | None = None,
    end: EndDerivatives | None = None,
) -> Spline:
    """The curve through points at given times with the least integral of squared snap.

    Args:
        points_m: shape (S + 1, D), m. Neighbours must differ: the curve swings about a repeated point instead of
            holding there, so a hold is a stop between two curves.
        durations_s: of the segments, shape (S,).
        start: velocity, acceleration and jerk at the first point (m/s^k), each a number or of shape (D,), or None where
            it is free; at rest when not given.
        end: the same at the last point.

    Raises:
        InputError: fewer than two points, a repeated point, a time that is not positive, a number that is not finite,
            times too uneven, or end derivatives that leave the curve undetermined; it names the segment.
    """
    return _solve(_distinct(_points(points_m)), durations_s, SNAP, start, end)


def minimum_jerk_spline(
    points_m: ArrayLike,
    durations_s: ArrayLike,
    start: EndDerivatives | None = None,
    end: EndDerivatives | None = None,
) -> Spline:
    """The curve through points at given times with the least integral of squared jerk.

    Args:
        points_m: as of `minimum_snap_spline`.
        durations_s: of the segments, shape (S,).
        start: velocity and acceleration at the first point, as of `minimum_snap_spline`.
        end: the same at the last point.

    Raises:
        InputError: as of `minimum_snap_spline`.
    """
    return _solve(_distinct(_points(points_m)), durations_s, JERK, start, end)


def yaw_spline(
    yaw_rad: ArrayLike,
    durations_s: ArrayLike,
    minimised: Literal["acceleration", "jerk"] = "acceleration",
    start: EndDerivatives | None = None,
    end: EndDerivatives | None = None,
) -> Spline:
    """Yaw through angles at given times with the least integral of squared angular acceleration or jerk.

    Args:
        yaw_rad: shape (S + 1,); each turn goes the short way round. Angles may repeat.
        durations_s: of the segments, shape (S,).
        minimised: which derivative.
        start: the rate, and with jerk the angular acceleration, at the first angle (rad/s^k), or None where it is free;
            at rest when not given.
        end: the same at the last angle.

    Returns:
        One axis, unwrapped: the values go on beyond +-pi.

    Raises:
        InputError: as of `minimum_snap_spline`; angles may repeat.
    """
    angles = _finite(np.asarray(yaw_rad, dtype=np.float64).reshape(-1, 1), "yaw_rad")
    orders = {"acceleration": ACCELERATION, "jerk": JERK}
    return _solve(np.unwrap(angles, axis=0), durations_s, orders[minimised], start, end)


def _solve(
    points: NDArray[np.float64],
    durations_s: ArrayLike,
    order: int,
    start: EndDerivatives | None,
    end: EndDerivatives | None,
) -> Spline:
    durations = _durations(durations_s, len(points) - 1)
    mean = durations.mean()
    start_marks, start_values = _end_derivatives(start, order, points.shape[1], mean, "start")
    end_marks, end_values = _end_derivatives(end, order, points.shape[1], mean, "end")
    _check_determined(durations, order, start_marks, end_marks)
    unit_cost, upper = _unit_segment(order)
    coefficients = least_derivative_coefficients(
        unit_cost, upper, points, durations / mean, start_marks, start_values, end_marks, end_values
    )
    if not np.isfinite(coefficients).all():
        segment = int(np.argmin(np.isfinite(coefficients).all(axis=(1, 2))))
        raise InputError(f"segment {segment}: the numbers are too large to compute with", field="points")
    return Spline(coefficients, durations)


def _points(points_m: ArrayLike) -> NDArray[np.float64]:
    points = np.ascontiguousarray(points_m, dtype=np.float64)
    if points.ndim != 2:
        raise InputError(f"points are rows of coordinates, shape (N, D), not {points.shape}", field="points_m")
    return _finite(points, "points_m")


def _finite(points: NDArray[np.float64], field: str) -> NDArray[np.float64]:
    if len(points) < 2:
        raise InputError(f"a curve needs at least two points, there is {len(points) or 'none'}", field=field)
    finite = np.isfinite(points)
    if not finite.all():
        bad = int(np.argmin(finite.all(axis=1)))
        raise InputError(f"segment {max(bad - 1, 0)}: point {bad} is not a finite number", field=field)
    return points


def _distinct(points: NDArray[np.float64]) -> NDArray[np.float64]:
    same = (points[1:] == points[:-1]).all(axis=1)
    if same.any():
        bad = int(np.argmax(same))
        raise InputError(
            f"segment {bad} has no length: points {bad} and {bad + 1} are one place; leave one out, or hold there",
            field="points_m",
        )
    return points


def _durations(durations_s: ArrayLike, segments: int) -> NDArray[np.float64]:
    durations = np.array(durations_s, dtype=np.float64)
    if durations.shape != (segments,):
        raise InputError(
            f"{segments + 1} points make {segments} segments, but the times have shape {durations.shape}",
            field="durations_s",
        )
    low, high = int(durations.argmin()), int(durations.argmax())
    # A NaN is found by both.
    if not (durations[low] > 0 and durations[high] < np.inf):
        good = (durations > 0) & (durations < np.inf)
        bad = int(np.argmin(good))
        raise InputError(
            f"segment {bad} lasts {durations[bad]:g} s; every segment needs a positive time", field="durations_s"
        )
    if durations[high] > MOST_UNEVEN * durations[low]:
        raise InputError(
            f"segment {low} lasts {durations[low]:g} s and segment {high} {durations[high]:g} s; more than "
            f"{MOST_UNEVEN:g} times is too uneven to solve exactly: split the long one or solve in parts",
            field="durations_s",
        )
    return durations


def _end_derivatives(
    derivatives: EndDerivatives | None, order: int, axes: int, unit_s: float, field: str
) -> tuple[tuple[bool, ...], NDArray[np.float64]]:
    """Marks of those that are given, and their values with the time in `unit_s`, shape (m - 1, D)."""
    values = np.zeros((order - 1, axes))
    if derivatives is None:
        return (True,) * (order - 1), values
    names = ("velocity", "acceleration", "jerk")[: order - 1]
    if len(derivatives) != order - 1:
        raise InputError(f"give {', '.join(names)} (None where free), not {len(derivatives)} values", field=field)
    for k, (name, given) in enumerate(zip(names, derivatives, strict=True), start=1):
        if given is None:
            continue
        value = np.asarray(given, dtype=np.float64)
        if value.shape not in {(), (axes,)} or not np.isfinite(value).all():
            raise InputError(f"the {name} must be a finite number or one for each of {axes} axes", field=field)
        values[k - 1] = value * unit_s**k
    return tuple(given is not None for given in derivatives), values


def _check_determined(
    durations: NDArray[np.float64], order: int, start_marks: tuple[bool, ...], end_marks: tuple[bool, ...]
) -> None:
    """A polynomial of degree under m costs nothing: none but zero may vanish wherever something is given."""
    if len(durations) + 1 >= order or all(start_marks) or all(end_marks):
        return
    times = np.concatenate([[0.0], np.cumsum(durations)]) / durations.sum()
    given = [(time, 0) for time in times]
    given += [(0.0, k) for k, mark in enumerate(start_marks, start=1) if mark]
    given += [(1.0, k) for k, mark in enumerate(end_marks, start=1) if mark]
    rows = [[perm(j, k) * time ** max(j - k, 0) for j in range(order)] for time, k in given]
    if np.linalg.matrix_rank(np.array(rows)) < order:
        raise InputError(
            f"segments 0 to {len(durations) - 1} leave the curve undetermined: give more points or end derivatives",
            field="start",
        )


@cache
def _cost_root(order: int) -> NDArray[np.float64]:
    """Matrix R with `integral of (sum_j a_j u^j)^2 over [0, 1] = |R a|^2`, shape (m, m)."""
    gram = np.array([[1 / (i + j + 1) for j in range(order)] for i in range(order)])
    return np.asarray(np.linalg.cholesky(gram).T)


@cache
def _unit_segment(order: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Cost and upper coefficients of a segment of unit time, see `least_derivative_coefficients`.

    By Hermite's interpolation: a derivative `x_k` at the start gives the polynomial
    `x_k u^k / k! (1 - u)^m sum_j C(m - 1 + j, j) u^j`, j = 0 .. m - 1 - k; one at the end the same in `1 - u`, with the
    sign `(-1)^k`.
    """
    m = order
    hermite = np.zeros((2 * m, 2 * m))
    u = np.polynomial.Polynomial([0.0, 1.0])
    for k in range(m):
        base = sum((comb(m - 1 + j, j) * u**j for j in range(m - k)), 0 * u)
        start = u**k / factorial(k) * (1 - u) ** m * base
        hermite[: len(start.coef), k] = start.coef
        end = (-1) ** k * start(1 - u)
        hermite[: len(end.coef), m + k] = end.coef
    # Multiples of 1 / (m - 1)!, and the costs are whole numbers: rounded to what they are.
    upper = np.rint(hermite[m:] * factorial(m - 1)) / factorial(m - 1)
    root = _cost_root(m) @ (np.array([perm(k, m) for k in range(m, 2 * m)])[:, None] * upper)
    return np.rint(root.T @ root), np.ascontiguousarray(upper)
