"""The time-optimal profile along a given curve: how quickly the same way could be flown under the same limits.

With w the squared speed at nodes of arc length s, the acceleration between two nodes is `t dw / (2 ds) + k w`, t being
the tangent and k the curvature vector: linear in w. Speed and acceleration limits and the time are convex in w, a
second-order cone program. The jerk is the difference of neighbouring accelerations over the time between them,
`ds / sqrt(w)`; this bound is convex where it should be concave, so it is replaced by its tangent at the profile before,
which only makes it tighter, and the program is solved again until the time stays (Consolini and Locatelli's way).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy import sparse

from gcs.core.errors import InfeasibleError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from gcs.core.trajectory import PiecewisePolynomial
    from gcs.planning.trajectories.time_allocation import FlightLimits

Matrix = sparse.csr_matrix
NODES = 400
ROUNDS = 40
SETTLED = 1e-4
"""The rounds end when the time falls by less than this share."""

_FINE = 20
"""Points for each node from which the curve's arc length and directions are taken."""


def time_optimal_s(
    trajectory: PiecewisePolynomial, limits: FlightLimits, nodes: int = NODES, slow: Sequence[tuple[float, float]] = ()
) -> float:
    """Least time (s) along a curve from rest to rest.

    Args:
        trajectory: the curve; its own speed is only the first guess of the profile's shape.
        limits: norms of speed, acceleration and jerk.
        nodes: of the discretisation.
        slow: places by their time on the trajectory, and how fast each may be passed (m/s).

    Raises:
        InfeasibleError: the cone program is not solved.
    """
    # In units in which the curve's length and its own duration are 1.
    s, at, tangent, curvature, w = _geometry(trajectory, nodes)
    second, metre = trajectory.duration_s, float(s[-1])
    s, curvature, w = s / metre, curvature * metre, 0.3 * w * (second / metre) ** 2
    most = np.full(nodes + 1, limits.speed_m_s)
    for time, speed_m_s in slow:
        node = int(np.abs(at - time).argmin())
        most[node] = min(most[node], speed_m_s)
    speed, acceleration = most * second / metre, limits.acceleration_m_s2 * second**2 / metre
    if limits.jerk_m_s3 is None:
        return second * _time(s, _solve(s, tangent, curvature, (speed, acceleration, None), w))
    jerk = limits.jerk_m_s3 * second**3 / metre
    best = np.inf
    for _ in range(ROUNDS):
        w = _solve(s, tangent, curvature, (speed, acceleration, jerk), w)
        time = _time(s, w)
        if time > best * (1 - SETTLED):
            break
        best = time
    return second * min(time, best)


def _geometry(trajectory: PiecewisePolynomial, nodes: int) -> tuple[NDArray[np.float64], ...]:
    """Nodes by arc length, denser at both ends, their times, the tangents and curvature vectors between, and speeds."""
    t = np.linspace(0.0, trajectory.duration_s, nodes * _FINE + 1)
    velocity = trajectory.value(t, 1)
    speed = np.linalg.norm(velocity, axis=1)
    length = np.concatenate([[0.0], np.cumsum((speed[1:] + speed[:-1]) / 2 * np.diff(t))])
    x = np.linspace(0.0, 1.0, nodes + 1)
    s = x * x * (3 - 2 * x) * length[-1]
    # Arc length is flat in time at rest: the points there are looked up in the middle of their interval.
    at = np.interp(s, length, t)
    middle = np.interp((s[1:] + s[:-1]) / 2, length, t)
    v, a = trajectory.value(middle, 1), trajectory.value(middle, 2)
    norm = np.maximum(np.linalg.norm(v, axis=1), 1e-9)
    tangent = v / norm[:, None]
    across = a - (a * tangent).sum(axis=1)[:, None] * tangent
    curvature = across / norm[:, None] ** 2
    return s, at, tangent, curvature, np.linalg.norm(trajectory.value(at, 1), axis=1) ** 2


def _time(s: NDArray[np.float64], w: NDArray[np.float64]) -> float:
    root = np.sqrt(np.maximum(w, 0.0))
    return float((2 * np.diff(s) / np.maximum(root[1:] + root[:-1], 1e-12)).sum())


class _Cones:
    """Constraints `A x + slack = b` with the slack in cones, gathered block by block."""

    def __init__(self) -> None:
        self._rows: list[Matrix] = []
        self._bounds: list[NDArray[np.float64]] = []
        self._sizes: list[tuple[int, int]] = []

    def norm(self, offset: NDArray[np.float64], top: Matrix, parts: Sequence[Matrix]) -> None:
        """`|(parts x + shifts)| <= offset + top x`, row by row; every part has as many rows as the offset."""
        self.shifted_norm(offset, top, [(part, 0.0) for part in parts])

    def shifted_norm(self, offset: NDArray[np.float64], top: Matrix, parts: Sequence[tuple[Matrix, float]]) -> None:
        """The same with a number added to each part."""
        count, size = len(offset), 1 + len(parts)
        order = np.arange(size * count).reshape(size, count).T.ravel()
        self._rows.append(sparse.vstack([-top, *(-part for part, _ in parts)], format="csr")[order])
        shifts = [np.full(count, shift) for _, shift in parts]
        self._bounds.append(np.stack([offset, *shifts], axis=1).ravel())
        self._sizes.append((size, count))

    def minimise(self, cost: NDArray[np.float64], upper: NDArray[np.float64]) -> NDArray[np.float64]:
        """The x of least cost with the first entries at most `upper`."""
        import clarabel

        most = sparse.eye(len(upper), len(cost), format="csr")
        cones: list[object] = [clarabel.NonnegativeConeT(len(upper))]
        for size, count in self._sizes:
            cones += [clarabel.SecondOrderConeT(size)] * count
        settings = clarabel.DefaultSettings()
        settings.verbose = False
        settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-7
        matrix = sparse.vstack([most, *self._rows], format="csc")
        quadratic = sparse.csc_matrix((len(cost), len(cost)))
        bounds = np.concatenate([upper, *self._bounds])
        answer = clarabel.DefaultSolver(quadratic, cost, matrix, bounds, cones, settings).solve()
        if answer.status not in (clarabel.SolverStatus.Solved, clarabel.SolverStatus.AlmostSolved):
            raise InfeasibleError(f"the time-optimal profile is not found: {answer.status}")
        return np.array(answer.x)


def _solve(
    s: NDArray[np.float64],
    tangent: NDArray[np.float64],
    curvature: NDArray[np.float64],
    limits: tuple[NDArray[np.float64], float, float | None],
    before: NDArray[np.float64],
) -> NDArray[np.float64]:
    """One cone program; unknowns are w at the inner nodes, their roots y, and the inverse speeds of the gaps.

    The limit of the speed is given for each node.
    """
    speed, most, jerk = limits
    gaps = np.diff(s)
    n = len(gaps)
    inner = n - 1
    columns = 2 * inner + n
    # w, y and the inverse speed; of a gap, w and y at its right and its left end.
    squares, roots = sparse.eye(inner, columns, format="csr"), sparse.eye(inner, columns, k=inner, format="csr")
    inverse = sparse.eye(n, columns, k=2 * inner, format="csr")
    right, left = sparse.eye(n, inner, format="csr"), sparse.eye(n, inner, k=-1, format="csr")
    slope, mean = (right - left) @ squares, (right + left) @ squares / 2
    acceleration = [
        sparse.csr_matrix(sparse.diags(tangent[:, d] / (2 * gaps)) @ slope + sparse.diags(curvature[:, d]) @ mean)
        for d in range(3)
    ]
    cones = _Cones()
    cones.norm(np.full(n, most), 0 * inverse, acceleration)
    if jerk is not None:
        root = np.sqrt(np.maximum(before, 1e-12))
        root[[0, -1]] = 0.0
        # The time of a gap, 2 ds / (v_left + v_right), and its tangent in w.
        spent = 2 * gaps / (root[1:] + root[:-1])
        turn = sparse.diags(-spent / (root[1:] + root[:-1])) @ (right + left) @ sparse.diags(0.5 / root[1:-1])
        flat = spent - turn @ before[1:-1]
        average = (sparse.eye(inner, n, format="csr") + sparse.eye(inner, n, k=1, format="csr")) / 2
        step = sparse.eye(inner, n, k=1, format="csr") - sparse.eye(inner, n, format="csr")
        steps = [sparse.csr_matrix(step @ part) for part in acceleration]
        cones.norm(jerk * (average @ flat), sparse.csr_matrix(average @ turn @ squares * jerk), steps)
        # From rest under constant jerk J the mean acceleration of the first gap is 9/4 J s / v; likewise at the end.
        ends, nodes = np.array([0, n - 1]), np.array([0, inner - 1])
        edge = 2.25 * jerk * gaps[ends] / root[1:-1][nodes]
        falling = sparse.csr_matrix(sparse.diags(-0.5 * edge / before[1:-1][nodes]) @ squares[nodes])
        cones.norm(1.5 * edge, falling, [part[ends] for part in acceleration])
    # y^2 <= w as |(2 y, w - 1)| <= w + 1, and `inverse (y_left + y_right) >= 1` likewise.
    cones.shifted_norm(np.ones(inner), squares, [(2 * roots, 0.0), (squares, -1.0)])
    total = sparse.csr_matrix((left + right) @ roots)
    cones.shifted_norm(np.zeros(n), total + inverse, [(0 * inverse, 2.0), (inverse - total, 0.0)])
    found = cones.minimise(np.concatenate([np.zeros(2 * inner), 2 * gaps]), speed[1:-1] ** 2)
    return np.concatenate([[0.0], np.maximum(found[:inner], 0.0), [0.0]])
