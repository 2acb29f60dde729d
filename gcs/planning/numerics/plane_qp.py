"""Chains whose axes planes tie together: their own solver, and its answers judged from the problem alone."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gcs.planning.numerics.chain_interior_point import Blocks, inverse_energy
from gcs.planning.numerics.chain_qp import GAP, MOST_ITERATIONS, VIOLATION
from gcs.planning.numerics.compiled import compiled_ieee
from gcs.planning.numerics.plane_interior_point import PlaneQp, add_planes, cost_slope, plane_values, solve_plane_chains

Floats = np.ndarray[tuple[int, ...], np.dtype[np.float64]]


class PlaneSolution(NamedTuple):
    """An answer with its evidence, see `ChainSolution`.

    Attributes:
        x: the minimiser, shape (J, 4, 3).
        good: whether a chain's answer is to be believed, shape (C,).
        iterations: of each chain, shape (C,); negative where it did not settle.
        violation: largest violation of a plane in each chain, shape (C,).
        gap: bound on each chain's cost above the optimum, relative to its cost plus the floor, shape (C,).
    """

    x: NDArray[np.float64]
    good: NDArray[np.bool_]
    iterations: NDArray[np.int64]
    violation: NDArray[np.float64]
    gap: NDArray[np.float64]


def solve_planes(problem: PlaneQp, tolerance: float) -> PlaneSolution:
    """Solve all chains to a tolerance of the cost; the answer says for itself which are good."""
    x, push, turns = solve_plane_chains(problem, tolerance, MOST_ITERATIONS)
    violation, above, change = judged(problem, x, push)
    gap = above / (np.maximum(problem.outset + change, 0.0) + problem.floor)
    gap = np.where(np.isnan(gap), np.inf, gap)
    # An answer that stopped short of the tolerance is as good as its evidence.
    good = (turns >= -1) & (violation <= VIOLATION) & (gap <= GAP)
    return PlaneSolution(x, good, turns, violation, gap)


@compiled_ieee
def judged(problem: PlaneQp, x: Floats, push: Floats) -> tuple[Floats, Floats, Floats]:
    """What an answer is worth, by `chain_qp.evidence`.

    Args:
        problem: what was asked.
        x: shape (J, 4, 3).
        push: multipliers of the planes, none negative, shape (R,).

    Returns:
        Largest violation, bound on what is above the optimum, and cost less that at x = 0, of each chain, shape (C,).
    """
    chains = len(problem.first) - 1
    violation, above, change = np.zeros(chains), np.zeros(chains), np.zeros(chains)
    residual, values = np.empty(x.shape), np.empty(len(push))
    for i in range(chains):
        begin, end = problem.first[i], problem.first[i + 1]
        change[i] = cost_slope(problem, begin, end, x, residual)
        plane_values(problem, begin, end, x, values)
        for r in range(problem.first_plane[begin], problem.first_plane[end]):
            outside = values[r] - problem.high[r]
            # No comparison with NaN is true: it must not pass for an answer that is inside.
            violation[i] = max(violation[i], np.inf if np.isnan(outside) else outside)
            above[i] += abs(push[r] * outside)
        add_planes(problem, begin, end, push, residual)
        spare = 0.0
        for j in range(begin, end):
            for o in range(4):
                for d in range(3):
                    spare += abs(residual[j, o, d]) * problem.spread[j, o, d]
        energy = 0.0
        blocks = Blocks(problem.diagonal[begin:end], problem.link[begin:end], problem.rows[begin:end])
        for d in range(3):
            energy += inverse_energy(blocks, residual[begin:end, :, d].copy())
        above[i] += min(spare, energy / 2)
    return violation, above, change
