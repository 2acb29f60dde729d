"""Benchmark `trajectories`: minimum-snap curves, three axes, set-up included.

Without a corridor: see `free_trajectories`. In a corridor, of boxes (`corridor-N`), tubes or polytopes: milliseconds,
the best of several runs, and the largest distance of a control point outside its set; `cost_error` is the integral of
squared snap relative to the reference's.
The reference is PIQP on the same formulation (Hermite unknowns, Bernstein hull) in the same run; Clarabel and OSQP have
rows of their own. Then flight times (`flight_times`, `fly_through_plans`) and a whole plan (`whole_plan`).
"""

from __future__ import annotations

import itertools
import time
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.errors import InfeasibleError
from gcs.planning.numerics.chain_qp import ChainSolver
from gcs.planning.numerics.qp_solver import ClarabelSolver, OsqpSolver, PiqpSolver
from gcs.planning.trajectories.convex_set import outside_m
from gcs.planning.trajectories.minimum_snap import minimum_snap
from gcs.planning.trajectories.safe_corridor import LegCorridor, build_corridor
from gcs.planning.trajectories.snap_chain import snap_cost
from gcs.services.benchmarks.flight_times import flight_time_rows
from gcs.services.benchmarks.fly_through_plans import fly_through_rows
from gcs.services.benchmarks.free_trajectories import free_rows
from gcs.services.benchmarks.row import Row
from gcs.services.benchmarks.whole_plan import whole_plan_rows

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from gcs.planning.numerics.qp_solver import QpSolver

HALF_WIDTH_M = 0.8
REPEATS = 5
PLANES_OF_POLYTOPES = 4


@dataclass(frozen=True)
class _Result:
    ms: float
    cost: float
    violation_m: float


def run(quick: bool) -> list[Row]:
    """Measure.

    Args:
        quick: few segments only.
    """
    corridors = (50,) if quick else (50, 200, 700)
    in_corridors = [
        row for kind in ("corridor", "tubes", "polytopes") for n in corridors for row in _corridor(kind, n, quick)
    ]
    return free_rows(quick) + in_corridors + flight_time_rows(quick) + fly_through_rows(quick) + whole_plan_rows(quick)


def random_corridor(segments: int, seed: int = 0) -> tuple[LegCorridor, NDArray[np.float64]]:
    """A wandering leg, boxes of +-0.8 m about its segments, and uneven segment times (s)."""
    rng = np.random.default_rng(seed)
    steps = rng.normal(size=(segments, 3)) * np.array([3.0, 3.0, 1.0])
    joints = np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])
    low = np.minimum(joints[:-1], joints[1:]) - HALF_WIDTH_M
    high = np.maximum(joints[:-1], joints[1:]) + HALF_WIDTH_M
    times = np.linalg.norm(steps, axis=1) / 3.0 * rng.uniform(0.7, 1.4, segments) + 0.3
    return LegCorridor(joints, np.stack([low, high], axis=1)), times


def random_tubes(segments: int, planes: int = 0, seed: int = 0) -> tuple[LegCorridor, NDArray[np.float64]]:
    """Tubes of the same reach about the same leg, with its times; each cut by so many planes beside its segment."""
    boxes, times = random_corridor(segments, seed)
    leg = build_corridor(boxes.joints_m, HALF_WIDTH_M, kind="tubes")
    rng = np.random.default_rng(seed)
    cut = []
    for tube, ends in zip(leg.planes, itertools.pairwise(leg.joints_m), strict=True):
        normals = rng.normal(size=(planes, 3))
        normals /= np.linalg.norm(normals, axis=1)[:, None]
        offsets = (normals @ np.array(ends).T).max(axis=1) + rng.uniform(0.1, 0.6, planes)
        cut.append(np.concatenate([tube, np.column_stack([normals, offsets])]))
    return replace(leg, planes=tuple(cut)), times


def _corridor(kind: str, segments: int, quick: bool) -> list[Row]:
    if kind == "corridor":
        leg, times = random_corridor(segments)
    else:
        leg, times = random_tubes(segments, planes=0 if kind == "tubes" else PLANES_OF_POLYTOPES)
    repeats = 1 if quick else REPEATS
    ours = _measure(leg, times, ChainSolver(), repeats)
    if ours is None:
        raise InfeasibleError(f"the corridor of {segments} segments is not solved")
    piqp = _measure(leg, times, PiqpSolver(), repeats)
    case = f"{kind}-{segments}"
    rows = [
        Row(case, "ms", ours.ms, "ms", "PIQP", piqp.ms if piqp else None),
        Row(case, "violation_m", ours.violation_m, "m", "PIQP", piqp.violation_m if piqp else None),
    ]
    if piqp is not None:
        rows.append(Row(case, "cost_error", ours.cost / piqp.cost - 1, "1", "PIQP", 0.0))
    for solver in (ClarabelSolver(), OsqpSolver()) if kind == "corridor" else ():
        other = _measure(leg, times, solver, 1)
        rows.append(Row(case, f"solved_by_{solver.name.lower()}", float(other is not None), "1"))
        if other is not None:
            rows.append(Row(case, f"{solver.name.lower()}_ms", other.ms, "ms"))
    return rows


def _measure(
    leg: LegCorridor, times: NDArray[np.float64], solver: QpSolver | ChainSolver, repeats: int
) -> _Result | None:
    """Best time, cost and violation; None where status or residuals are not good."""
    spent = []
    for _ in range(repeats):
        begin = time.perf_counter()
        try:
            (control,) = minimum_snap([leg], [times], [solver])
        except InfeasibleError:
            return None
        spent.append(1e3 * (time.perf_counter() - begin))
    return _Result(min(spent), snap_cost(control, times), outside_m(control, leg.sets()))
