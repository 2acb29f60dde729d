"""Benchmark `paths`: optimal grid search in a container yard, and pulled paths round a box against a closed form."""

from __future__ import annotations

import math
import time
from importlib.util import find_spec
from typing import TYPE_CHECKING

import numpy as np
import trimesh

from gcs.core.structure import Structure
from gcs.planning.distance_field import build_distance_field
from gcs.planning.free_space import FreeSpace
from gcs.planning.grid_search import GridSearch
from gcs.planning.path_search import find_path
from gcs.planning.string_pulling import path_length
from gcs.services.benchmarks.row import Row, milliseconds

if TYPE_CHECKING:
    from numpy.typing import NDArray

QUERIES = 40
REFERENCE_QUERIES = 3
REFERENCE = "scikit-image"


def run(quick: bool) -> list[Row]:
    """Measure.

    Args:
        quick: small grids and few queries.
    """
    shapes = [(60, 60, 30)] if quick else [(200, 200, 100), (500, 500, 200)]
    rows = [row for shape in shapes for row in _grid_case(shape, quick)]
    return rows + _any_angle_case(boxes=2 if quick else 12)


def container_yard(shape: tuple[int, ...], seed: int = 0) -> NDArray[np.bool_]:
    """Free cells of a yard of 60 stacks of containers and 3 gantries."""
    rng = np.random.default_rng(seed)
    nx, ny, nz = shape
    free = np.ones(shape, dtype=np.bool_)
    for _ in range(60):
        west, south = rng.integers(0, nx), rng.integers(0, ny)
        free[west : west + nx // 16, south : south + ny // 40, : rng.integers(nz // 10, nz // 2)] = False
    for x in (nx // 5, nx // 2, 4 * nx // 5):
        free[x : x + nx // 40, ny // 10 : ny // 8, : 4 * nz // 5] = False
        free[x : x + nx // 40, -ny // 8 : -ny // 10, : 4 * nz // 5] = False
        free[x : x + nx // 40, ny // 10 : -ny // 10, 7 * nz // 10 : 4 * nz // 5] = False
    return free


def _grid_case(shape: tuple[int, ...], quick: bool) -> list[Row]:
    case = "grid-" + "x".join(str(n) for n in shape)
    free = container_yard(shape)
    cells = np.argwhere(free)
    ends = cells[np.random.default_rng(1).integers(0, len(cells), (5 if quick else QUERIES, 2))]
    grid = GridSearch(shape)
    grid.search(free, ends[0, 0], ends[0, 1])  # loads the compiled kernels
    times = [milliseconds(lambda a=a, b=b: grid.search(free, a, b)) for a, b in ends]  # type: ignore[misc]
    reference = None
    if find_spec("skimage") and not quick and math.prod(shape) <= 4_000_000:
        reference = _scikit_image_ms(free, ends[:REFERENCE_QUERIES])
    return [
        Row(case, "median_ms", float(np.median(times)), "ms", REFERENCE, reference),
        Row(case, "p95_ms", float(np.percentile(times, 95)), "ms", REFERENCE, None),
    ]


def _scikit_image_ms(free: NDArray[np.bool_], ends: NDArray[np.int64]) -> float:
    from skimage.graph import MCP_Geometric  # type: ignore[import-not-found, unused-ignore]

    costs = np.where(free, 1.0, -1.0)
    times = [
        milliseconds(lambda a=a, b=b: MCP_Geometric(costs).find_costs([tuple(a)], [tuple(b)]))  # type: ignore[misc]
        for a, b in ends
    ]
    return float(np.median(times))


def shortest_way_round(half_x: float, half_y: float, start_x: float, clearance: float) -> float:
    """Length of the shortest way from (-start_x, 0) to (start_x, 0) round a box about the origin, at a clearance.

    Two tangents to the circles about the corners, two arcs on them, and the straight between the arcs.
    """
    to_corner = math.hypot(start_x - half_x, half_y)
    heading = math.atan2(half_y, start_x - half_x) + math.asin(clearance / to_corner)
    return 2 * (math.sqrt(to_corner**2 - clearance**2) + clearance * heading + half_x)


def _any_angle_case(boxes: int) -> list[Row]:
    rng = np.random.default_rng(2)
    excess, times = [], []
    for _ in range(boxes):
        half_x, half_y = rng.uniform(1.0, 6.0), rng.uniform(3.0, 8.0)
        start_x, clearance = half_x + rng.uniform(6.0, 15.0), rng.uniform(1.5, 3.0)
        box = trimesh.creation.box(extents=(2 * half_x, 2 * half_y, 80.0))
        structure = Structure(np.asarray(box.vertices, dtype=np.float64), np.asarray(box.faces, dtype=np.int64))
        field = build_distance_field(structure, (-25.0, -20.0, -45.0), (25.0, 20.0, 45.0), 0.5)
        space = FreeSpace(field, clearance, None, (-start_x, 0.0, -20.0))
        start, goal = np.array([-start_x, 0.0, 0.0]), np.array([start_x, 0.0, 0.0])
        find_path(space, start, goal, prefer_open_sky=False)
        begin = time.perf_counter()
        path = find_path(space, start, goal, prefer_open_sky=False)
        times.append(1e3 * (time.perf_counter() - begin))
        excess.append(path_length(path) / shortest_way_round(half_x, half_y, start_x, clearance) - 1)
    case = "any-angle-closed-form"
    return [
        Row(case, "median_ms", float(np.median(times)), "ms"),
        Row(case, "p95_ms", float(np.percentile(times, 95)), "ms"),
        Row(case, "excess_length", float(np.mean(excess)), "1", "closed form", 0.0),
        Row(case, "largest_excess_length", float(np.max(excess)), "1", "closed form", 0.0),
    ]
