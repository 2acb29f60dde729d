"""Convex quadratic programs behind one small protocol: PIQP, Clarabel and OSQP; a chain's own solver before them.

    minimise 1/2 x' P x + c' x   subject to   l <= G x <= u

A solver's own word is not enough: OSQP can run into its iteration limit and leave a corridor by metres. So each
answer's status is looked at and its residuals are computed here again, from the problem alone; `solve_checked` goes on
to the next solver when either is not good, and raises when none is.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Protocol

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from gcs.core.errors import InfeasibleError
from gcs.planning.numerics.chain_qp import VIOLATION, ChainSolver

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

GAP = 1e-3
"""Largest gap in an accepted answer, in the problem's unit of cost."""


class SolverError(InfeasibleError):
    """No solver found an answer whose residuals are small."""


@dataclass(frozen=True, eq=False)
class QpProblem:
    """A convex quadratic program, scaled so that lengths and the optimal cost are of the order of 1.

    Attributes:
        hessian: P, symmetric positive semidefinite, both triangles stored, shape (n, n).
        gradient: c, shape (n,).
        constraints: G, shape (m, n).
        low: l, shape (m,); -inf where a row has none.
        high: u, shape (m,); inf where a row has none.
        spread: no two feasible points differ by more than this, shape (n,).
    """

    hessian: sparse.csc_matrix[np.float64]
    gradient: NDArray[np.float64]
    constraints: sparse.csc_matrix[np.float64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]
    spread: NDArray[np.float64]


def unit_diagonal(problem: QpProblem) -> tuple[QpProblem, NDArray[np.float64]]:
    """The same problem with unknowns scaled so that the Hessian's diagonal is 1, and those scales: x = scales * x'."""
    unit = 1 / np.sqrt(problem.hessian.diagonal())
    scaling = sparse.diags(unit, format="csc")
    scaled = replace(
        problem,
        hessian=(scaling @ problem.hessian @ scaling).tocsc(),
        gradient=unit * problem.gradient,
        constraints=(problem.constraints @ scaling).tocsc(),
        spread=problem.spread / unit,
    )
    return scaled, unit


@dataclass(frozen=True, eq=False)
class QpSolution:
    """An answer with its evidence.

    Attributes:
        x: the minimiser, shape (n,).
        multipliers: of the constraints, positive where the upper bound pushes, shape (m,).
        solved: the solver's own status.
        status: the same in its own word.
        solver: its name.
        violation: largest violation of a constraint.
        gap: upper bound on the cost above the optimum (see `evidence`).
    """

    x: NDArray[np.float64]
    multipliers: NDArray[np.float64]
    solved: bool
    status: str
    solver: str
    violation: float
    gap: float


class QpSolver(Protocol):
    """A way to solve a `QpProblem`."""

    @property
    def name(self) -> str:
        """The solver's name, for messages."""
        ...

    def solve(self, problem: QpProblem) -> QpSolution:
        """Try to solve; the answer says for itself whether it is good."""
        ...


def evidence(problem: QpProblem, x: NDArray[np.float64], y: NDArray[np.float64]) -> tuple[float, float]:
    """Violation and gap of an answer, computed from the problem alone.

    With any multipliers y and the residual `r = P x + c + G' y` the cost is above the optimum by at most
    `sum_i |y_i| slack_i` plus the smaller of `1/2 r' P^-1 r` (Lagrangian duality, minimum over all x) and
    `sum_i |r_i| spread_i` (convexity, minimum over what is feasible).

    Returns:
        The largest violation of a constraint, and that bound; infinity for answers that are not finite.
    """
    if not (np.isfinite(x).all() and np.isfinite(y).all()):
        return float("inf"), float("inf")
    # A bound that there is not cannot push.
    y = np.clip(y, np.where(np.isfinite(problem.low), -np.inf, 0.0), np.where(np.isfinite(problem.high), np.inf, 0.0))
    value = problem.constraints @ x
    violation = float(np.maximum(problem.low - value, value - problem.high).max(initial=0.0))
    residual = problem.hessian @ x + problem.gradient + problem.constraints.T @ y
    slack = np.where(y > 0, problem.high - value, value - problem.low)
    complementarity = float(np.abs(y[y != 0] * slack[y != 0]).sum())
    unbounded = abs(float(residual @ splu(problem.hessian).solve(residual))) / 2
    return violation, complementarity + min(unbounded, float(np.abs(residual) @ problem.spread))


class PiqpSolver:
    """PIQP: a proximal interior-point method (Schwan, Jiang, Kuhn, Jones 2023)."""

    name = "PIQP"

    def solve(self, problem: QpProblem) -> QpSolution:
        """Solve with the sparse backend."""
        import piqp

        solver = piqp.SparseSolver()
        # Smooth modes of long legs have eigenvalues of 1e-12 and less: a larger regularisation creeps along them.
        solver.settings.reg_lower_limit = 1e-15
        solver.settings.eps_duality_gap_abs = 1e-6
        solver.setup(
            problem.hessian, problem.gradient, None, None, problem.constraints, problem.low, problem.high, None, None
        )
        status = solver.solve()
        result = solver.result
        x, y = np.array(result.x), np.array(result.z_u) - np.array(result.z_l)
        return _answer(self.name, problem, x, y, status == piqp.PIQP_SOLVED, str(status))


class ClarabelSolver:
    """Clarabel: an interior-point method with a homogeneous embedding (Goulart and Chen 2024)."""

    name = "Clarabel"

    def solve(self, problem: QpProblem) -> QpSolution:
        """Solve with two one-sided cones for the two-sided constraints."""
        import clarabel

        settings = clarabel.DefaultSettings()
        settings.verbose = False
        above, below = np.isfinite(problem.high), np.isfinite(problem.low)
        sides = sparse.vstack([problem.constraints[above], -problem.constraints[below]], format="csc")
        bounds = np.concatenate([problem.high[above], -problem.low[below]])
        upper = sparse.triu(problem.hessian, format="csc")
        cones = [clarabel.NonnegativeConeT(len(bounds))]
        result = clarabel.DefaultSolver(upper, problem.gradient, sides, bounds, cones, settings).solve()
        x, z = np.array(result.x), np.array(result.z)
        y = np.zeros(len(problem.high))
        y[above] = z[: above.sum()]
        y[below] -= z[above.sum() :]
        return _answer(self.name, problem, x, y, result.status == clarabel.SolverStatus.Solved, str(result.status))


class OsqpSolver:
    """OSQP: operator splitting (Stellato et al. 2020); quick to a rough answer, slow to a fine one."""

    name = "OSQP"

    def solve(self, problem: QpProblem) -> QpSolution:
        """Solve with a tolerance of 1e-7 and at most 20,000 iterations."""
        import osqp

        solver = osqp.OSQP()
        solver.setup(
            sparse.triu(problem.hessian, format="csc"),
            problem.gradient,
            problem.constraints,
            problem.low,
            problem.high,
            verbose=False,
            eps_abs=1e-7,
            eps_rel=1e-7,
            max_iter=20_000,
        )
        result = solver.solve(raise_error=False)
        x, y = np.asarray(result.x), np.asarray(result.y)
        return _answer(self.name, problem, x, y, result.info.status == "solved", str(result.info.status))


def _answer(
    name: str, problem: QpProblem, x: NDArray[np.float64], y: NDArray[np.float64], solved: bool, status: str
) -> QpSolution:
    violation, gap = evidence(problem, x, y)
    return QpSolution(x=x, multipliers=y, solved=solved, status=status, solver=name, violation=violation, gap=gap)


def general_solvers() -> tuple[QpSolver, ...]:
    """The solvers of any convex problem in the order in which they are tried."""
    return PiqpSolver(), ClarabelSolver(), OsqpSolver()


def default_solvers() -> tuple[QpSolver | ChainSolver, ...]:
    """The solvers in the order in which they are tried: the one of chains, then the general ones."""
    return ChainSolver(), *general_solvers()


def solve_checked(
    problem: QpProblem, solvers: Sequence[QpSolver], violation: float = VIOLATION, gap: float = GAP
) -> QpSolution:
    """The first answer that is solved by its status and by its residuals.

    Args:
        problem: scaled so that lengths and the optimal cost are of the order of 1.
        solvers: tried in this order.
        violation: largest violation of a constraint that is taken.
        gap: largest gap that is taken.

    Raises:
        SolverError: no answer is good enough; it says what each solver gave.
    """
    tried = []
    for solver in solvers:
        answer = solver.solve(problem)
        if answer.solved and answer.violation <= violation and answer.gap <= gap:
            return answer
        tried.append(f"{answer.solver} {answer.status}, violation {answer.violation:.1e}, gap {answer.gap:.1e}")
    raise SolverError(f"no solver found a curve in the corridor, a wider one may help ({'; '.join(tried)})")
