"""Quadratic programs that hang together like chains, and their own solver behind the checks of every other.

    minimise 1/2 x' H x + c' x   subject to   low <= rows_j x_j <= high  at every joint j

Several axes share H and the rows. An answer's status is not enough here either: `evidence` computes violation and gap
again from the problem alone, for each chain.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gcs.planning.numerics.chain_interior_point import Blocks, ChainQp, Floats, inverse_energy, solve_chains
from gcs.planning.numerics.compiled import compiled_ieee

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["ChainQp", "ChainSolution", "ChainSolver", "evidence"]

TOLERANCE = 1e-6
"""Of the cost, that the interior point stops at."""

VIOLATION = 1e-7
"""Largest violation of a row in an accepted answer, in the problem's unit of length."""

GAP = 1e-3
"""Largest gap in an accepted answer, relative to the cost."""

MOST_ITERATIONS = 100
"""Of an axis of a chain."""


@dataclass(frozen=True, eq=False)
class ChainSolution:
    """An answer with its evidence.

    Attributes:
        x: the minimiser, shape (A, J, 4).
        good: whether a chain's answer is to be believed: well posed, inside, and with a small gap, shape (C,).
        iterations: of each axis and chain, shape (A, C); negative where it did not settle, see `solve_chains`.
        violation: largest violation of a row in each chain, shape (C,).
        gap: bound on each chain's cost above the optimum, relative to its cost plus the floor, shape (C,).
    """

    x: NDArray[np.float64]
    good: NDArray[np.bool_]
    iterations: NDArray[np.int64]
    violation: NDArray[np.float64]
    gap: NDArray[np.float64]


def evidence(
    problem: ChainQp, x: NDArray[np.float64], y: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Violation and relative gap of each chain's answer over all axes, computed from the problem alone.

    With any multipliers y and the residual `r = H x + c + rows' y`, the cost is above the optimum by at most
    `sum |y| slack` plus the smaller of `1/2 r' H^-1 r` (Lagrangian duality, minimum over all x) and `sum |r| spread`
    (convexity, minimum over what is feasible).

    Args:
        problem: what was asked.
        x: shape (A, J, 4).
        y: multipliers of the rows, positive where the upper bound pushes, shape (A, J, 7).

    Returns:
        Shape (C,) each; infinity where the answer is not finite.
    """
    violation, above, change = _judged(problem, x, y)
    gap = above / (np.maximum(problem.outset.sum(axis=0) + change, 0.0) + problem.floor)
    return violation, np.where(np.isnan(gap), np.inf, gap)


@compiled_ieee
def _judged(problem: ChainQp, x: Floats, y: Floats) -> tuple[Floats, Floats, Floats]:
    """Largest violation, bound on what is above the optimum, and cost less that at x = 0, of each chain."""
    first, diagonal, link, rows, gradient, low, high, spread = problem[:8]
    chains = len(first) - 1
    violation, above, change = np.zeros(chains), np.zeros(chains), np.zeros(chains)
    residual = np.empty((x.shape[1], 4))
    for i in range(chains):
        here = slice(first[i], first[i + 1])
        for a in range(x.shape[0]):
            spare = 0.0
            for j in range(first[i], first[i + 1]):
                for k in range(7):
                    value = 0.0
                    for c in range(4):
                        value += rows[j, k, c] * x[a, j, c]
                    outside = max(low[a, j, k] - value, value - high[a, j, k])
                    # No comparison with NaN is true: it must not pass for an answer that is inside.
                    violation[i] = max(violation[i], np.inf if np.isnan(value) else outside)
                    slack = high[a, j, k] - value if y[a, j, k] > 0 else value - low[a, j, k]
                    above[i] += abs(y[a, j, k] * slack)
                for c in range(4):
                    product = 0.0
                    for d in range(4):
                        product += diagonal[j, c, d] * x[a, j, d]
                        if j > first[i]:
                            product += link[j - 1, d, c] * x[a, j - 1, d]
                        if j < first[i + 1] - 1:
                            product += link[j, c, d] * x[a, j + 1, d]
                    residual[j, c] = product + gradient[a, j, c]
                    for k in range(7):
                        residual[j, c] += rows[j, k, c] * y[a, j, k]
                    spare += abs(residual[j, c]) * spread[a, j, c]
                    change[i] += x[a, j, c] * (product / 2 + gradient[a, j, c])
            blocks = Blocks(diagonal[here], link[here], rows[here])
            above[i] += min(spare, inverse_energy(blocks, residual[here]) / 2)
    return violation, above, change


class ChainSolver:
    """The interior-point method of `chain_interior_point`: linear in the joints, all chains in one call.

    Attributes:
        tolerance: of the cost.
    """

    name = "chain interior point"

    def __init__(self, tolerance: float = TOLERANCE) -> None:
        """Set the tolerance of the cost."""
        self.tolerance = tolerance

    def coarser(self, tolerance: float) -> ChainSolver:
        """The same with a larger tolerance of the cost."""
        return ChainSolver(max(tolerance, self.tolerance))

    def solve(self, problem: ChainQp) -> ChainSolution:
        """Solve all chains; the answer says for itself which are good."""
        x, y, turns = solve_chains(problem, self.tolerance, MOST_ITERATIONS)
        violation, gap = evidence(problem, x, y)
        # An answer that stopped short of the tolerance is as good as its evidence.
        good = (turns >= -1).all(axis=0) & (violation <= VIOLATION) & (gap <= GAP)
        return ChainSolution(x=x, good=good, iterations=turns, violation=violation, gap=gap)
