"""Minimum-snap curves of degree 7 inside corridors, from rest to rest (Mellinger and Kumar 2011; Richter et al. 2016).

The unknowns are the states at the joints (position, velocity, acceleration, jerk), so the curve is C^3 by
construction. In each state the Bernstein control points of the pieces on both sides are linear: four of the left piece
depend on it, and four of the right piece. Keeping them in the boxes proves the corridor for the whole curve. The axes
do not touch each other, and legs between stops neither: all legs make one sparse problem an axis.

Every leg is solved in its own mean segment time, about the curve that interpolates its joints, with the cost divided by
that curve's cost and the unknowns scaled to a unit diagonal. Without this the cost is a small difference of numbers
that grow with the seventh power of the segment count.
"""

from __future__ import annotations

from math import comb
from typing import TYPE_CHECKING

import numpy as np
from scipy import sparse
from scipy.linalg import solveh_banded

from gcs.planning.numerics.bernstein import CONTROL_FROM_END, CONTROL_FROM_START
from gcs.planning.numerics.qp_solver import QpProblem, SolverError, solve_checked

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from gcs.planning.numerics.qp_solver import QpSolver
    from gcs.planning.trajectories.safe_corridor import LegCorridor

BOX_INSET_M = 1e-6
"""The solver gets boxes this much smaller, so that its rounding never leaves the true ones."""

COST_FLOOR_M = 1e-2
"""Axes on which a leg hardly moves have their cost divided by that of a move of this length."""


def _unit_cost() -> NDArray[np.float64]:
    """Integral of squared snap of a piece of unit duration, as a quadratic form of its end states, shape (8, 8)."""
    control = np.zeros((8, 8))
    control[:4, :4], control[4:, 4:] = CONTROL_FROM_START, CONTROL_FROM_END
    snap = 7 * 6 * 5 * 4 * np.diff(np.eye(8), 4, axis=0) @ control
    gram = np.array([[comb(3, i) * comb(3, j) / comb(6, i + j) / 7 for j in range(4)] for i in range(4)])
    return np.asarray(snap.T @ gram @ snap)


UNIT_COST = _unit_cost()


def rest_to_rest_cost(length_m: float, duration_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Least integral of squared snap (m^2/s^7) of a straight move from rest to rest: `100800 L^2 / T^7`."""
    return np.asarray(100800.0 * length_m**2 / duration_s**7)


def snap_cost(control: NDArray[np.float64], durations_s: NDArray[np.float64]) -> float:
    """Integral of squared snap (m^2/s^7) of pieces given by control points (S, 8, 3)."""
    snap = 840 * np.diff(control, 4, axis=1)
    gram = np.array([[comb(3, i) * comb(3, j) / comb(6, i + j) / 7 for j in range(4)] for i in range(4)])
    return float(np.einsum("sid,ij,sjd,s->", snap, gram, snap, durations_s**-7.0))


def minimum_snap(
    legs: Sequence[LegCorridor], durations_s: Sequence[NDArray[np.float64]], solvers: Sequence[QpSolver]
) -> list[NDArray[np.float64]]:
    """Curves of least snap through corridors, from rest to rest.

    Args:
        legs: corridors from stop to stop.
        durations_s: segment times of each leg, shape (n,) each.
        solvers: the first is tried on all legs together, then on ever smaller groups; the others on single legs.

    Returns:
        Control points of each leg's pieces, scene ENU m, shape (n, 8, 3) each.

    Raises:
        SolverError: no solver gives an answer with small residuals; it names the leg.
    """
    curves = []
    for curve in solve_legs(legs, durations_s, solvers):
        if isinstance(curve, SolverError):
            raise curve
        curves.append(curve)
    return curves


def solve_legs(
    legs: Sequence[LegCorridor], durations_s: Sequence[NDArray[np.float64]], solvers: Sequence[QpSolver]
) -> list[NDArray[np.float64] | SolverError]:
    """`minimum_snap` with the error of a leg that has no answer in the place of its curve."""
    return _solve_group(list(zip(range(len(legs)), legs, durations_s, strict=True)), solvers) if legs else []


def _solve_group(
    group: list[tuple[int, LegCorridor, NDArray[np.float64]]], solvers: Sequence[QpSolver]
) -> list[NDArray[np.float64] | SolverError]:
    alone = len(group) == 1
    try:
        stack = _Stack([leg for _, leg, _ in group], [durations for _, _, durations in group])
        return [*stack.solve(solvers if alone else solvers[:1])]
    except SolverError as error:
        if alone:
            return [SolverError(f"leg {group[0][0]}: {error.message}")]
    half = len(group) // 2
    return _solve_group(group[:half], solvers) + _solve_group(group[half:], solvers)


class _Stack:
    """Legs side by side in one problem, each in units of its own mean segment time.

    Joints are numbered over all legs; joint j holds the state `states[j]`, shape (4, 3). Segment s goes from joint
    `start[s]` to joint `start[s] + 1`.
    """

    def __init__(self, legs: Sequence[LegCorridor], durations_s: Sequence[NDArray[np.float64]]) -> None:
        counts = np.array([len(durations) for durations in durations_s])
        self._leg = np.repeat(np.arange(len(legs)), counts)
        self._start = np.arange(counts.sum()) + self._leg
        self._first_segment = np.concatenate([[0], np.cumsum(counts)[:-1]])
        ratio = np.concatenate([durations / durations.mean() for durations in durations_s])
        self._powers = ratio[:, None] ** np.arange(4)
        both = np.tile(self._powers, 2)
        self._blocks = UNIT_COST * both[:, :, None] * both[:, None, :] / ratio[:, None, None] ** 7
        joints = np.concatenate([leg.joints_m for leg in legs])
        self._states = np.zeros((len(joints), 4, 3))
        self._states[:, 0] = joints
        # The inner joints are those that end one segment and start another of the same leg.
        self._left = np.flatnonzero(self._leg[:-1] == self._leg[1:])
        self._inner = self._start[self._left] + 1
        if not len(self._inner):
            return
        self._interpolate()
        product = self._products()
        cost = np.add.reduceat(np.einsum("skd,skd->sd", self._ends(), product), self._first_segment)
        self._scale = np.maximum(cost, rest_to_rest_cost(COST_FLOOR_M, counts.astype(np.float64))[:, None])
        self._gradient = product[self._left, 4:] + product[self._left + 1, :4]
        self._constrain(np.concatenate([leg.boxes_m for leg in legs]))

    def _ends(self) -> NDArray[np.float64]:
        """States at the start and the end of every segment, shape (S, 8, 3)."""
        return np.concatenate([self._states[self._start], self._states[self._start + 1]], axis=1)

    def _products(self) -> NDArray[np.float64]:
        """The cost's gradient with respect to every segment's ends, shape (S, 8, 3)."""
        return np.asarray(self._blocks @ self._ends())

    def _interpolate(self) -> None:
        """Fill in the velocities, accelerations and jerks of the least-snap curve through all joints."""
        product = self._products()
        right = -(product[self._left, 5:] + product[self._left + 1, 1:4])
        diagonal = self._blocks[self._left, 5:, 5:] + self._blocks[self._left + 1, 1:4, 1:4]
        linked = np.flatnonzero(np.diff(self._left) == 1)
        link = self._blocks[self._left[linked] + 1, 1:4, 5:]
        band = np.zeros((6, 3 * len(self._inner)))
        for row in range(3):
            for column in range(3):
                if column >= row:
                    band[5 + row - column, column::3] = diagonal[:, row, column]
                band[2 + row - column, 3 * (linked + 1) + column] = link[:, row, column]
        solution = solveh_banded(band, right.reshape(-1, 3))
        self._states[self._inner, 1:] = solution.reshape(-1, 3, 3)

    def _constrain(self, boxes: NDArray[np.float64]) -> None:
        """Seven control points hang on each inner joint: three of the left piece, three of the right, and itself."""
        count = len(self._inner)
        block = np.zeros((count, 7, 4))
        block[:, :3] = CONTROL_FROM_END[:3] * self._powers[self._left, None, :]
        block[:, 3:6] = CONTROL_FROM_START[1:] * self._powers[self._left + 1, None, :]
        block[:, 6, 0] = 1.0
        rows = np.broadcast_to(7 * np.arange(count)[:, None, None] + np.arange(7)[:, None], block.shape)
        columns = np.broadcast_to(4 * np.arange(count)[:, None, None] + np.arange(4), block.shape)
        shape = (7 * count, 4 * count)
        self._constraints = sparse.coo_matrix((block.ravel(), (rows.ravel(), columns.ravel())), shape=shape).tocsc()
        left, right = boxes[self._left], boxes[self._left + 1]
        shared = np.stack([np.maximum(left[:, 0], right[:, 0]), np.minimum(left[:, 1], right[:, 1])], axis=1)
        limits = np.concatenate([left[:, None].repeat(3, 1), right[:, None].repeat(3, 1), shared[:, None]], axis=1)
        value = block @ self._states[self._inner]
        self._low = limits[:, :, 0] + BOX_INSET_M - value
        self._high = limits[:, :, 1] - BOX_INSET_M - value
        # A derivative at the end of a piece is a multiple of a difference of its control points, all in one box.
        powers = self._powers[self._left]
        self._spread = (left[:, 1] - left[:, 0])[:, None, :] * (np.array([1, 14, 168, 1680]) / powers)[:, :, None]

    def _hessian(self, axis: int) -> sparse.csc_matrix[np.float64]:
        weight = 1 / self._scale[self._leg, axis]
        blocks = self._blocks * weight[:, None, None]
        diagonal = blocks[self._left, 4:, 4:] + blocks[self._left + 1, :4, :4]
        linked = np.flatnonzero(np.diff(self._left) == 1)
        link = blocks[self._left[linked] + 1, :4, 4:]
        count = len(self._inner)
        own, low, high = 4 * np.arange(count)[:, None, None], 4 * linked[:, None, None], 4 * (linked + 1)[:, None, None]
        down, across = np.arange(4)[:, None], np.arange(4)
        entries = [(diagonal, own, own), (link, low, high), (link.transpose(0, 2, 1), high, low)]
        data = np.concatenate([values.ravel() for values, _, _ in entries])
        rows = np.concatenate([np.broadcast_to(row + down, v.shape).ravel() for v, row, _ in entries])
        columns = np.concatenate([np.broadcast_to(column + across, v.shape).ravel() for v, _, column in entries])
        return sparse.coo_matrix((data, (rows, columns)), shape=(4 * count, 4 * count)).tocsc()

    def solve(self, solvers: Sequence[QpSolver]) -> list[NDArray[np.float64]]:
        """Control points of each leg's pieces, shape (n, 8, 3) each."""
        if len(self._inner):
            changes = np.stack([self._solve_axis(axis, solvers) for axis in range(3)], axis=-1)
            self._states[self._inner] += changes.reshape(-1, 4, 3)
        start = CONTROL_FROM_START @ (self._states[self._start] * self._powers[:, :, None])
        end = CONTROL_FROM_END @ (self._states[self._start + 1] * self._powers[:, :, None])
        return np.split(np.concatenate([start, end], axis=1), self._first_segment[1:])

    def _solve_axis(self, axis: int, solvers: Sequence[QpSolver]) -> NDArray[np.float64]:
        hessian = self._hessian(axis)
        unit = 1 / np.sqrt(hessian.diagonal())
        scaling = sparse.diags(unit, format="csc")
        weight = 1 / self._scale[self._leg[self._left], axis]
        problem = QpProblem(
            hessian=(scaling @ hessian @ scaling).tocsc(),
            gradient=unit * (self._gradient[:, :, axis] * weight[:, None]).ravel(),
            constraints=(self._constraints @ scaling).tocsc(),
            low=self._low[:, :, axis].ravel(),
            high=self._high[:, :, axis].ravel(),
            spread=self._spread[:, :, axis].ravel() / unit,
        )
        return unit * solve_checked(problem, solvers).x
