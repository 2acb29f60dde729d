"""Home along the path that was flown (ArduPilot's SmartRTL): how near it stays to that path, and what it remembers.

While it flies, the vehicle keeps points of its path that are at least its accuracy apart, straightens what lies within
half of that of a line (Ramer 1972, Douglas and Peucker 1973), and cuts loops where the path meets itself within about
that. A chord between points leaves the path by half the accuracy at most, straightening by half, a cut loop by half.
What it remembers is where it was, and on the way back it strays from that again as much as it strays from a plan.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from gcs.core.plan import Plan
    from gcs.core.trajectory import PiecewisePolynomial
    from gcs.core.way_home import RetraceMemory

STRAYS = 1.5
"""The way back lies within this many accuracies of the way that was flown."""

STEP_M = 0.1
"""Accuracies are told in such steps."""

SPARE_POINTS = 60
"""Points that are kept before they are looked through again, and the ten with which it is."""

ROUNDING = 1 + 1e-6
"""Parameters travel in single precision."""

MOST_POINTS = 500
"""No vehicle can be set to remember a longer path."""

SAMPLE_S = 1 / 3
"""Points are kept three times a second at most."""


def largest_accuracy_m(plan: Plan) -> float:
    """Largest accuracy with which the way back keeps hull and surfaces apart by the errors of position and model.

    Returns:
        In steps of `STEP_M`; 0 where the plan flies too close for any.
    """
    safety = plan.scenario.safety
    spare = plan.certificates.min_clearance_m - safety.position_m - safety.model_m - 2 * safety.tracking_m
    return max(round(math.floor(spare / STRAYS / STEP_M + 1e-9) * STEP_M, 3), 0.0)


def points_needed(trajectory: PiecewisePolynomial, accuracy_m: float) -> int:
    """How many points a vehicle needs to remember a whole flight, loops not cut.

    Args:
        trajectory: as it is flown.
        accuracy_m: positive.
    """
    count = max(2, math.ceil(trajectory.duration_s / SAMPLE_S))
    path = trajectory.value(np.linspace(0.0, trajectory.duration_s, count + 1))
    kept = [0]
    for n in range(1, len(path)):
        if np.linalg.norm(path[n] - path[kept[-1]]) >= accuracy_m:
            kept.append(n)
    return int(straightened(path[kept], accuracy_m / 2).sum()) + SPARE_POINTS


def straightened(path_m: NDArray[np.float64], within_m: float) -> NDArray[np.bool_]:
    """Which points of a polyline (N, 3) are needed so that none is further than a distance from what is left, (N,)."""
    needed = np.zeros(len(path_m), dtype=np.bool_)
    needed[[0, -1]] = True
    open_ = [(0, len(path_m) - 1)]
    while open_:
        first, last = open_.pop()
        if last - first < 2:
            continue
        inner, a, b = path_m[first + 1 : last], path_m[first], path_m[last]
        along = b - a
        share = np.clip((inner - a) @ along / max(float(along @ along), 1e-12), 0.0, 1.0)
        off = np.linalg.norm(inner - a - share[:, None] * along, axis=1)
        furthest = int(off.argmax())
        if off[furthest] > within_m:
            middle = first + 1 + furthest
            needed[middle] = True
            open_ += [(first, middle), (middle, last)]
    return needed


def memory_settings(plan: Plan, memory: RetraceMemory | None) -> str | None:
    """Parameters with which the way back along the flown path would be safe, in words; empty when they are set so.

    Args:
        plan: what is flown.
        memory: of the vehicle; None when it has none or does not tell.

    Returns:
        None when there are no such parameters.
    """
    most = largest_accuracy_m(plan)
    if memory is None or most <= 0.0:
        return None
    if not retrace_problem(plan, memory):
        return ""
    accuracy = memory.accuracy_m if 0.0 < memory.accuracy_m <= most * ROUNDING else most
    needed = points_needed(plan.trajectory, accuracy)
    if needed > MOST_POINTS:
        accuracy, needed = most, points_needed(plan.trajectory, most)
    if needed > MOST_POINTS:
        return None
    settings = [] if accuracy == memory.accuracy_m else [f"{memory.accuracy_name} {accuracy:g}"]
    return ", ".join([*settings, f"{memory.points_name} {needed}"] if needed > memory.points else settings)


def retrace_problem(plan: Plan, memory: RetraceMemory | None) -> str:
    """Why the way back along the flown path is not safe; empty when it is.

    Args:
        plan: what is flown.
        memory: of the vehicle; None when it has none or does not tell.
    """
    if memory is None:
        return "the vehicle does not tell that it remembers its path"
    most = largest_accuracy_m(plan)
    if most <= 0.0:
        return "the plan flies too close to the structure for a way back that is not exactly the way there"
    if not 0.0 < memory.accuracy_m <= most * ROUNDING:
        return f"the remembered path is {memory.accuracy_m:g} m accurate, the plan allows {most:.1f} m"
    needed = points_needed(plan.trajectory, memory.accuracy_m)
    if needed > memory.points:
        return f"the path needs {needed} points of memory, the vehicle has {memory.points}"
    return ""
