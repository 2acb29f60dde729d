"""Benchmark `trajectories`: minimum-snap curves, three axes, set-up included.

Without a corridor: see `free_trajectories`. In a corridor, solvers side by side: milliseconds and the largest distance
of a control point outside its box; `cost_error` is the integral of squared snap relative to the reference's. The
reference column is then Clarabel's on the same problem in the same run.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.errors import InfeasibleError
from gcs.planning.numerics.qp_solver import ClarabelSolver, OsqpSolver, PiqpSolver
from gcs.planning.trajectories.minimum_snap import minimum_snap, snap_cost
from gcs.planning.trajectories.safe_corridor import LegCorridor
from gcs.services.benchmarks.free_trajectories import free_rows
from gcs.services.benchmarks.row import Row

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from gcs.planning.numerics.qp_solver import QpSolver

HALF_WIDTH_M = 0.8
REPEATS = 5


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
    return free_rows(quick) + [row for segments in corridors for row in _corridor(segments, quick)]


def random_corridor(segments: int, seed: int = 0) -> tuple[LegCorridor, NDArray[np.float64]]:
    """A wandering leg, boxes of +-0.8 m about its segments, and uneven segment times (s)."""
    rng = np.random.default_rng(seed)
    steps = rng.normal(size=(segments, 3)) * np.array([3.0, 3.0, 1.0])
    joints = np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])
    low = np.minimum(joints[:-1], joints[1:]) - HALF_WIDTH_M
    high = np.maximum(joints[:-1], joints[1:]) + HALF_WIDTH_M
    times = np.linalg.norm(steps, axis=1) / 3.0 * rng.uniform(0.7, 1.4, segments) + 0.3
    return LegCorridor(joints, np.stack([low, high], axis=1)), times


def _corridor(segments: int, quick: bool) -> list[Row]:
    leg, times = random_corridor(segments)
    ours = _measure(leg, times, PiqpSolver(), 1 if quick else REPEATS)
    if ours is None:
        raise InfeasibleError(f"PIQP does not solve the corridor of {segments} segments")
    reference = _measure(leg, times, ClarabelSolver(), 1)
    osqp = _measure(leg, times, OsqpSolver(), 1)
    case = f"corridor-{segments}"
    rows = [
        Row(case, "ms", ours.ms, "ms", "Clarabel", reference.ms if reference else None),
        Row(case, "violation_m", ours.violation_m, "m", "Clarabel", reference.violation_m if reference else None),
        Row(case, "solved_by_osqp", float(osqp is not None), "1"),
    ]
    if reference is not None:
        rows.append(Row(case, "cost_error", ours.cost / reference.cost - 1, "1", "Clarabel", 0.0))
    return rows


def _measure(leg: LegCorridor, times: NDArray[np.float64], solver: QpSolver, repeats: int) -> _Result | None:
    """Median time, cost and violation; None where status or residuals are not good."""
    spent = []
    for _ in range(repeats):
        begin = time.perf_counter()
        try:
            (control,) = minimum_snap([leg], [times], [solver])
        except InfeasibleError:
            return None
        spent.append(1e3 * (time.perf_counter() - begin))
    outside = np.maximum(leg.boxes_m[:, :1] - control, control - leg.boxes_m[:, 1:])
    return _Result(float(np.median(spent)), snap_cost(control, times), float(outside.max(initial=0.0)))
