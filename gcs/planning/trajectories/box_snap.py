"""Least snap in axis-aligned boxes: the axes do not touch each other, each is a quadratic program of its own.

The cost is divided by that of the interpolating curve, and the unknowns are scaled to a unit diagonal.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gcs.planning.numerics.chain_qp import ChainQp
from gcs.planning.numerics.qp_solver import QpProblem, solve_checked, unit_diagonal
from gcs.planning.trajectories.snap_chain import sparse_blocks

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from gcs.planning.numerics.chain_qp import ChainSolver
    from gcs.planning.numerics.qp_solver import QpSolver
    from gcs.planning.trajectories.safe_corridor import LegCorridor
    from gcs.planning.trajectories.snap_chain import SnapChain

INSET_M = 1e-6
"""The solver gets sets this much smaller, so that its rounding never leaves the true ones."""

START_ROOM = 0.5
"""Share of the room to every bound, as at rest in the middle of it, that the solver's first curve keeps."""

FLOOR_SHARE = 0.005
"""Share of the cost of a straight move over a leg's length below which differences of its cost do not count."""


def control_limits(chain: SnapChain, legs: Sequence[LegCorridor]) -> NDArray[np.float64]:
    """Low and high corner of where the boxes and what is passed let each control point be, shape (I, 7, 2, 3).

    Args:
        chain: of these legs; its `rows` are the control points.
        legs: their boxes.
    """
    boxes_m = np.concatenate([leg.boxes_m for leg in legs])
    left, right = boxes_m[chain.left], boxes_m[chain.left + 1]
    shared = np.concatenate([leg.shared_m for leg in legs])
    limits = np.concatenate([left[:, None].repeat(3, 1), right[:, None].repeat(3, 1), shared[:, None]], axis=1)
    inner, piece = 0, 0
    for leg in legs:
        count = len(leg.boxes_m)
        if leg.passing is not None:
            durations = chain.durations_s[piece : piece + count]
            leg.passing.bound_speeds(limits[inner : inner + count - 1], leg.joints_m, durations)
        inner, piece = inner + count - 1, piece + count
    return limits


class BoxProblem:
    """Legs side by side in their boxes: the axes do not touch each other.

    Args:
        chain: the legs' states and cost.
        legs: their boxes.
    """

    def __init__(self, chain: SnapChain, legs: Sequence[LegCorridor]) -> None:
        self._chain = chain
        limits = control_limits(chain, legs)
        value = chain.rows @ chain.states[chain.inner]
        self._low = limits[:, :, 0] + INSET_M - value
        self._high = limits[:, :, 1] - INSET_M - value
        self._spread = chain.spread(np.concatenate([leg.boxes_m for leg in legs]))

    def _strict_start(self) -> NDArray[np.float64]:
        """Changes of the states to what is strictly inside, from rest towards the interpolating curve, (I, 4, 3)."""
        rest = -self._chain.states[self._chain.inner]
        rest[:, 0] = (self._low[:, 6] + self._high[:, 6]) / 2
        value = self._chain.rows @ rest
        room = np.where(value > 0, value - self._low, self._high - value)
        way = (1 - START_ROOM) * room / np.maximum(np.abs(value), 1e-30)
        return np.asarray(rest * (1 - np.minimum(way.min(axis=1), 1.0))[:, None, :])

    def solve_chains(self, solver: ChainSolver) -> NDArray[np.bool_]:
        """Change the states to the optimal ones; whether each leg's are good, shape (L,)."""
        chain = self._chain
        if not len(chain.inner):
            return np.ones(len(chain.first_segment), dtype=np.bool_)
        legs = len(chain.first_segment)
        diagonal, link = chain.hessian_blocks()
        axes_first = [
            np.ascontiguousarray(np.moveaxis(values, -1, 0))
            for values in (chain.gradient, self._low, self._high, self._spread, self._strict_start())
        ]
        gradient, low, high, spread, start = axes_first
        answer = solver.solve(
            ChainQp(
                first=np.searchsorted(chain.leg[chain.left], np.arange(legs + 1)),
                diagonal=diagonal,
                link=link,
                rows=chain.rows,
                gradient=gradient,
                low=low,
                high=high,
                spread=spread,
                outset=np.ascontiguousarray(chain.cost.T) / 2,
                floor=FLOOR_SHARE * chain.rest_cost,
                start=start,
            )
        )
        chain.states[chain.inner] += np.moveaxis(answer.x, 0, -1)
        return answer.good

    def solve(self, solvers: Sequence[QpSolver]) -> None:
        """Change the states to the optimal ones.

        Raises:
            SolverError: no solver gives an answer with small residuals.
        """
        if not len(self._chain.inner):
            return
        changes = np.stack([self._solve_axis(axis, solvers) for axis in range(3)], axis=-1)
        self._chain.states[self._chain.inner] += changes.reshape(-1, 4, 3)

    def _solve_axis(self, axis: int, solvers: Sequence[QpSolver]) -> NDArray[np.float64]:
        chain = self._chain
        count = len(chain.inner)
        joint = np.arange(count)[:, None, None]
        scale = np.maximum(chain.cost[:, axis], chain.least_cost)
        constraints = sparse_blocks(
            [(chain.rows, 7 * joint + np.arange(7)[:, None], 4 * joint + np.arange(4))], (7 * count, 4 * count)
        )
        gradient = chain.gradient[:, :, axis] / scale[chain.leg[chain.left], None]
        problem, unit = unit_diagonal(
            QpProblem(
                hessian=chain.hessian(scale),
                gradient=gradient.ravel(),
                constraints=constraints,
                low=self._low[:, :, axis].ravel(),
                high=self._high[:, :, axis].ravel(),
                spread=self._spread[:, :, axis].ravel(),
            )
        )
        return unit * solve_checked(problem, solvers).x
