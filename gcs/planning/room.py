"""Room: how far the vehicle's centre can move in any direction and still keep every distance it has to keep.

Room is a lower bound that never changes by more than the distance moved (it is 1-Lipschitz), so a point with room
`r` proves the whole ball of radius `r` about it. A straight segment is proved by walking along it from ball to ball:
no resolution is lost, wherever its ends are. The distance field answers while there is much room, the exact distance
to the triangles where there is little.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from gcs.planning.bounding_volumes import BoundingVolumes
from gcs.planning.compiled import compiled
from gcs.planning.fence import FenceVolume, fence_room
from gcs.planning.point_distance import _nearest, _nearest_cable

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
        distance: lower bound of the distance at the cells' centres, shape (nx, ny, nz), float32.
        triangles: corners, shape (F, 3, 3).
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
    distance: NDArray[np.float32]
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
    points = point.reshape(1, 3)
    result = np.empty(1)
    _nearest(points, np.full(1, limit), model.triangles, model.tree, result)
    _nearest_cable(points, model.cable_ends, model.cable_radii, result)
    return float(result[0])


@compiled
def rule_room(point: Floats, model: RoomModel) -> float:
    """Room (m) that the ground and the fence leave at a point (3,)."""
    above = point[2] - model.ground - model.clearance
    if above < HOME_COLUMN_RADIUS_M:
        aside = math.hypot(point[0] - model.home[0], point[1] - model.home[1])
        column = min(HOME_COLUMN_RADIUS_M - aside, point[2] - model.home[2] + 2 * model.tolerance)
        above = max(above, column)
    return float(min(above, fence_room(point[0], point[1], point[2], model.fence)))


@compiled
def inside_grid(point: Floats, model: RoomModel) -> bool:
    """Whether a point (3,) lies within the grid."""
    x, y, z = point[0], point[1], point[2]
    above = model.low[0] <= x and model.low[1] <= y and model.low[2] <= z
    return bool(above and x < model.high[0] and y < model.high[1] and z < model.high[2])


@compiled
def room_at(point: Floats, model: RoomModel) -> float:
    """Room (m) at a point (3,) inside the grid; a lower bound that is exact where less than a pitch is left."""
    room = rule_room(point, model)
    if room < 0.0:
        return room
    i = int((point[0] - model.low[0]) / model.pitch)
    j = int((point[1] - model.low[1]) / model.pitch)
    k = int((point[2] - model.low[2]) / model.pitch)
    i, j, k = (
        min(i, model.distance.shape[0] - 1),
        min(j, model.distance.shape[1] - 1),
        min(k, model.distance.shape[2] - 1),
    )
    dx = point[0] - model.low[0] - (i + 0.5) * model.pitch
    dy = point[1] - model.low[1] - (j + 0.5) * model.pitch
    dz = point[2] - model.low[2] - (k + 0.5) * model.pitch
    bound = model.distance[i, j, k] - math.sqrt(dx * dx + dy * dy + dz * dz) - model.clearance
    if bound < model.pitch:
        bound = max(bound, exact_distance(point, model.clearance + model.pitch, model) - model.clearance)
    return float(min(room, bound))


@compiled
def points_free(points: Floats, model: RoomModel) -> Marks:
    """Whether there is room at points (N, 3)."""
    result = np.zeros(points.shape[0], np.bool_)
    for n in range(points.shape[0]):
        result[n] = inside_grid(points[n], model) and room_at(points[n], model) >= model.tolerance
    return result


@compiled
def segment_free(a: Floats, b: Floats, least: float, model: RoomModel) -> bool:
    """Whether the straight segment between two points (3,) keeps all distances; proved, not sampled.

    Each step is as long as there is room, and ends the walk where there is less than `least`. Between two steps room
    never falls below `least / 2`, so a segment that passes passes again, part by part and in either direction, with
    half of it.
    """
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
        at = min(at + room, length)
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
    if not inside_grid(point, model) or room_at(point, model) < model.tolerance:
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
def points_linked(points: Floats, allowed: Marks, offsets: Ints, model: RoomModel) -> Marks:
    """`nearest_linked_cell` for many points (N, 3): whether one was found."""
    result = np.zeros(points.shape[0], np.bool_)
    cell = np.empty(3, np.int64)
    for n in range(points.shape[0]):
        result[n] = nearest_linked_cell(points[n], allowed, offsets, model, cell)
    return result


@compiled
def refine_shell(low: float, high: float, most: float, model: RoomModel) -> int:
    """Put the exact distance at the centres where the bound leaves open on which side of two thresholds they are.

    Args:
        low: lower threshold (m): with a true distance below it a cell is certainly not wanted.
        high: higher threshold (m): with a bound above it nothing is open.
        most: how far the true distance may lie above the bound (m).
        model: its `distance` is refined in place.

    Returns:
        How many centres were computed.
    """
    count = 0
    centre = np.empty(3)
    nx, ny, nz = model.distance.shape
    for i in range(nx):
        for j in range(ny):
            for k in range(nz):
                bound = model.distance[i, j, k]
                if bound < high and bound + most >= low:
                    centre[0] = model.low[0] + (i + 0.5) * model.pitch
                    centre[1] = model.low[1] + (j + 0.5) * model.pitch
                    centre[2] = model.low[2] + (k + 0.5) * model.pitch
                    exact = exact_distance(centre, high, model)
                    model.distance[i, j, k] = max(bound, exact * (1.0 - 1e-6))
                    count += 1
    return count
