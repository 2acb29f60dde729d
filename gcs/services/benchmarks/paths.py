"""Benchmark `paths`: optimal grid search, pulled paths round a box against a closed form, stays, a whole yard."""

from __future__ import annotations

import math
from importlib.util import find_spec
from typing import TYPE_CHECKING

import numpy as np
import trimesh

from gcs.core.structure import Structure
from gcs.planning.paths.path_search import find_path
from gcs.planning.paths.string_pulling import path_length
from gcs.planning.scene.distance_field import build_distance_field
from gcs.planning.scene.free_space import FreeSpace
from gcs.planning.scene.grid_search import GridSearch
from gcs.services.benchmarks.row import Row, milliseconds
from gcs.services.benchmarks.stay_legs import stay_legs
from gcs.services.benchmarks.yard_tour import yard_tour

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

QUERIES = 40
REFERENCE_QUERIES = 5
RUNS = 3
REFERENCE = "scikit-image"

BODY_HEIGHT_M = 80.0
CYLINDER_SIDES = 512
"""So many that the way round them is that round a circle, but for a part in 50,000."""


def run(quick: bool) -> list[Row]:
    """Measure.

    Args:
        quick: small grids and few queries.
    """
    shapes = [(60, 60, 30)] if quick else [(200, 200, 100), (500, 500, 200)]
    rows = [row for shape in shapes for row in _grid_case(shape, quick)]
    return [*rows, *_any_angle_case(2 if quick else 12), *stay_legs(quick), *yard_tour(quick)]


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
    times = [_least_ms(lambda a=a, b=b: grid.search(free, a, b)) for a, b in ends]  # type: ignore[misc]
    reference = None
    if find_spec("skimage") and not quick and math.prod(shape) <= 4_000_000:
        reference = _scikit_image_ms(free, ends[:REFERENCE_QUERIES])
    return [
        Row(case, "median_ms", float(np.median(times)), "ms", REFERENCE, reference),
        Row(case, "p95_ms", float(np.percentile(times, 95)), "ms", REFERENCE, None),
    ]


def _least_ms(search: Callable[[], object]) -> float:
    """Of a few runs: what else goes on on the machine is not the search's time."""
    return min(milliseconds(search) for _ in range(RUNS))


def _scikit_image_ms(free: NDArray[np.bool_], ends: NDArray[np.int64]) -> float:
    from skimage.graph import MCP_Geometric  # type: ignore[import-not-found, unused-ignore]

    costs = np.where(free, 1.0, -1.0)
    times = [
        milliseconds(lambda a=a, b=b: MCP_Geometric(costs).find_costs([tuple(a)], [tuple(b)]))  # type: ignore[misc]
        for a, b in ends
    ]
    return float(np.median(times))


def length_round_box(half_x: float, half_y: float, aside: float, clearance: float) -> float:
    """Length of the shortest way from (-aside, 0) to (aside, 0) round a box about the origin, at a clearance.

    Two tangents to the circles about the corners, two arcs on them, and the straight between the arcs.
    """
    to_corner = math.hypot(aside - half_x, half_y)
    heading = math.atan2(half_y, aside - half_x) + math.asin(clearance / to_corner)
    return 2 * (math.sqrt(to_corner**2 - clearance**2) + clearance * heading + half_x)


def length_round_cylinder(radius: float, aside: float, clearance: float) -> float:
    """Length of the shortest way from (-aside, 0) to (aside, 0) round a cylinder about the origin, at a clearance.

    Two tangents, and the arc between them.
    """
    kept = radius + clearance
    return 2 * (math.sqrt(aside**2 - kept**2) + kept * math.asin(kept / aside))


def _any_angle_case(bodies: int) -> list[Row]:
    """Upright boxes and cylinders, anyhow turned and placed on the grid, between two places at different heights.

    The way round an upright body is on a developable surface: the difference of heights adds at right angles.
    """
    rng = np.random.default_rng(2)
    excess, times = [], []
    for body in range(2 * bodies):
        clearance = rng.uniform(1.5, 3.0)
        if body < bodies:
            half_x, half_y = rng.uniform(1.0, 6.0), rng.uniform(3.0, 8.0)
            aside = half_x + rng.uniform(6.0, 14.0)
            level = length_round_box(half_x, half_y, aside, clearance)
            mesh = trimesh.creation.box(extents=(2 * half_x, 2 * half_y, BODY_HEIGHT_M))
        else:
            radius = rng.uniform(2.0, 8.0)
            aside = radius + clearance + rng.uniform(2.0, 8.0)
            level = length_round_cylinder(radius, aside, clearance)
            mesh = trimesh.creation.cylinder(radius, BODY_HEIGHT_M, sections=CYLINDER_SIDES)
        turn, shift = rng.uniform(0.0, math.pi), rng.uniform(-0.5, 0.5, 3)
        rise = rng.uniform(-6.0, 6.0)
        mesh.apply_transform(trimesh.transformations.rotation_matrix(turn, (0, 0, 1)))
        mesh.apply_translation(shift)
        along = np.array([math.cos(turn) * aside, math.sin(turn) * aside, rise / 2])
        start, goal = shift - along, shift + along
        structure = Structure(np.asarray(mesh.vertices, dtype=np.float64), np.asarray(mesh.faces, dtype=np.int64))
        field = build_distance_field(structure, (-25.0, -25.0, -42.0), (25.0, 25.0, 42.0), 0.5)
        space = FreeSpace(field, clearance, None, start - (0.0, 0.0, 10.0))
        path = find_path(space, start, goal, prefer_open_sky=False)
        times.append(_least_ms(lambda s=space, a=start, b=goal: find_path(s, a, b, False)))  # type: ignore[misc]
        excess.append(path_length(path) / math.hypot(level, rise) - 1)
    case = "any-angle-closed-form"
    return [
        Row(case, "median_ms", float(np.median(times)), "ms"),
        Row(case, "p95_ms", float(np.percentile(times, 95)), "ms"),
        Row(case, "excess_length", float(np.max(excess)), "1", "closed form", 0.0),
        Row(case, "mean_excess_length", float(np.mean(excess)), "1", "closed form", 0.0),
    ]
