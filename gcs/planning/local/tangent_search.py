"""A* over the tangents between corners of obstacles, with sight tested only for the edges that come first.

A shortest way in the plane is a taut string: it bends only at convex corners, and there round the obstacle, so each of
its straights is tangent to the obstacles at both ends. Edges enter the queue with the length they would have; whether
one is free is asked when it is taken out. As the straight distance never overestimates, the first free edge into a
corner is its shortest way there, so every corner is settled once, and the goal's way is the shortest of all.

All that takes time is counted as work, and the work is bounded: so is the time, alike on a map that is mere noise.
"""

from __future__ import annotations

import numpy as np

from gcs.planning.local.cell_sight import clear_of_cells
from gcs.planning.local.convex_obstacles import PackedPolygons, clear_of_polygons
from gcs.planning.numerics.compiled import compiled
from gcs.planning.numerics.quaternary_heap import grown, sift_down, sift_up

FOUND, NO_WAY, OUT_OF_WORK = 0, 1, 2

QUEUED, TAKEN_OUT, SIGHT_TEST = 6, 16, 50
"""Work is counted in looks: a corner that is settled looks at all points for tangents. To queue an edge, to take one
out, and to test its sight take as long as so many looks, and one more for each obstacle; a look takes some 4 ns."""

TANGENT_M2 = 1e-9
"""A corner's neighbour that is so little on the wrong side, as an area, is on the straight."""

Floats = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Ints = np.ndarray[tuple[int, ...], np.dtype[np.int64]]
Marks = np.ndarray[tuple[int, ...], np.dtype[np.bool_]]


@compiled
def search_tangents(
    points: Floats,
    before: Floats,
    after: Floats,
    polygons: PackedPolygons,
    blocked: Marks,
    origin: Floats,
    cell_m: float,
    most_work: int,
) -> tuple[int, Ints, int]:
    """The shortest way from the last point but one to the last.

    Args:
        points: corners, then start and goal, m, shape (V + 2, 2).
        before: from each corner along its obstacle's edge to the one before, m, shape (V, 2).
        after: the same to the one after.
        polygons: obstacles.
        blocked: blocked cells (nx, ny), empty for no map.
        origin: the map's low corner, m, shape (2,).
        cell_m: edge of a cell.
        most_work: the search ends when it is spent; the looks of the last corner may go beyond it.

    Returns:
        `FOUND`, `NO_WAY` or `OUT_OF_WORK`; the indices of the way's points from start to goal; the work done.
    """
    n = len(points)
    sight_test = SIGHT_TEST + len(polygons.circles)
    start, goal = n - 2, n - 1
    length = np.full(n, np.inf)
    came_from = np.full(n, -1, np.int64)
    settled = np.zeros(n, np.bool_)
    keys: Floats = np.empty(256)
    edges: Ints = np.empty(256, np.int64)
    waiting, work, at = 0, 0, start
    length[start], settled[start] = 0.0, True
    while at != goal:
        if waiting + n > len(keys):
            keys, edges = grown(keys, edges)
            continue
        waited = waiting
        waiting = _push_tangents(at, points, before, after, length, came_from, settled, keys, edges, waiting)
        work += n + QUEUED * (waiting - waited)
        reached = -1
        while waiting and reached < 0:
            if work + TAKEN_OUT + sight_test > most_work:
                return OUT_OF_WORK, np.empty(0, np.int64), work
            edge = edges[0]
            waiting -= 1
            sift_down(keys, edges, waiting, keys[waiting], edges[waiting])
            work += TAKEN_OUT
            a, b = edge // n, edge % n
            if settled[b]:
                continue
            work += sight_test
            if _clear(points[a, 0], points[a, 1], points[b, 0], points[b, 1], polygons, blocked, origin, cell_m):
                settled[b], came_from[b], reached = True, a, b
                length[b] = length[a] + np.hypot(points[b, 0] - points[a, 0], points[b, 1] - points[a, 1])
        if reached < 0:
            return NO_WAY, np.empty(0, np.int64), work
        at = reached
    way = np.empty(n, np.int64)
    count = 0
    while at >= 0:
        way[n - 1 - count] = at
        count += 1
        at = came_from[at]
    return FOUND, way[n - count :], work


@compiled
def _clear(
    ax: float, ay: float, bx: float, by: float, polygons: PackedPolygons, blocked: Marks, origin: Floats, cell_m: float
) -> bool:
    if not clear_of_polygons(ax, ay, bx, by, polygons):
        return False
    ox, oy = origin
    return blocked.size == 0 or clear_of_cells(
        (ax - ox) / cell_m, (ay - oy) / cell_m, (bx - ox) / cell_m, (by - oy) / cell_m, blocked
    )


@compiled
def _push_tangents(
    at: int,
    points: Floats,
    before: Floats,
    after: Floats,
    length: Floats,
    came_from: Ints,
    settled: Marks,
    keys: Floats,
    edges: Ints,
    waiting: int,
) -> int:
    """Queue the edges from a settled point on which a taut string may go on; there is room for them. How many wait."""
    n = len(points)
    goal, corners = n - 1, n - 2
    x, y = points[at]
    side, in_x, in_y = 0.0, 0.0, 0.0
    if at < corners:
        in_x, in_y = x - points[came_from[at], 0], y - points[came_from[at], 1]
        around = _cross(in_x, in_y, before[at]) + _cross(in_x, in_y, after[at])
        side = 1.0 if around > 0.0 else -1.0
    for to in range(n):
        if settled[to]:
            continue
        dx, dy = points[to, 0] - x, points[to, 1] - y
        if at < corners and not (
            side * (in_x * dy - in_y * dx) >= -TANGENT_M2
            and side * _cross(dx, dy, before[at]) >= -TANGENT_M2
            and side * _cross(dx, dy, after[at]) >= -TANGENT_M2
        ):
            continue
        if to < corners:
            one, other = _cross(dx, dy, before[to]), _cross(dx, dy, after[to])
            if (one > TANGENT_M2 and other < -TANGENT_M2) or (one < -TANGENT_M2 and other > TANGENT_M2):
                continue
        left = np.hypot(points[goal, 0] - points[to, 0], points[goal, 1] - points[to, 1])
        sift_up(keys, edges, waiting, length[at] + np.hypot(dx, dy) + left, at * n + to)
        waiting += 1
    return waiting


@compiled
def _cross(dx: float, dy: float, edge: Floats) -> float:
    return float(dx * edge[1] - dy * edge[0])
