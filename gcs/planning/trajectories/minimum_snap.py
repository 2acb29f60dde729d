"""Minimum-snap curves of degree 7 inside corridors, from rest to rest (Mellinger and Kumar 2011; Richter et al. 2016).

The unknowns are the states at the joints (`snap_chain`); the Bernstein control points of the pieces are linear in them.
Keeping each piece's control points in its convex set proves the corridor for the whole curve.

At rest in a place that two neighbouring sets share, a joint keeps both; so a corridor has a curve if and only if its
neighbouring sets meet, and what is infeasible is said with the segment's number before anything is solved.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gcs.core.errors import InputError
from gcs.planning.numerics.chain_qp import ChainSolver
from gcs.planning.numerics.qp_solver import SolverError
from gcs.planning.trajectories.box_snap import BoxProblem
from gcs.planning.trajectories.corridor_checks import check_corridors
from gcs.planning.trajectories.plane_snap import PlaneProblem
from gcs.planning.trajectories.snap_chain import SnapChain

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from gcs.planning.numerics.qp_solver import QpSolver
    from gcs.planning.trajectories.safe_corridor import LegCorridor


def _check_times(leg: int, durations_s: NDArray[np.float64], segments: int) -> None:
    if durations_s.shape != (segments,):
        message = f"leg {leg}: {segments} segments need as many times, not shape {durations_s.shape}"
        raise InputError(message, field="durations_s")
    good = (durations_s > 0) & np.isfinite(durations_s)
    if not good.all():
        bad = int(good.argmin())
        message = f"leg {leg}: segment {bad} lasts {durations_s[bad]:g} s; it needs a positive time"
        raise InputError(message, field="durations_s")


def minimum_snap(
    legs: Sequence[LegCorridor],
    durations_s: Sequence[NDArray[np.float64]],
    solvers: Sequence[QpSolver | ChainSolver],
) -> list[NDArray[np.float64]]:
    """Curves of least snap through corridors, from rest to rest.

    Args:
        legs: corridors from stop to stop.
        durations_s: segment times of each leg, shape (n,) each.
        solvers: a chain's solver gets all legs at once; of the others the first is tried on what is left, all together
            and then in ever smaller groups, and the rest on single legs.

    Returns:
        Control points of each leg's pieces, scene ENU m, shape (n, 8, 3) each.

    Raises:
        InputError: a corridor or a time that is not a good number; it names leg and segment.
        InfeasibleError: a corridor that no curve can be in; it names leg and segment.
        SolverError: no solver gives an answer with small residuals; it names the leg.
    """
    check_corridors(legs)
    for index, (leg, durations) in enumerate(zip(legs, durations_s, strict=True)):
        _check_times(index, durations, len(leg.boxes_m))
    curves = []
    for curve in solve_legs(legs, durations_s, solvers):
        if isinstance(curve, SolverError):
            raise curve
        curves.append(curve)
    return curves


def solve_legs(
    legs: Sequence[LegCorridor],
    durations_s: Sequence[NDArray[np.float64]],
    solvers: Sequence[QpSolver | ChainSolver],
) -> list[NDArray[np.float64] | SolverError]:
    """`minimum_snap` of corridors that were checked, with the error of a leg without answer in its curve's place."""
    curves: list[NDArray[np.float64] | SolverError] = [SolverError("no solver was given") for _ in legs]
    left = list(range(len(legs)))
    for solver in solvers:
        if isinstance(solver, ChainSolver) and left:
            chain = SnapChain([legs[k] for k in left], [durations_s[k] for k in left])
            good = _problem(chain, [legs[k] for k in left]).solve_chains(solver)
            for k, curve, is_good in zip(left, chain.control(), good, strict=True):
                curves[k] = curve if is_good else SolverError(f"leg {k}: {solver.name} did not settle")
            left = [k for k, is_good in zip(left, good, strict=True) if not is_good]
    general = [solver for solver in solvers if not isinstance(solver, ChainSolver)]
    if left and general:
        rest = _solve_group([(k, legs[k], durations_s[k]) for k in left], general)
        for k, answer in zip(left, rest, strict=True):
            curves[k] = answer
    return curves


def _problem(chain: SnapChain, legs: Sequence[LegCorridor]) -> BoxProblem | PlaneProblem:
    return PlaneProblem(chain, legs) if any(leg.planes for leg in legs) else BoxProblem(chain, legs)


def _solve_group(
    group: list[tuple[int, LegCorridor, NDArray[np.float64]]], solvers: Sequence[QpSolver]
) -> list[NDArray[np.float64] | SolverError]:
    alone = len(group) == 1
    try:
        legs = [leg for _, leg, _ in group]
        chain = SnapChain(legs, [durations for _, _, durations in group])
        _problem(chain, legs).solve(solvers if alone else solvers[:1])
        return [*chain.control()]
    except SolverError as error:
        if alone:
            return [SolverError(f"leg {group[0][0]}: {error.message}")]
    half = len(group) // 2
    return _solve_group(group[:half], solvers) + _solve_group(group[half:], solvers)
