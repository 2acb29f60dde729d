"""Planes that cut a convex set about a straight segment free of everything that limits the vehicle's centre.

The nearest obstacle to the segment gets a plane, square to the line between the two nearest points and the clearance
before the obstacle; what that plane keeps away needs no plane of its own any more; then comes the nearest one of the
rest (after the safe flight corridors of Liu et al. 2017, with segment and obstacle in place of ellipsoid and point).
A plane lies so that it keeps its obstacle away whichever way it faces: nothing rests on the nearest points.
"""

from __future__ import annotations

import math

import numpy as np

from gcs.planning.numerics.compiled import compiled
from gcs.planning.scene.bounding_volumes import STACK_SIZE
from gcs.planning.scene.fence import FenceVolume, holds
from gcs.planning.scene.nearest_points import nearest_of_segment_and_triangle, nearest_of_segments
from gcs.planning.scene.room import RoomModel

MOST_PLANES = 24
"""Planes that are added at most; a place that needs more is no place for a polytope."""

LEAST_ROOM_M = 1e-3
"""What the segment keeps from every plane at least."""

ROUNDING_M = 1e-9
"""Planes lie this much nearer to the segment, so that rounding never says that they do not keep their obstacle away."""

Floats = np.ndarray[tuple[int, ...], np.dtype[np.float64]]


@compiled
def separating_planes(a: Floats, b: Floats, planes: Floats, reach: float, model: RoomModel) -> tuple[Floats, bool]:
    """Cut a convex set about a segment so that all of it keeps the clearance and the fence.

    The column over home is not exempt.

    Args:
        a: one end of the segment, shape (3,).
        b: the other.
        planes: of the set, outward unit normals and offsets, `normal . p <= offset`, shape (m, 4).
        reach: no point of the set is further from the segment than this (m).
        model: what limits the centre; its extra distance does not count.

    Returns:
        The planes and those that cut, shape (n, 4), and whether the set is free. It is not when the segment itself is
        too near to something, or too many planes would be needed.
    """
    found = np.empty((planes.shape[0] + MOST_PLANES, 4))
    count = planes.shape[0]
    found[:count] = planes
    if min(a[2], b[2]) - reach < model.ground + model.clearance:
        found[count] = 0.0, 0.0, -1.0, -(model.ground + model.clearance)
        count += 1
    if max(a[2], b[2]) + reach > model.fence.max_height_m - model.fence.margin_m:
        found[count] = 0.0, 0.0, 1.0, model.fence.max_height_m - model.fence.margin_m
        count += 1
    for k in range(planes.shape[0], count):
        if not _holds_segment(found[k], a, b):
            return found, False
    held_by = _including_polygon(a, b, model.fence)
    if held_by < 0 < model.fence.included:
        return found, False
    corners, p, q = np.empty((3, 3)), np.empty(3), np.empty(3)
    while True:
        keep = _nearest_left(a, b, found[:count], reach, held_by, model, corners, p, q)
        if keep < 0.0:
            return found[:count], True
        if count == found.shape[0] or not _separate(corners, p, q, keep, found[count]):
            return found, False
        if not _holds_segment(found[count], a, b):
            return found, False
        count += 1


@compiled
def _separate(corners: Floats, p: Floats, q: Floats, keep: float, plane: Floats) -> bool:
    """Write the plane that keeps a distance from the hull of three points; False where they touch the segment."""
    length = math.sqrt((q[0] - p[0]) ** 2 + (q[1] - p[1]) ** 2 + (q[2] - p[2]) ** 2)
    if not length > 0.0:
        return False
    for k in range(3):
        plane[k] = (q[k] - p[k]) / length
    plane[3] = _support(corners, plane) - keep - ROUNDING_M
    return True


@compiled
def _support(corners: Floats, plane: Floats) -> float:
    """Least value of a plane's normal on the hull of three points."""
    least = math.inf
    for c in range(3):
        least = min(least, corners[c, 0] * plane[0] + corners[c, 1] * plane[1] + corners[c, 2] * plane[2])
    return least


@compiled
def _holds_segment(plane: Floats, a: Floats, b: Floats) -> bool:
    """Whether a segment lies within a plane with `LEAST_ROOM_M`."""
    at_a = a[0] * plane[0] + a[1] * plane[1] + a[2] * plane[2]
    at_b = b[0] * plane[0] + b[1] * plane[1] + b[2] * plane[2]
    return bool(max(at_a, at_b) <= plane[3] - LEAST_ROOM_M)


@compiled
def _kept_away(corners: Floats, keep: float, planes: Floats) -> bool:
    """Whether one of the planes already keeps a distance from the hull of three points."""
    largest = -math.inf
    for n in range(planes.shape[0]):
        largest = max(largest, _support(corners, planes[n]) - planes[n, 3])
    return largest >= keep


@compiled
def _wall_kept_away(edge: Floats, keep: float, planes: Floats) -> bool:
    """The same for an edge of the fence, of all heights: only an upright plane does."""
    largest = -math.inf
    for n in range(planes.shape[0]):
        if planes[n, 2] == 0.0:
            largest = max(largest, _support(edge, planes[n]) - planes[n, 3])
    return largest >= keep


@compiled
def _box_kept_away(low: Floats, high: Floats, keep: float, planes: Floats) -> bool:
    """The same for a box."""
    for n in range(planes.shape[0]):
        least = 0.0
        for k in range(3):
            least += planes[n, k] * (low[k] if planes[n, k] > 0.0 else high[k])
        if least >= planes[n, 3] + keep:
            return True
    return False


@compiled
def _nearest_left(
    a: Floats,
    b: Floats,
    planes: Floats,
    reach: float,
    held_by: int,
    model: RoomModel,
    corners: Floats,
    p: Floats,
    q: Floats,
) -> float:
    """The obstacle nearest to a segment that no plane keeps away yet.

    Args:
        a: one end of the segment.
        b: the other.
        planes: that there are, shape (n, 4).
        reach: obstacles with more room than this do not matter.
        held_by: included polygon of the fence that holds the segment.
        model: what limits the centre.
        corners: takes the obstacle's corners, shape (3, 3).
        p: takes the nearest point of the segment.
        q: takes the nearest point of the obstacle.

    Returns:
        The distance to keep from it; negative when there is none.
    """
    best, kept = reach, -1.0
    tried, point, other = np.empty((3, 3)), np.empty(3), np.empty(3)
    stack = np.empty(STACK_SIZE, np.int64)
    stack[0] = 0
    top = 1
    while top > 0:
        top -= 1
        node = stack[top]
        low, high = model.tree.low[node], model.tree.high[node]
        gap = 0.0
        for k in range(3):
            gap += max(low[k] - max(a[k], b[k]), min(a[k], b[k]) - high[k], 0.0) ** 2
        if gap >= (best + model.clearance) ** 2 or _box_kept_away(low, high, model.clearance, planes):
            continue
        first, size = model.tree.first[node], model.tree.size[node]
        if size == 0:
            stack[top], stack[top + 1] = first, first + 1
            top += 2
            continue
        for j in range(first, first + size):
            room = math.sqrt(nearest_of_segment_and_triangle(a, b, model.triangles[j], point, other)) - model.clearance
            if room < best and not _kept_away(model.triangles[j], model.clearance, planes):
                best, kept = room, model.clearance
                corners[:], p[:], q[:] = model.triangles[j], point, other
    for c in range(model.cable_ends.shape[0]):
        ends, keep = model.cable_ends[c], model.clearance + model.cable_radii[c]
        room = math.sqrt(nearest_of_segments(a, b, ends[0], ends[1], point, other)) - keep
        tried[0], tried[1], tried[2] = ends[0], ends[1], ends[1]
        if room < best and not _kept_away(tried, keep, planes):
            best, kept = room, keep
            corners[:], p[:], q[:] = tried, point, other
    flat_a, flat_b = a.copy(), b.copy()
    flat_a[2] = flat_b[2] = 0.0
    tried[:, 2] = 0.0
    fence = model.fence
    for n in range(fence.first.shape[0] - 1):
        if n < fence.included and n != held_by:
            continue
        for i in range(fence.first[n], fence.first[n + 1]):
            after = i + 1 if i + 1 < fence.first[n + 1] else fence.first[n]
            tried[0, :2], tried[1, :2], tried[2, :2] = fence.corners[i], fence.corners[after], fence.corners[after]
            room = math.sqrt(nearest_of_segments(flat_a, flat_b, tried[0], tried[1], point, other)) - fence.margin_m
            if room < best and not _wall_kept_away(tried, fence.margin_m, planes):
                best, kept = room, fence.margin_m
                corners[:], p[:], q[:] = tried, point, other
    return kept


@compiled
def _including_polygon(a: Floats, b: Floats, fence: FenceVolume) -> int:
    """An included polygon that a segment lies in without crossing its edges; -1 when there is none."""
    flat_a, flat_b = a.copy(), b.copy()
    flat_a[2] = flat_b[2] = 0.0
    edge, p, q = np.zeros((2, 3)), np.empty(3), np.empty(3)
    for n in range(fence.included):
        corners = fence.corners[fence.first[n] : fence.first[n + 1]]
        inside = holds(corners, a[0], a[1])
        for i in range(corners.shape[0]):
            edge[0, :2], edge[1, :2] = corners[i], corners[(i + 1) % corners.shape[0]]
            inside = inside and nearest_of_segments(flat_a, flat_b, edge[0], edge[1], p, q) > fence.margin_m**2
        if inside:
            return n
    return -1
