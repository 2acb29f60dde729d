"""The planner that flies: the shortest way in the plane among convex obstacles and blocked cells, always the same.

It is exact, so no other planner finds a shorter way, and all its work is counted and bounded, so its time is bounded.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.errors import InfeasibleError, InputError
from gcs.planning.local.binary_map import blocked_error, check_point, check_query
from gcs.planning.local.cell_sight import convex_corners
from gcs.planning.local.convex_obstacles import TOUCH_M, ConvexObstacles, PackedPolygons, inside_polygons
from gcs.planning.local.search_budget import SearchBudget
from gcs.planning.local.tangent_search import FOUND, OUT_OF_WORK, search_tangents
from gcs.planning.numerics.compiled import compiled

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from gcs.planning.local.binary_map import BinaryMap

NO_OBSTACLES = ConvexObstacles(())

_NO_MAP = np.empty((0, 0), dtype=np.bool_)

Floats = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Ints = np.ndarray[tuple[int, ...], np.dtype[np.int64]]
Marks = np.ndarray[tuple[int, ...], np.dtype[np.bool_]]


@dataclass(frozen=True, eq=False)
class LocalPath:
    """A way in the plane.

    Attributes:
        points_m: from start to goal, shape (K, 2), scene ENU.
        work: of the search, as `tangent_search` counts it: its time is proportional to it.
    """

    points_m: NDArray[np.float64]
    work: int

    @property
    def length_m(self) -> float:
        """Length of the way."""
        return float(np.linalg.norm(np.diff(self.points_m, axis=0), axis=1).sum())


def shortest_path(
    start_m: ArrayLike,
    goal_m: ArrayLike,
    obstacles: ConvexObstacles = NO_OBSTACLES,
    area: BinaryMap | None = None,
    budget: SearchBudget | None = None,
) -> LocalPath:
    """The shortest way that enters no obstacle and no blocked cell; it may touch them.

    Args:
        start_m: shape (2,), scene ENU.
        goal_m: likewise.
        obstacles: already grown by the safe distance.
        area: a map of the plane, already grown; the way stays on it. None for a plane without end.
        budget: its work bounds the search, which takes what it did from it; a whole one when it is not given.

    Raises:
        InputError: start or goal is not a point, or inside an obstacle, or off the map.
        InfeasibleError: there is no way, or none was found within the bound.
    """
    budget = budget or SearchBudget()
    for field, point in (("start", start_m), ("goal", goal_m)):
        check_point(field, point, 2)
    start, goal = np.asarray(start_m, dtype=np.float64), np.asarray(goal_m, dtype=np.float64)
    polygons = obstacles.packed
    blocked, origin, cell_m = _NO_MAP, np.zeros(2), 1.0
    if area is not None:
        if area.dimensions != 2:
            raise InputError("this planner needs a map of the plane", field="area")
        check_query(area, start, goal)
        blocked, origin, cell_m = area.blocked, area.origin_m, area.cell_m
    for field, point in (("start", start), ("goal", goal)):
        if inside_polygons(point[0], point[1], polygons, TOUCH_M):
            raise blocked_error(field)
    points, before, after = _corners(polygons, convex_corners(blocked), blocked, origin, cell_m)
    points = np.concatenate((points, start[None], goal[None]))
    outcome, way, work = search_tangents(points, before, after, polygons, blocked, origin, cell_m, budget.work)
    budget.work = max(budget.work - work, 0)
    if outcome == FOUND:
        return LocalPath(points[way], work)
    if outcome == OUT_OF_WORK:
        raise InfeasibleError(f"no way was found within {work} steps of work: hold, and ask for a nearer goal")
    raise InfeasibleError("there is no way round the obstacles: hold or back off")


@compiled
def _corners(
    polygons: PackedPolygons, lattice: Ints, blocked: Marks, origin: Floats, cell_m: float
) -> tuple[Floats, Floats, Floats]:
    """Corners of all obstacles that lie in free space, and the edges to their neighbours, shape (V, 2) each."""
    room = len(polygons.corners) + len(lattice)
    points, before, after = np.empty((room, 2)), np.empty((room, 2)), np.empty((room, 2))
    count = 0
    for k in range(len(polygons.first) - 1):
        begin, end = polygons.first[k], polygons.first[k + 1]
        for i in range(begin, end):
            corner = polygons.corners[i]
            if inside_polygons(corner[0], corner[1], polygons, TOUCH_M) or _covered(corner, blocked, origin, cell_m):
                continue
            points[count] = corner
            before[count] = polygons.corners[i - 1 if i > begin else end - 1] - corner
            after[count] = polygons.corners[i + 1 if i + 1 < end else begin] - corner
            count += 1
    for row in range(len(lattice)):
        x, y = origin[0] + lattice[row, 0] * cell_m, origin[1] + lattice[row, 1] * cell_m
        if inside_polygons(x, y, polygons, TOUCH_M):
            continue
        points[count] = (x, y)
        before[count] = (lattice[row, 2] * cell_m, 0.0)
        after[count] = (0.0, lattice[row, 3] * cell_m)
        count += 1
    return points[:count], before[:count], after[:count]


@compiled
def _covered(point: Floats, blocked: Marks, origin: Floats, cell_m: float) -> bool:
    """Whether a point is in a blocked cell or off the map."""
    if blocked.size == 0:
        return False
    i, j = int(np.floor((point[0] - origin[0]) / cell_m)), int(np.floor((point[1] - origin[1]) / cell_m))
    return i < 0 or j < 0 or i >= blocked.shape[0] or j >= blocked.shape[1] or bool(blocked[i, j])
