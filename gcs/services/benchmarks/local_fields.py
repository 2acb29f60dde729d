"""Random fields of convex obstacles, and the exact shortest way in them by a method of its own.

The oracle tests every pair of corners against every obstacle by separating axes and takes the shortest way over the
visibility graph; it shares no code with the planner.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import ConvexHull

from gcs.planning.numerics.compiled import compiled

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

SIDE_M = 60.0
FEWEST, MOST = 5, 40
SLACK_M = 1e-7
"""What overlaps by less only touches."""

Floats = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Ints = np.ndarray[tuple[int, ...], np.dtype[np.int64]]
Marks = np.ndarray[tuple[int, ...], np.dtype[np.bool_]]


class Field(NamedTuple):
    """A query among obstacles: start and goal (2,), and the corners of each polygon, counter-clockwise."""

    start_m: NDArray[np.float64]
    goal_m: NDArray[np.float64]
    polygons_m: list[NDArray[np.float64]]


def random_field(rng: np.random.Generator) -> Field:
    """A field of 5 to 40 polygons of 3 to 9 corners, that may overlap, and two free places on opposite sides of it."""
    polygons = [_random_polygon(rng) for _ in range(rng.integers(FEWEST, MOST + 1))]
    return Field(_free_place(rng, 0.0, polygons), _free_place(rng, 0.9 * SIDE_M, polygons), polygons)


def _random_polygon(rng: np.random.Generator) -> NDArray[np.float64]:
    points = rng.uniform(-1.0, 1.0, (rng.integers(3, 13), 2)) * rng.uniform(1.5, 6.0, 2)
    hull: NDArray[np.float64] = points[ConvexHull(points).vertices] + rng.uniform(0.1 * SIDE_M, 0.9 * SIDE_M, 2)
    return hull


def _free_place(rng: np.random.Generator, west: float, polygons: Sequence[NDArray[np.float64]]) -> NDArray[np.float64]:
    while True:
        place = rng.uniform((west, 0.1 * SIDE_M), (west + 0.1 * SIDE_M, 0.9 * SIDE_M))
        if not any(_contains(polygon, place) for polygon in polygons):
            return place


def _contains(polygon: NDArray[np.float64], place: NDArray[np.float64]) -> bool:
    edge, away = np.roll(polygon, -1, axis=0) - polygon, place - polygon
    return bool((edge[:, 0] * away[:, 1] - edge[:, 1] * away[:, 0] > -SLACK_M).all())


def exact_length(field: Field) -> float:
    """Length (m) of the shortest way by the whole visibility graph; infinity when there is none."""
    nodes = np.concatenate([*field.polygons_m, field.start_m[None], field.goal_m[None]])
    first, corners = _packed(field.polygons_m)
    ends = np.stack(np.triu_indices(len(nodes), 1), axis=1)
    free = ends[_free_segments(nodes[ends[:, 0]], nodes[ends[:, 1]], first, corners)]
    graph = np.full((len(nodes), len(nodes)), np.inf)
    graph[free[:, 0], free[:, 1]] = np.linalg.norm(nodes[free[:, 0]] - nodes[free[:, 1]], axis=1)
    return float(dijkstra(graph, directed=False, indices=np.array(len(nodes) - 2)).ravel()[-1])


def collides(path_m: NDArray[np.float64], polygons_m: Sequence[NDArray[np.float64]]) -> bool:
    """Whether a polyline (K, 2) enters a polygon."""
    return not bool(_free_segments(path_m[:-1], path_m[1:], *_packed(polygons_m)).all())


def _packed(polygons_m: Sequence[NDArray[np.float64]]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    first = np.cumsum([0, *[len(polygon) for polygon in polygons_m]])
    return first, np.concatenate(polygons_m)


@compiled
def _free_segments(a: Floats, b: Floats, first: Ints, corners: Floats) -> Marks:
    """Which segments enter no polygon: for each there is an axis on which the two do not overlap."""
    free = np.ones(len(a), np.bool_)
    for s in range(len(a)):
        for k in range(len(first) - 1):
            if not _apart(a[s], b[s], corners[first[k] : first[k + 1]]):
                free[s] = False
                break
    return free


@compiled
def _apart(a: Floats, b: Floats, polygon: Floats) -> bool:
    """Tries the normals of the polygon's edges and that of the segment."""
    n = len(polygon)
    for i in range(n + 1):
        dx, dy = b[0] - a[0], b[1] - a[1]
        if i < n:
            dx, dy = polygon[(i + 1) % n, 0] - polygon[i, 0], polygon[(i + 1) % n, 1] - polygon[i, 1]
        size = np.hypot(dx, dy)
        if size == 0.0:
            continue
        nx, ny = dy / size, -dx / size
        one, other = nx * a[0] + ny * a[1], nx * b[0] + ny * b[1]
        low, high = np.inf, -np.inf
        for c in range(n):
            along = nx * polygon[c, 0] + ny * polygon[c, 1]
            low, high = min(low, along), max(high, along)
        if max(one, other) <= low + SLACK_M or min(one, other) >= high - SLACK_M:
            return True
    return False
