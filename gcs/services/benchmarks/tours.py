"""Benchmark `tours`: cost, proven lower bound and gap in the bridge tower's metric `sqrt(dx^2 + dy^2 + 3 dz^2)`."""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING

import numpy as np

from gcs.planning.tour_bound import tour_lower_bound
from gcs.planning.tour_solver import solve_closed_tour, tour_cost, with_free_node
from gcs.services.benchmarks.row import Row

if TYPE_CHECKING:
    from numpy.typing import NDArray

CLIMB_WEIGHT = 3.0
FACE_WIDTH, FACE_HEIGHT = 4, 88


def run(quick: bool) -> list[Row]:
    """Measure.

    Args:
        quick: a small random set.
    """
    face = np.array([[x, 0, z] for x in range(FACE_WIDTH) for z in range(FACE_HEIGHT)], dtype=np.float64)
    cells, dearer = len(face), math.sqrt(CLIMB_WEIGHT) - 1
    least_open = cells - 1 + dearer * (FACE_HEIGHT - 1)
    least_closed = cells + dearer * 2 * (FACE_HEIGHT - 1)
    count = 100 if quick else 680
    spots = np.random.default_rng(0).uniform(0.0, 100.0, (count, 3))
    return [
        *_case("face-4x88-open", with_free_node(_costs(face)), least_open),
        *_case("face-4x88-closed", _costs(face), least_closed),
        *_case(f"random-{count}", _costs(spots), None),
    ]


def _costs(points: NDArray[np.float64]) -> NDArray[np.float64]:
    scaled = points * [1.0, 1.0, math.sqrt(CLIMB_WEIGHT)]
    return np.asarray(np.linalg.norm(scaled[:, None] - scaled[None], axis=-1))


def _case(case: str, costs: NDArray[np.float64], optimum: float | None) -> list[Row]:
    begin = time.perf_counter()
    order = solve_closed_tour(costs)
    seconds = time.perf_counter() - begin
    cost = tour_cost(costs, order)
    bound = min(tour_lower_bound(costs, cost), cost)
    counted = None if optimum is None else "counting bound"
    return [
        Row(case, "cost", cost, "1", counted, optimum),
        Row(case, "lower_bound", bound, "1", counted, optimum),
        Row(case, "gap", cost / bound - 1, "1"),
        Row(case, "seconds", seconds, "s"),
    ]
