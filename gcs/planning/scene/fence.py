"""The fence as the planner keeps it: polygons and a height, less the vehicle's size and its position errors."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from gcs.planning.numerics.compiled import compiled

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from gcs.core.scenario import Fence, Safety, VehicleSpec

Floats = np.ndarray[tuple[int, ...], np.dtype[np.float64]]


class FenceVolume(NamedTuple):
    """A fence as arrays (a named tuple, so that kernels can take it).

    Attributes:
        corners: corners of all polygons one after the other, the included ones first, scene ENU, shape (K, 2).
        first: first corner of each polygon, and the end of the last, shape (P + 1,).
        included: how many of the polygons include.
        max_height_m: highest z of the hull in the scene; infinite without a limit.
        margin_m: what the vehicle's centre keeps from every edge: hull radius, tracking and position error.
    """

    corners: NDArray[np.float64]
    first: NDArray[np.int64]
    included: int
    max_height_m: float
    margin_m: float


def fence_volume(fence: Fence | None, vehicle: VehicleSpec, safety: Safety) -> FenceVolume:
    """The fence of a scenario with its margin; without a fence everything is inside."""
    include = fence.include if fence else ()
    polygons = [np.asarray(p, dtype=np.float64) for p in (*include, *(fence.exclude if fence else ()))]
    height = fence.max_height_m if fence else None
    return FenceVolume(
        corners=np.concatenate(polygons) if polygons else np.zeros((0, 2)),
        first=np.cumsum([0, *(len(p) for p in polygons)], dtype=np.int64),
        included=len(include),
        max_height_m=math.inf if height is None else float(height),
        margin_m=vehicle.radius_m + safety.tracking_m + safety.position_m,
    )


def room_in_fence(points: ArrayLike, fence: FenceVolume) -> NDArray[np.float64]:
    """How far (m) centres can move before they come nearer to the fence than its margin.

    Args:
        points: scene ENU, shape (N, 3).
        fence: what to stay in.

    Returns:
        Shape (N,); negative outside or too near; a lower bound where included polygons overlap; it changes by at
        most the distance moved.
    """
    p = np.ascontiguousarray(np.asarray(points, dtype=np.float64).reshape(-1, 3))
    return _rooms(p, fence)


@compiled
def _rooms(points: Floats, fence: FenceVolume) -> Floats:
    result = np.empty(points.shape[0])
    for i in range(points.shape[0]):
        result[i] = fence_room(points[i, 0], points[i, 1], points[i, 2], fence)
    return result


@compiled
def fence_room(x: float, y: float, z: float, fence: FenceVolume) -> float:
    """Kernel of `room_in_fence` for one point."""
    room = fence.max_height_m - z
    if fence.included > 0:
        inside = -math.inf
        for k in range(fence.included):
            inside = max(inside, _signed_depth(x, y, fence.corners[fence.first[k] : fence.first[k + 1]]))
        room = min(room, inside)
    for k in range(fence.included, fence.first.shape[0] - 1):
        room = min(room, -_signed_depth(x, y, fence.corners[fence.first[k] : fence.first[k + 1]]))
    return room - fence.margin_m


@compiled
def _signed_depth(x: float, y: float, corners: Floats) -> float:
    """Distance to a polygon's edge, positive inside (even-odd rule)."""
    nearest = math.inf
    inside = False
    n = corners.shape[0]
    for i in range(n):
        ax, ay = corners[i, 0], corners[i, 1]
        bx, by = corners[(i + 1) % n, 0], corners[(i + 1) % n, 1]
        ux, uy, wx, wy = bx - ax, by - ay, x - ax, y - ay
        uu = ux * ux + uy * uy
        t = 0.0
        if uu > 0.0:
            t = min(max((wx * ux + wy * uy) / uu, 0.0), 1.0)
        nearest = min(nearest, (wx - t * ux) ** 2 + (wy - t * uy) ** 2)
        if (ay > y) != (by > y) and wx < ux * wy / uy:
            inside = not inside
    depth: float = math.sqrt(nearest)
    return depth if inside else -depth


@compiled
def holds(corners: Floats, x: float, y: float) -> bool:
    """Whether a polygon (K, 2) holds a place (even-odd rule)."""
    inside = False
    n = corners.shape[0]
    for i in range(n):
        ax, ay = corners[i, 0], corners[i, 1]
        bx, by = corners[(i + 1) % n, 0], corners[(i + 1) % n, 1]
        if (ay > y) != (by > y) and (x - ax) < (bx - ax) * (y - ay) / (by - ay):
            inside = not inside
    return inside
