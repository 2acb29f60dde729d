"""Rows `free-N` of the benchmark `trajectories`: least snap through N + 1 points, three axes, no corridor.

Milliseconds from points and times to coefficients, the best of several runs, beside the reference on the same points;
`cost_error` is the cost's relative error against extended precision, for segment times from 0.05 to 20 s.
"""

from __future__ import annotations

from importlib.util import find_spec
from typing import TYPE_CHECKING

import numpy as np

from gcs.planning.trajectories.unconstrained_minimum_snap import minimum_snap_spline
from gcs.services.benchmarks.exact_spline import exact_spline
from gcs.services.benchmarks.row import Row, milliseconds

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

SHORTEST_S, LONGEST_S = 0.05, 20.0
RUNS = {10: 200, 100: 200, 700: 200, 10_000: 30}
"""Numbers of segments, and how often each is solved."""

SLOW, FAST = "minsnap-trajectories", "spline-trajectory"
LARGEST_FOR_SLOW = 100
"""It takes nearly a minute for 700 segments."""


def free_rows(quick: bool) -> list[Row]:
    """Measure.

    Args:
        quick: 10 and 100 segments only, and without the slow reference.
    """
    return [row for segments in RUNS if segments <= 100 or not quick for row in _case(segments, quick)]


def random_points(segments: int, seed: int = 0) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Points of a wandering path (segments + 1, 3), and segment times (s) spread evenly over their logarithm."""
    rng = np.random.default_rng(seed)
    points = np.cumsum(rng.normal(size=(segments + 1, 3)) * np.array([3.0, 3.0, 1.0]), axis=0)
    return points, np.exp(rng.uniform(np.log(SHORTEST_S), np.log(LONGEST_S), segments))


def _case(segments: int, quick: bool) -> list[Row]:
    points, times = random_points(segments)
    case, runs = f"free-{segments}", RUNS[segments]
    spline = minimum_snap_spline(points, times)
    ours = _best(lambda: minimum_snap_spline(points, times), runs)
    gradient = _best(lambda: minimum_snap_spline(points, times).cost_gradient, runs)
    if segments == LARGEST_FOR_SLOW:
        reference, reference_ms = SLOW, None if quick else _slow_ms(points, times)
    else:
        reference, reference_ms = FAST, _fast_ms(points, times, runs)
    rest = [0.0, 0.0, 0.0]
    exact = sum(exact_spline(points[:, axis].tolist(), times.tolist(), 4, rest, rest)[1] for axis in range(3))
    return [
        Row(case, "ms", ours, "ms", reference, reference_ms),
        Row(case, "us_per_segment", 1e3 * ours / segments, "us"),
        Row(case, "with_gradient_ms", gradient, "ms"),
        Row(case, "cost_error", abs(spline.cost / float(exact) - 1), "1", "60 decimal digits", 0.0),
    ]


def _best(action: Callable[[], object], runs: int) -> float:
    return min(milliseconds(action) for _ in range(runs))


def _fast_ms(points: NDArray[np.float64], times: NDArray[np.float64], runs: int) -> float | None:
    if not find_spec("spline_trajectory"):
        return None
    from spline_trajectory import SepticSpline3D  # type: ignore[import-not-found, unused-ignore]

    instants = np.concatenate([[0.0], np.cumsum(times)]).tolist()
    return _best(lambda: SepticSpline3D(instants, points), runs)


def _slow_ms(points: NDArray[np.float64], times: NDArray[np.float64]) -> float | None:
    if not find_spec("minsnap_trajectories"):
        return None
    import minsnap_trajectories as ms  # type: ignore[import-not-found, unused-ignore]

    instants = np.concatenate([[0.0], np.cumsum(times)])
    rest = {"velocity": np.zeros(3), "acceleration": np.zeros(3), "jerk": np.zeros(3)}
    ends = {0, len(points) - 1}
    waypoints = [
        ms.Waypoint(time=float(time), position=point, **(rest if index in ends else {}))
        for index, (time, point) in enumerate(zip(instants, points, strict=True))
    ]
    return milliseconds(
        lambda: ms.generate_trajectory(
            waypoints, degree=7, idx_minimized_orders=4, num_continuous_orders=4, algorithm="closed-form"
        )
    )
