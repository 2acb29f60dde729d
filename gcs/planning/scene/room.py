"""Room: how far the vehicle's centre can move in any direction and still keep every distance it has to keep.

Room is a lower bound that never changes by more than the distance moved (it is 1-Lipschitz), so a point with room
`r` proves the whole ball of radius `r` about it. A straight segment is proved by walking along it from ball to ball:
no resolution is lost, wherever its ends are. The distance field answers while there is much room, the exact distance
to the triangles where there is little.

Besides the clearance a model may keep an extra distance everywhere but about given spots: with it, a path that starts
in a tight place may leave that place, and has to keep the larger distance elsewhere. The extra rises from 0 at the
spot's edge by a metre a metre, so room then changes by at most twice the distance moved.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from gcs.planning.numerics.compiled import compiled
from gcs.planning.scene.bounding_volumes import BoundingVolumes
from gcs.planning.scene.fence import FenceVolume, fence_room
from gcs.planning.scene.point_distance import nearest_cable, nearest_surface

if TYPE_CHECKING:
    from numpy.typing import NDArray

HOME_COLUMN_RADIUS_M = 0.5
"""The take-off and landing column over home: within it the distance to the ground plane does not count."""

Floats = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Ints = np.ndarray[tuple[int, ...], np.dtype[np.int64]]
Marks = np.ndarray[tuple[int, ...], np.dtype[np.bool_]]


class RoomModel(NamedTuple):
    """Everything that limits the vehicle's centre, as arrays that kernels take.

    Attributes:
        low: lowest corner of the grid, shape (3,).
        high: highest corner, shape (3,).
        pitch: edge of the cells (m).
        tolerance: room that a free point has at least (m); it bounds the number of steps along a segment.
        clearance: distance that the centre keeps from surfaces and the ground (m).
        extra: what it keeps besides, from the fence too, away from the spots (m).
        spots: places about which the extra is not kept, shape (K, 3).
        spot_radius: how far about them (m).
        distance: lower bound of the distance at the cells' centres, shape (nx, ny, nz), float32.
        looseness: how far the true distance of a centre may lie above that (m).
        triangles: corners in the order of the tree's leaves, shape (F, 3, 3).
        tree: boxes about the triangles.
        cable_ends: shape (C, 2, 3).
        cable_radii: shape (C,).
        ground: height of the ground plane; -inf without one.
        home: shape (3,).
        fence: what to stay in.
    """

    low: NDArray[np.float64]
    high: NDArray[np.float64]
    pitch: float
    tolerance: float
    clearance: float
    extra: float
    spots: NDArray[np.float64]
    spot_radius: float
    distance: NDArray[np.float32]
    looseness: float
    triangles: NDArray[np.float64]
    tree: BoundingVolumes
    cable_ends: NDArray[np.float64]
    cable_radii: NDArray[np.float64]
    ground: float
    home: NDArray[np.float64]
    fence: FenceVolume


@compiled
def exact_distance(point: Floats, limit: float, model: RoomModel) -> float:
    """Distance (m) of a point (3,) to triangles and cable hulls, at most `limit`."""
    surface = nearest_surface(point, limit, model.triangles, model.tree)
    return float(min(surface, nearest_cable(point, model.cable_ends, model.cable_radii)))


@compiled
def extra_at(point: Floats, model: RoomModel) -> float:
    """What a point (3,) has to keep besides the clearance (m)."""
    extra = model.extra
    for s in range(model.spots.shape[0]):
        square = 0.0
        for k in range(3):
            square += (point[k] - model.spots[s, k]) ** 2
        extra = min(extra, max(math.sqrt(square) - model.spot_radius, 0.0))
    return extra


@compiled
def rule_room(point: Floats, extra: float, model: RoomModel) -> float:
    """Room (m) that the ground and the fence leave at a point (3,)."""
    above = point[2] - model.ground - model.clearance - extra
    if above < HOME_COLUMN_RADIUS_M:
        aside = math.hypot(point[0] - model.home[0], point[1] - model.home[1])
        column = min(HOME_COLUMN_RADIUS_M - aside, point[2] - model.home[2] + 2 * model.tolerance)
        above = max(above, column)
    return float(min(above, fence_room(point[0], point[1], point[2], model.fence) - extra))


@compiled
def inside_grid(point: Floats, model: RoomModel) -> bool:
    """Whether a point (3,) lies within the grid."""
    x, y, z = point[0], point[1], point[2]
    above = model.low[0] <= x and model.low[1] <= y and model.low[2] <= z
    return bool(above and x < model.high[0] and y < model.high[1] and z < model.high[2])


@compiled
def bound_at(point: Floats, model: RoomModel) -> tuple[float, float]:
    """The grid's lower and upper bound of the distance (m) of a point (3,) inside the grid."""
    i = min(int((point[0] - model.low[0]) / model.pitch), model.distance.shape[0] - 1)
    j = min(int((point[1] - model.low[1]) / model.pitch), model.distance.shape[1] - 1)
    k = min(int((point[2] - model.low[2]) / model.pitch), model.distance.shape[2] - 1)
    dx = point[0] - model.low[0] - (i + 0.5) * model.pitch
    dy = point[1] - model.low[1] - (j + 0.5) * model.pitch
    dz = point[2] - model.low[2] - (k + 0.5) * model.pitch
    off = math.sqrt(dx * dx + dy * dy + dz * dz)
    distance = float(model.distance[i, j, k])
    return distance - off, distance + model.looseness + off


@compiled
def room_at(point: Floats, model: RoomModel) -> float:
    """Room (m) at a point (3,) inside the grid; a lower bound that is exact where less than a pitch is left."""
    extra = extra_at(point, model)
    keep = model.clearance + extra
    room = rule_room(point, extra, model)
    if room < 0.0:
        return room
    bound = bound_at(point, model)[0] - keep
    if bound < model.pitch:
        bound = max(bound, exact_distance(point, keep + model.pitch, model) - keep)
    return float(min(room, bound))


@compiled
def point_free(point: Floats, model: RoomModel) -> bool:
    """Whether there is room at a point (3,); the exact distance is asked only where the grid leaves it open."""
    if not inside_grid(point, model):
        return False
    extra = extra_at(point, model)
    if rule_room(point, extra, model) < model.tolerance:
        return False
    needed = model.clearance + extra + model.tolerance
    low, high = bound_at(point, model)
    if low >= needed or high < needed:
        return bool(low >= needed)
    return bool(exact_distance(point, needed, model) >= needed)


@compiled
def points_free(points: Floats, model: RoomModel, result: Marks, first: int, end: int) -> None:
    """Whether there is room at the points `first` to `end` of (N, 3); into `result`, shape (N,)."""
    for n in range(first, end):
        result[n] = point_free(points[n], model)


@compiled
def segment_free(a: Floats, b: Floats, least: float, model: RoomModel) -> bool:
    """Whether the straight segment between two points (3,) keeps all distances; proved, not sampled.

    Each step is as long as there is room, and ends the walk where there is less than `least`. Between two steps room
    never falls below `least / 2`, so a segment that passes passes again, part by part and in either direction, with
    half of it.
    """
    rate = 0.5 if model.extra > 0.0 and model.spots.shape[0] > 0 else 1.0
    if not (inside_grid(a, model) and inside_grid(b, model)):
        return False
    length = math.sqrt((b[0] - a[0]) ** 2 + (b[1] - a[1]) ** 2 + (b[2] - a[2]) ** 2)
    at = 0.0
    point = a.copy()
    while True:
        room = room_at(point, model)
        if room < least:
            return False
        if at >= length:
            return True
        at = min(at + rate * room, length)
        share = at / length
        for k in range(3):
            point[k] = a[k] + share * (b[k] - a[k])


@compiled
def least_room(a: Floats, b: Floats, accuracy: float, model: RoomModel) -> float:
    """Lower bound of the room (m) all along the segment between two points (3,), this much below it at most.

    Each step is as long as the room exceeds what is known to be the least, and `accuracy` longer.
    """
    if not (inside_grid(a, model) and inside_grid(b, model)):
        return -math.inf
    length = math.sqrt((b[0] - a[0]) ** 2 + (b[1] - a[1]) ** 2 + (b[2] - a[2]) ** 2)
    least, at = math.inf, 0.0
    point = a.copy()
    while True:
        room = room_at(point, model)
        least = min(least, room)
        if at >= length or least < 0.0:
            return float(least - accuracy)
        at = min(at + room - least + accuracy, length)
        share = at / length
        for k in range(3):
            point[k] = a[k] + share * (b[k] - a[k])


@compiled
def segments_free(a: Floats, b: Floats, least: float, model: RoomModel) -> Marks:
    """`segment_free` for many segments, shapes (M, 3)."""
    result = np.zeros(a.shape[0], np.bool_)
    for m in range(a.shape[0]):
        result[m] = segment_free(a[m], b[m], least, model)
    return result


@compiled
def nearest_linked_cell(point: Floats, allowed: Marks, offsets: Ints, model: RoomModel, cell: Ints) -> bool:
    """Find an allowed cell whose centre a point (3,) sees along a free segment, nearest first.

    Args:
        point: where to link from.
        allowed: cells to link to, shape (nx, ny, nz).
        offsets: cell offsets in the order of trial, shape (K, 3).
        model: what limits the centre.
        cell: shape (3,), takes the cell that was found.

    Returns:
        Whether one was found.
    """
    if not point_free(point, model):
        return False
    centre = np.empty(3)
    for o in range(offsets.shape[0]):
        inside = True
        for k in range(3):
            cell[k] = int((point[k] - model.low[k]) / model.pitch) + offsets[o, k]
            inside = inside and 0 <= cell[k] < allowed.shape[k]
            centre[k] = model.low[k] + (cell[k] + 0.5) * model.pitch
        if inside and allowed[cell[0], cell[1], cell[2]] and segment_free(point, centre, model.tolerance, model):
            return True
    return False


@compiled
def points_linked(
    points: Floats, allowed: Marks, offsets: Ints, model: RoomModel, result: Marks, first: int, end: int
) -> None:
    """`nearest_linked_cell` for the points `first` to `end` of (N, 3): whether one was found, into `result` (N,)."""
    cell = np.empty(3, np.int64)
    for n in range(first, end):
        result[n] = nearest_linked_cell(points[n], allowed, offsets, model, cell)


@compiled
def refine_shell(thresholds: Floats, model: RoomModel, first: int, end: int) -> None:
    """Put the exact distance at the centres where the bound leaves open on which side of a threshold they are.

    Args:
        thresholds: distances (m) in ascending order.
        model: its `distance` is refined in place, in the planes `first` to `end` of constant x.
        first: first plane.
        end: one past the last.
    """
    centre = np.empty(3)
    for i in range(first, end):
        for j in range(model.distance.shape[1]):
            near = math.inf  # bound of the distance of the centre at hand, by the one computed last
            for k in range(model.distance.shape[2]):
                near += model.pitch
                bound = model.distance[i, j, k]
                highest = -1.0
                for t in range(thresholds.shape[0]):
                    if bound < thresholds[t] and bound + model.looseness >= thresholds[t]:
                        highest = thresholds[t]
                if highest < 0.0 or near < thresholds[0]:
                    continue
                centre[0] = model.low[0] + (i + 0.5) * model.pitch
                centre[1] = model.low[1] + (j + 0.5) * model.pitch
                centre[2] = model.low[2] + (k + 0.5) * model.pitch
                limit = highest + 1e-3
                exact = exact_distance(centre, min(limit, near * (1.0 + 1e-12)), model)
                if exact < limit:
                    near = exact
                model.distance[i, j, k] = max(bound, exact * (1.0 - 1e-6))
