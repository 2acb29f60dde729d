"""Exact distances of points to triangles, cables and the ground."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from gcs.planning.numerics.compiled import compiled
from gcs.planning.numerics.thread_pieces import in_pieces
from gcs.planning.scene.bounding_volumes import STACK_SIZE, BoundingVolumes, build_bounding_volumes

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from gcs.core.structure import Structure

LEAST_POINTS = 512
"""Fewest points that are worth a thread."""

Floats = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

_NO_CABLES, _NO_RADII = np.zeros((0, 2, 3)), np.zeros(0)


@compiled
def _segment_distance_squared(p: Floats, a: Floats, b: Floats) -> float:
    length_squared = 0.0
    along = 0.0
    for k in range(3):
        length_squared += (b[k] - a[k]) ** 2
        along += (p[k] - a[k]) * (b[k] - a[k])
    t = 0.0
    if length_squared > 0.0:
        t = min(max(along / length_squared, 0.0), 1.0)
    result: float = 0.0
    for k in range(3):
        result += (p[k] - a[k] - t * (b[k] - a[k])) ** 2
    return float(result)


@compiled
def _triangle_distance_squared(p: Floats, triangle: Floats) -> float:
    """Distance to the plane where the foot lies inside, else to the nearest edge; slivers end up at their edges."""
    a, b, c = triangle[0], triangle[1], triangle[2]
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    wx, wy, wz = p[0] - a[0], p[1] - a[1], p[2] - a[2]
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    nn = nx * nx + ny * ny + nz * nz
    if nn > 0.0:
        # barycentric coordinates of the foot, times nn: (u x w).n and (w x v).n
        beta = (wy * vz - wz * vy) * nx + (wz * vx - wx * vz) * ny + (wx * vy - wy * vx) * nz
        gamma = (uy * wz - uz * wy) * nx + (uz * wx - ux * wz) * ny + (ux * wy - uy * wx) * nz
        if beta >= 0.0 and gamma >= 0.0 and beta + gamma <= nn:
            h = wx * nx + wy * ny + wz * nz
            return float(h * h / nn)
    edges = min(_segment_distance_squared(p, a, b), _segment_distance_squared(p, b, c))
    return float(min(edges, _segment_distance_squared(p, c, a)))


@compiled
def _box_distance_squared(p: Floats, low: Floats, high: Floats) -> float:
    result: float = 0.0
    for k in range(3):
        gap = max(low[k] - p[k], 0.0, p[k] - high[k])
        result += gap * gap
    return float(result)


@compiled
def nearest_surface(p: Floats, limit: float, triangles: Floats, tree: BoundingVolumes) -> float:
    """Distance (m) of a point (3,) to the nearest triangle, at most `limit`.

    Args:
        p: the point.
        limit: nothing further than this is looked for.
        triangles: corners in the order of the tree's leaves, shape (F, 3, 3).
        tree: boxes about the triangles.
    """
    stack = np.empty(STACK_SIZE, np.int64)
    stack_distance = np.empty(STACK_SIZE)
    best = limit * limit
    stack[0] = 0
    stack_distance[0] = _box_distance_squared(p, tree.low[0], tree.high[0])
    top = 1
    while top > 0:
        top -= 1
        node = stack[top]
        if stack_distance[top] >= best:
            continue
        if tree.size[node] > 0:
            for j in range(tree.first[node], tree.first[node] + tree.size[node]):
                best = min(best, _triangle_distance_squared(p, triangles[j]))
            continue
        near = tree.first[node]
        far = near + 1
        near_distance = _box_distance_squared(p, tree.low[near], tree.high[near])
        far_distance = _box_distance_squared(p, tree.low[far], tree.high[far])
        if far_distance < near_distance:
            near, far = far, near
            near_distance, far_distance = far_distance, near_distance
        if far_distance < best:
            stack[top] = far
            stack_distance[top] = far_distance
            top += 1
        if near_distance < best:
            stack[top] = near
            stack_distance[top] = near_distance
            top += 1
    return math.sqrt(best)


@compiled
def nearest_cable(p: Floats, ends: Floats, radii: Floats) -> float:
    """Distance (m) of a point (3,) to the nearest cable's hull, 0 inside; inf without cables."""
    nearest = math.inf
    for c in range(ends.shape[0]):
        axis = math.sqrt(_segment_distance_squared(p, ends[c, 0], ends[c, 1]))
        nearest = min(nearest, max(axis - radii[c], 0.0))
    return nearest


@compiled
def _nearest(
    points: Floats,
    limit: Floats,
    triangles: Floats,
    tree: BoundingVolumes,
    ends: Floats,
    radii: Floats,
    result: Floats,
    first: int,
    end: int,
) -> None:
    for i in range(first, end):
        surface = nearest_surface(points[i], limit[i], triangles, tree)
        result[i] = min(surface, nearest_cable(points[i], ends, radii))


def _as_points(points: ArrayLike) -> Floats:
    return np.ascontiguousarray(np.asarray(points, dtype=np.float64).reshape(-1, 3))


class TriangleDistance:
    """Distance to a set of triangles by a tree of boxes; exact to rounding.

    Args:
        triangles_m: corners, shape (F, 3, 3), F > 0.

    Attributes:
        tree: boxes about the triangles.
        triangles_m: corners in the order of the tree's leaves, shape (F, 3, 3).
    """

    def __init__(self, triangles_m: NDArray[np.float64]) -> None:
        triangles = np.ascontiguousarray(triangles_m, dtype=np.float64)
        self.tree = build_bounding_volumes(triangles)
        self.triangles_m = triangles[self.tree.order]

    def distance(self, points: ArrayLike, limit: ArrayLike = math.inf) -> NDArray[np.float64]:
        """Distances (m) of points.

        Args:
            points: shape (N, 3).
            limit: nothing further than this is looked for (a number or one a point); what is further comes back as
                `limit`. A small limit is fast.

        Returns:
            Shape (N,).
        """
        return _distances(points, limit, self, _NO_CABLES, _NO_RADII)


def _distances(
    points: ArrayLike, limit: ArrayLike, surfaces: TriangleDistance, ends: Floats, radii: Floats
) -> NDArray[np.float64]:
    p = _as_points(points)
    result = np.empty(len(p))
    limits = np.ascontiguousarray(np.broadcast_to(np.asarray(limit, dtype=np.float64), (len(p),)))
    in_pieces(
        lambda first, end: _nearest(p, limits, surfaces.triangles_m, surfaces.tree, ends, radii, result, first, end),
        len(p),
        LEAST_POINTS,
    )
    return result


class SceneDistance:
    """Distance to everything that may not be touched: triangles, hulls of cables, and the ground plane.

    Args:
        structure: what stands in the scene.
        ground_m: height of the flat ground; None when there is none.

    Attributes:
        surfaces: the triangles alone.
        ground_m: as given.
    """

    def __init__(self, structure: Structure, ground_m: float | None) -> None:
        self.surfaces = TriangleDistance(structure.triangles_m)
        self._cable_ends = np.ascontiguousarray(structure.cable_ends_m)
        self._cable_radii = np.ascontiguousarray(structure.cable_radii_m)
        self.ground_m = ground_m

    def distance(
        self, points: ArrayLike, *, ground: bool | NDArray[np.bool_] = True, limit: ArrayLike = math.inf
    ) -> NDArray[np.float64]:
        """Distances (m) of points to the nearest surface; 0 inside a cable, negative below the ground.

        Args:
            points: scene ENU, shape (N, 3).
            ground: whether the ground counts; one flag, or one a point (the column over home is exempt).
            limit: as in `TriangleDistance.distance`.

        Returns:
            Shape (N,).
        """
        p = _as_points(points)
        result = _distances(p, limit, self.surfaces, self._cable_ends, self._cable_radii)
        if self.ground_m is not None:
            height = p[:, 2] - self.ground_m
            result = np.where(np.asarray(ground), np.minimum(result, height), result)
        return result
