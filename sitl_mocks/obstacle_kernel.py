"""Compiled geometry of upright cylinders that move: where they are, how near one is, what a lidar in the plane sees.

Obstacles are packed: `shapes` (N, 3) holds radius, bottom and top, `knots` (M, 3) time, x and y of all paths one after
the other, `first` (N + 1,) where each path begins, and `periods` (N,) after which a path begins anew, 0 for never.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from gcs.planning.numerics.compiled import compiled

Array = NDArray[np.float64]
Numbers = NDArray[np.int64]

RADIUS, BOTTOM, TOP = 0, 1, 2


@compiled
def place(i: int, time_s: float, knots: Array, first: Numbers, periods: Array) -> tuple[float, float]:
    """Where obstacle `i` is: at the ends of its path before and after the path's times."""
    begin, end = first[i], first[i + 1]
    t = time_s
    if periods[i] > 0.0 and t > knots[begin, 0]:
        t = knots[begin, 0] + (t - knots[begin, 0]) % periods[i]
    if t <= knots[begin, 0]:
        return knots[begin, 1], knots[begin, 2]
    for k in range(begin, end - 1):
        if t < knots[k + 1, 0]:
            share = (t - knots[k, 0]) / (knots[k + 1, 0] - knots[k, 0])
            x = knots[k, 1] + share * (knots[k + 1, 1] - knots[k, 1])
            y = knots[k, 2] + share * (knots[k + 1, 2] - knots[k, 2])
            return x, y
    return knots[end - 1, 1], knots[end - 1, 2]


@compiled
def nearest(
    point: Array, time_s: float, shapes: Array, knots: Array, first: Numbers, periods: Array
) -> tuple[float, int]:
    """Signed distance (m) of a point from the nearest obstacle, negative within it, and which one that is."""
    least, which = math.inf, -1
    for i in range(len(shapes)):
        x, y = place(i, time_s, knots, first, periods)
        aside = math.hypot(point[0] - x, point[1] - y) - shapes[i, RADIUS]
        above = max(shapes[i, BOTTOM] - point[2], point[2] - shapes[i, TOP])
        distance = math.hypot(max(aside, 0.0), max(above, 0.0)) + min(max(aside, above), 0.0)
        if distance < least:
            least, which = distance, i
    return least, which


@compiled
def sweep(
    point: Array,
    bearings: Array,
    reach: float,
    time_s: float,
    shapes: Array,
    knots: Array,
    first: Numbers,
    periods: Array,
) -> Array:
    """Range (m) along each bearing from a point in its level plane; infinite where nothing is within reach."""
    ranges = np.full(len(bearings), np.inf)
    for i in range(len(shapes)):
        if point[2] < shapes[i, BOTTOM] or point[2] > shapes[i, TOP]:
            continue
        x, y = place(i, time_s, knots, first, periods)
        east, north, radius = x - point[0], y - point[1], shapes[i, RADIUS]
        inside = east * east + north * north <= radius * radius
        for b in range(len(bearings)):
            along = east * math.cos(bearings[b]) + north * math.sin(bearings[b])
            across = east * math.sin(bearings[b]) - north * math.cos(bearings[b])
            half = radius * radius - across * across
            if inside:
                ranges[b] = 0.0
            elif along > 0.0 and half >= 0.0:
                ranges[b] = min(ranges[b], along - math.sqrt(half))
    for b in range(len(bearings)):
        if ranges[b] > reach:
            ranges[b] = np.inf
    return ranges
