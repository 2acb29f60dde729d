"""Whether an axis-aligned box keeps the clearance as a whole, and how far one can grow until it does not.

Distances of boxes to triangles and cables come from alternating projections (Cheney and Goldstein 1959): the nearest
point of the one to a point of the other, in turns. The plane square to the line between the two then separates them by
a distance that is proved whether or not the projections have settled; the distance of the two points is an upper bound.
"""

from __future__ import annotations

import math

import numpy as np

from gcs.planning.numerics.compiled import compiled
from gcs.planning.scene.bounding_volumes import STACK_SIZE
from gcs.planning.scene.fence import FenceVolume, fence_room, holds
from gcs.planning.scene.nearest_points import nearest_of_segment, nearest_of_triangle
from gcs.planning.scene.room import RoomModel

PROJECTIONS = 24
GROWTHS = 6
"""Bisections of how far a box grows."""

Floats = np.ndarray[tuple[int, ...], np.dtype[np.float64]]


@compiled
def box_free(low: Floats, high: Floats, model: RoomModel) -> bool:
    """Whether every point of a box keeps the clearance to surfaces, cables and ground, and stays inside the fence.

    Neither the extra distance nor the column over home counts. What is said to be free is; a box that is free by less
    than a hundredth of a millimetre or so may be said not to be.

    Args:
        low: lowest corner, shape (3,).
        high: highest corner, shape (3,).
        model: what limits the centre.
    """
    if low[2] < model.ground + model.clearance or not _in_fence(low, high, model.fence):
        return False
    for c in range(model.cable_ends.shape[0]):
        if not _apart(low, high, model.cable_ends[c], model.clearance + model.cable_radii[c]):
            return False
    least = model.clearance**2
    stack = np.empty(STACK_SIZE, np.int64)
    stack[0] = 0
    top = 1
    while top > 0:
        top -= 1
        node = stack[top]
        gap = 0.0
        for k in range(3):
            gap += max(model.tree.low[node, k] - high[k], low[k] - model.tree.high[node, k], 0.0) ** 2
        if gap >= least:
            continue
        first, size = model.tree.first[node], model.tree.size[node]
        if size == 0:
            stack[top], stack[top + 1] = first, first + 1
            top += 2
            continue
        for j in range(first, first + size):
            if not _apart(low, high, model.triangles[j], model.clearance):
                return False
    return True


@compiled
def grown_box(
    low: Floats, high: Floats, most_low: Floats, most_high: Floats, model: RoomModel
) -> tuple[Floats, Floats]:
    """Grow a free box within a larger one: on all sides alike, then on each side as far as it can.

    Args:
        low: lowest corner of the free box, shape (3,).
        high: its highest corner.
        most_low: lowest corner of the larger box.
        most_high: its highest corner.
        model: what limits the centre.

    Returns:
        The grown box's corners; it is free, and holds the box that was given.
    """
    kept_low, kept_high = low.copy(), high.copy()
    share = 0.0
    step = 1.0
    for _ in range(GROWTHS):
        tried = min(share + step, 1.0)
        a, b = low + tried * (most_low - low), high + tried * (most_high - high)
        if box_free(a, b, model):
            share, kept_low, kept_high = tried, a, b
            if tried == 1.0:
                return kept_low, kept_high
        step /= 2
    for side in range(6):
        k = side % 3
        kept, most = (kept_low, most_low) if side < 3 else (kept_high, most_high)
        begin = kept[k]
        share = 0.0
        step = 1.0
        for _ in range(GROWTHS):
            before = kept[k]
            kept[k] = begin + min(share + step, 1.0) * (most[k] - begin)
            if box_free(kept_low, kept_high, model):
                share = min(share + step, 1.0)
                if share == 1.0:
                    break
            else:
                kept[k] = before
            step /= 2
    return kept_low, kept_high


@compiled
def _apart(low: Floats, high: Floats, corners: Floats, distance: float) -> bool:
    """Whether a box keeps a distance from the hull of one to three points (K, 3)."""
    gap = 0.0
    for k in range(3):
        least, largest = math.inf, -math.inf
        for c in range(corners.shape[0]):
            least = min(least, corners[c, k])
            largest = max(largest, corners[c, k])
        gap += max(least - high[k], low[k] - largest, 0.0) ** 2
    if gap >= distance * distance:
        return True
    p = (low + high) / 2
    q = np.empty(3)
    for _ in range(PROJECTIONS):
        if corners.shape[0] == 3:
            nearest_of_triangle(p, corners[0], corners[1], corners[2], q)
        else:
            nearest_of_segment(p, corners[0], corners[1], q)
        square = 0.0
        for k in range(3):
            p[k] = min(max(q[k], low[k]), high[k])
            square += (q[k] - p[k]) ** 2
        if square < distance * distance:
            return False
        apart = math.inf
        for c in range(corners.shape[0]):
            along = 0.0
            for k in range(3):
                along += (q[k] - p[k]) * corners[c, k]
            apart = min(apart, along)
        for k in range(3):
            way = q[k] - p[k]
            apart -= way * (high[k] if way > 0.0 else low[k])
        if apart >= distance * math.sqrt(square):
            return True
    return False


@compiled
def _in_fence(low: Floats, high: Floats, fence: FenceVolume) -> bool:
    """Whether a box keeps the fence's margin: some included polygon holds it, and every excluded one is clear of it."""
    if fence.max_height_m - high[2] < fence.margin_m:
        return False
    x, y = (low[0] + high[0]) / 2, (low[1] + high[1]) / 2
    if fence_room(x, y, high[2], fence) < 0.0:
        return False
    held = fence.included == 0
    for k in range(fence.first.shape[0] - 1):
        corners = fence.corners[fence.first[k] : fence.first[k + 1]]
        if k >= fence.included:
            if _edges_near(corners, low, high, fence.margin_m):
                return False
        elif not held:
            held = holds(corners, x, y) and not _edges_near(corners, low, high, fence.margin_m)
    return held


@compiled
def _edges_near(corners: Floats, low: Floats, high: Floats, margin: float) -> bool:
    """Whether an edge of a polygon (K, 2) comes nearer than the margin to a box's plan, or may."""
    flat_low, flat_high, edge = np.zeros(3), np.zeros(3), np.zeros((2, 3))
    flat_low[:2], flat_high[:2] = low[:2], high[:2]
    n = corners.shape[0]
    for i in range(n):
        edge[0, :2], edge[1, :2] = corners[i], corners[(i + 1) % n]
        if not _apart(flat_low, flat_high, edge, margin):
            return True
    return False
