"""Convex obstacles in the plane, packed into arrays for kernels."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from gcs.core.errors import InputError
from gcs.planning.numerics.compiled import compiled

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike, NDArray

TOUCH_M = 1e-9
"""What reaches no deeper into an obstacle than this only touches it."""

Floats = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Ints = np.ndarray[tuple[int, ...], np.dtype[np.int64]]


class PackedPolygons(NamedTuple):
    """Polygons for kernels: polygon k has the corners and edges `first[k]` to `first[k + 1] - 1`.

    Attributes:
        first: shape (P + 1,).
        corners: counter-clockwise, m, shape (V, 2).
        planes: outward unit normal and offset of the edge that begins in each corner, shape (V, 3).
        circles: middle and radius of a circle that holds each polygon, shape (P, 3).
    """

    first: Ints
    corners: Floats
    planes: Floats
    circles: Floats


@dataclass(frozen=True, eq=False)
class ConvexObstacles:
    """Convex polygons that may overlap; already grown by all that has to be kept from them.

    Attributes:
        polygons_m: corners of each, counter-clockwise, scene ENU m, shape (n, 2) with n >= 3. Use `of` to make it from
            what is not known to be good.
    """

    polygons_m: tuple[NDArray[np.float64], ...]

    @classmethod
    def of(cls, polygons_m: Sequence[ArrayLike]) -> ConvexObstacles:
        """Check polygons and bring them into order.

        Args:
            polygons_m: corners of each in either sense of rotation, shape (n, 2).

        Raises:
            InputError: a polygon with fewer than three corners, without area, not convex or not finite; it names it.
        """
        return cls(tuple(_checked(number, polygon) for number, polygon in enumerate(polygons_m)))

    @cached_property
    def packed(self) -> PackedPolygons:
        """The same for kernels."""
        counts = [len(polygon) for polygon in self.polygons_m]
        first = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
        corners = np.concatenate([np.empty((0, 2)), *self.polygons_m])
        return _packed(first, corners)


@compiled
def _packed(first: Ints, corners: Floats) -> PackedPolygons:
    planes = np.empty((len(corners), 3))
    circles = np.zeros((len(first) - 1, 3))
    for k in range(len(first) - 1):
        begin, end = first[k], first[k + 1]
        for i in range(begin, end):
            follower = i + 1 if i + 1 < end else begin
            dx, dy = corners[follower, 0] - corners[i, 0], corners[follower, 1] - corners[i, 1]
            size = np.hypot(dx, dy)
            planes[i, 0], planes[i, 1] = dy / size, -dx / size
            planes[i, 2] = planes[i, 0] * corners[i, 0] + planes[i, 1] * corners[i, 1]
            circles[k, 0] += corners[i, 0] / (end - begin)
            circles[k, 1] += corners[i, 1] / (end - begin)
        for i in range(begin, end):
            reach = np.hypot(corners[i, 0] - circles[k, 0], corners[i, 1] - circles[k, 1])
            circles[k, 2] = max(circles[k, 2], reach)
    return PackedPolygons(first, corners, planes, circles)


def _checked(number: int, polygon_m: ArrayLike) -> NDArray[np.float64]:
    corners = np.asarray(polygon_m, dtype=np.float64)
    field = f"obstacle {number}"
    if corners.ndim != 2 or corners.shape[1:] != (2,) or len(corners) < 3 or not np.isfinite(corners).all():
        raise InputError("an obstacle needs three or more corners of two finite numbers", field=field)
    edges = np.roll(corners, -1, axis=0) - corners
    following = np.roll(edges, -1, axis=0)
    turns = edges[:, 0] * following[:, 1] - edges[:, 1] * following[:, 0]
    angles = np.arctan2(turns, (edges * following).sum(axis=1))
    if (turns < 0).all():
        return _checked(number, corners[::-1])
    # Once round: a star turns the same way at every corner too, but twice.
    if not ((turns > 0).all() and abs(angles.sum() - 2 * np.pi) < 1e-6):
        raise InputError("it is not convex, or three of its corners are in a line: give its convex hull", field=field)
    return np.ascontiguousarray(corners)


@compiled
def inside_polygons(x: float, y: float, polygons: PackedPolygons, depth_m: float) -> bool:
    """Whether a point is deeper than `depth_m` in some polygon."""
    for k in range(len(polygons.first) - 1):
        cx, cy, radius = polygons.circles[k]
        if (x - cx) ** 2 + (y - cy) ** 2 > radius * radius:
            continue
        inside = True
        for i in range(polygons.first[k], polygons.first[k + 1]):
            if polygons.planes[i, 0] * x + polygons.planes[i, 1] * y > polygons.planes[i, 2] - depth_m:
                inside = False
                break
        if inside:
            return True
    return False


@compiled
def clear_of_polygons(ax: float, ay: float, bx: float, by: float, polygons: PackedPolygons) -> bool:
    """Whether a straight stays out of all polygons; it may touch them."""
    dx, dy = bx - ax, by - ay
    square = dx * dx + dy * dy
    for k in range(len(polygons.first) - 1):
        cx, cy, radius = polygons.circles[k]
        along = 0.0
        if square > 0.0:
            along = min(max(((cx - ax) * dx + (cy - ay) * dy) / square, 0.0), 1.0)
        if (ax + along * dx - cx) ** 2 + (ay + along * dy - cy) ** 2 >= radius * radius:
            continue
        enter, leave = 0.0, 1.0
        for i in range(polygons.first[k], polygons.first[k + 1]):
            nx, ny, offset = polygons.planes[i]
            outside = nx * ax + ny * ay - (offset - TOUCH_M)
            speed = nx * dx + ny * dy
            if speed < 0.0:
                enter = max(enter, -outside / speed)
            elif speed > 0.0:
                leave = min(leave, -outside / speed)
            elif outside >= 0.0:
                leave = -1.0
            if enter >= leave:
                break
        if enter < leave:
            return False
    return True
