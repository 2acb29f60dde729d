"""Least snap in convex sets of planes: one quadratic program of all three axes, which the planes tie together.

A control point b of a piece keeps a plane when `normal . b <= offset`. For general solvers the cost is divided by that
of the interpolating curve, and the unknowns are scaled to a unit diagonal.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy import sparse

from gcs.planning.numerics.plane_interior_point import PlaneQp
from gcs.planning.numerics.plane_qp import solve_planes
from gcs.planning.numerics.qp_solver import QpProblem, solve_checked, unit_diagonal
from gcs.planning.trajectories.box_snap import FLOOR_SHARE, INSET_M, START_ROOM, control_limits
from gcs.planning.trajectories.convex_set import box_planes, inner_ball
from gcs.planning.trajectories.snap_chain import sparse_blocks

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from gcs.planning.numerics.chain_qp import ChainSolver
    from gcs.planning.numerics.qp_solver import QpSolver
    from gcs.planning.trajectories.safe_corridor import LegCorridor
    from gcs.planning.trajectories.snap_chain import SnapChain

OF_LEFT, OF_RIGHT = np.array([0, 1, 2, 6]), np.array([3, 4, 5, 6])
"""Rows of an inner joint (`SnapChain.rows`) that belong to the piece before it and to the piece after it."""

OF_PASSING = (3, 6)
"""Rows that are bounded where a place is passed: of the control point after it, which is the speed, and its own."""


class _Rows(NamedTuple):
    """Planes that control points have to keep.

    Attributes:
        joint: number of the inner joint that the control point hangs on, shape (R,).
        point: its row in `SnapChain.rows`, shape (R,).
        planes: shape (R, 4).
    """

    joint: NDArray[np.int64]
    point: NDArray[np.int64]
    planes: NDArray[np.float64]


class PlaneProblem:
    """Legs side by side in their convex sets.

    Args:
        chain: the legs' states and cost.
        legs: their sets.
    """

    def __init__(self, chain: SnapChain, legs: Sequence[LegCorridor]) -> None:
        self._chain = chain
        parts = [_rows_of_sets(chain, [one for leg in legs for one in leg.sets()]), _rows_of_passing(chain, legs)]
        joint, point, planes = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
        order = np.argsort(joint, kind="stable")
        self._rows = _Rows(joint[order], point[order], planes[order])
        self._high = planes[order, 3] - INSET_M - self._values(chain.states[chain.inner])
        self._spread = chain.spread(np.concatenate([leg.boxes_m for leg in legs]))

    def _values(self, states: NDArray[np.float64]) -> NDArray[np.float64]:
        """Value of each plane's normal on its control point, of states (I, 4, 3); shape (R,)."""
        joint, point, planes = self._rows
        control = np.einsum("ikc,icd->ikd", self._chain.rows, states)
        return np.asarray(np.einsum("rd,rd->r", control[joint, point], planes[:, :3]))

    def _strict_start(self) -> NDArray[np.float64]:
        """Changes of the states to what is strictly inside, from rest towards the interpolating curve, (I, 4, 3)."""
        first = np.searchsorted(self._rows.joint, np.arange(len(self._chain.inner)))
        rest = -self._chain.states[self._chain.inner]
        rest[:, 0] = 0.0
        room = np.minimum.reduceat(self._high - self._values(rest), first)
        for joint in np.flatnonzero(room <= INSET_M):
            planes = self._rows.planes[self._rows.joint == joint]
            rest[joint, 0] = inner_ball(planes)[0] - self._chain.states[self._chain.inner[joint], 0]
        value = self._values(rest)
        way = (1 - START_ROOM) * (self._high - value) / np.maximum(-value, 1e-30)
        return np.asarray(rest * (1 - np.minimum(np.minimum.reduceat(way, first), 1.0))[:, None, None])

    def solve_chains(self, solver: ChainSolver) -> NDArray[np.bool_]:
        """Change the states to the optimal ones; whether each leg's are good, shape (L,)."""
        chain = self._chain
        legs = len(chain.first_segment)
        if not len(chain.inner):
            return np.ones(legs, dtype=np.bool_)
        diagonal, link = chain.hessian_blocks()
        answer = solve_planes(
            PlaneQp(
                first=np.searchsorted(chain.leg[chain.left], np.arange(legs + 1)),
                diagonal=diagonal,
                link=link,
                rows=chain.rows,
                first_plane=np.searchsorted(self._rows.joint, np.arange(len(chain.inner) + 1)),
                point=self._rows.point,
                normal=np.ascontiguousarray(self._rows.planes[:, :3]),
                high=self._high,
                gradient=chain.gradient,
                spread=self._spread,
                outset=chain.cost.sum(axis=1) / 2,
                floor=FLOOR_SHARE * chain.rest_cost,
                start=self._strict_start(),
            ),
            solver.tolerance,
        )
        chain.states[chain.inner] += answer.x
        return answer.good

    def solve(self, solvers: Sequence[QpSolver]) -> None:
        """Change the states to the optimal ones.

        Raises:
            SolverError: no solver gives an answer with small residuals.
        """
        chain = self._chain
        count = len(chain.inner)
        if not count:
            return
        scale = np.maximum(chain.cost.sum(axis=1), chain.least_cost)
        joint, point, planes = self._rows
        block = chain.rows[joint, point][:, :, None] * planes[:, None, :3]
        row = np.arange(len(joint))[:, None]
        problem, unit = unit_diagonal(
            QpProblem(
                hessian=sparse.kron(chain.hessian(scale), np.eye(3), format="csc"),
                gradient=(chain.gradient / scale[chain.leg[chain.left], None, None]).ravel(),
                constraints=sparse_blocks(
                    [(block.reshape(-1, 12), row, 12 * joint[:, None] + np.arange(12))], (len(joint), 12 * count)
                ),
                low=np.full(len(joint), -np.inf),
                high=self._high,
                spread=self._spread.ravel(),
            )
        )
        changes = unit * solve_checked(problem, solvers).x
        chain.states[chain.inner] += changes.reshape(-1, 4, 3)


def _rows_of_sets(chain: SnapChain, sets: Sequence[NDArray[np.float64]]) -> _Rows:
    """The planes of each inner joint's two sets, for every control point that hangs on the joint."""
    planes = np.concatenate(sets)
    segment = np.repeat(np.arange(len(sets)), [len(one) for one in sets])
    joints, points, kept = [], [], []
    for segments, rows in ((chain.left, OF_LEFT), (chain.left + 1, OF_RIGHT)):
        joint_of = np.full(len(sets), -1)
        joint_of[segments] = np.arange(len(segments))
        used = np.flatnonzero(joint_of[segment] >= 0)
        joints.append(np.repeat(joint_of[segment[used]], len(rows)))
        points.append(np.tile(rows, len(used)))
        kept.append(np.repeat(planes[used], len(rows), axis=0))
    return _Rows(np.concatenate(joints), np.concatenate(points), np.concatenate(kept))


def _rows_of_passing(chain: SnapChain, legs: Sequence[LegCorridor]) -> _Rows:
    """The faces of the boxes that places to be passed hold their control points in."""
    first = np.concatenate([[0], np.cumsum([len(leg.boxes_m) - 1 for leg in legs])])
    passed = [
        begin + leg.passing.joints - 1 for begin, leg in zip(first, legs, strict=False) if leg.passing is not None
    ]
    if not passed:
        return _Rows(np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64), np.empty((0, 4)))
    limits = control_limits(chain, legs)
    held = [(joint, point) for joint in np.concatenate(passed) for point in OF_PASSING]
    joints, points = np.repeat(np.array(held), 6, axis=0).T
    return _Rows(joints, points, np.concatenate([box_planes(limits[joint, point]) for joint, point in held]))
