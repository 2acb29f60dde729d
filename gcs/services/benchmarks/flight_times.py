"""Rows `fly-*` and `stop-*` of benchmark `trajectories`: flight time over the time-optimal profile of the same curve.

`fly` flies through everything between its two ends, `stop` goes from stop to stop. The limits' use is that of the true
extrema.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gcs.core.progress import SilentProgress
from gcs.core.trajectory import PiecewisePolynomial
from gcs.planning.numerics.bernstein import monomial_from_control
from gcs.planning.numerics.qp_solver import default_solvers
from gcs.planning.trajectories.flight_limits import FlightLimits, peaks
from gcs.planning.trajectories.safe_corridor import build_corridor
from gcs.planning.trajectories.time_allocation import time_legs
from gcs.planning.trajectories.trajectory_builder import longest_segment_m
from gcs.services.benchmarks.row import Row
from gcs.services.benchmarks.time_optimal import time_optimal_s

if TYPE_CHECKING:
    from numpy.typing import NDArray

HALF_WIDTH_M = 0.5
LIMITS = {
    "quick": FlightLimits(5.0, 2.5),
    "jerk": FlightLimits(5.0, 2.5, 6.0),
    "slow": FlightLimits(2.0, 2.5, 6.0),
}
MOST_FLYING, MOST_STOPPING = 1.15, 1.4
"""What is asked of the ratio."""


def flight_time_rows(quick: bool) -> list[Row]:
    """Measure.

    Args:
        quick: one set of limits, and the rows only.
    """
    rows: list[Row] = []
    for name, limits in LIMITS.items():
        if quick and name != "slow":
            continue
        through = {"rows": rows_path()} if quick else through_paths()
        rows += [_row(f"fly-{path}-{name}", [way], limits, MOST_FLYING) for path, way in through.items()]
        rows.append(_row(f"stop-{name}", stop_legs(4 if quick else 30), limits, MOST_STOPPING))
    return rows


def rows_path() -> NDArray[np.float64]:
    """Eight rows of 20 m, 1.5 m above each other, to and fro."""
    ends = [[(0.0, 0.0, 3 + 1.5 * k), (20.0, 0.0, 3 + 1.5 * k)][:: 1 if k % 2 == 0 else -1] for k in range(8)]
    return np.array(ends).reshape(-1, 3)


def through_paths() -> dict[str, NDArray[np.float64]]:
    """Rows, a helix of two turns, and a wandering path of 24 corners."""
    angle = np.linspace(0, 4 * np.pi, 60)
    steps = np.random.default_rng(7).normal(size=(25, 3)) * np.array([6.0, 6.0, 2.0])
    return {
        "rows": rows_path(),
        "helix": np.stack([8 * np.cos(angle), 8 * np.sin(angle), 5 + angle], axis=1),
        "wandering": np.cumsum(steps, axis=0),
    }


def stop_legs(count: int) -> list[NDArray[np.float64]]:
    """Legs between stops: straights of 1 to 30 m, and as many with one to four corners."""
    rng = np.random.default_rng(8)
    straight = [np.array([[0.0, 0, 5], [0.6 * x, 0.8 * x, 5]]) for x in np.geomspace(1.0, 30.0, count)]
    bent = [np.cumsum(rng.normal(size=(int(rng.integers(3, 7)), 3)) * 6, axis=0) for _ in range(count)]
    return straight + bent


def _row(case: str, legs: list[NDArray[np.float64]], limits: FlightLimits, most: float) -> Row:
    """The worst ratio over the legs."""
    longest = longest_segment_m(limits, HALF_WIDTH_M)
    corridors = [build_corridor(leg, HALF_WIDTH_M, longest) for leg in legs]
    worst = 0.0
    for timed in time_legs(corridors, limits, default_solvers(), SilentProgress()):
        curve = PiecewisePolynomial(monomial_from_control(timed.control), timed.durations_s)
        if float(limits.stretch(peaks(timed.control, timed.durations_s))) > 1 + 1e-6:
            raise AssertionError(f"{case}: a limit is exceeded")
        worst = max(worst, timed.total_s / time_optimal_s(curve, limits))
    return Row(case, "over_time_optimal", worst, "1", "asked", most)
