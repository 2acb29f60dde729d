"""The binarised map: blocked and free cells of a box of space, in the plane or in space, and growing what is blocked.

What lies outside the map is not known, and counts as blocked.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.errors import InputError
from gcs.planning.numerics.compiled import compiled
from gcs.planning.scene.distance_transform import squared_distance_transform

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

MOST_CELLS = 50_000_000
ROUNDING_M = 1e-9

Floats = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Marks = np.ndarray[tuple[int, ...], np.dtype[np.bool_]]


@dataclass(frozen=True, eq=False)
class BinaryMap:
    """Blocked cells of a map whose axes are those of the scene.

    Attributes:
        blocked: shape (nx, ny) in the plane or (nx, ny, nz).
        origin_m: the low corner of cell 0, shape (2,) or (3,).
        cell_m: edge of a cell.
    """

    blocked: NDArray[np.bool_]
    origin_m: NDArray[np.float64]
    cell_m: float

    def __post_init__(self) -> None:
        if self.blocked.ndim not in {2, 3} or not 0 < self.blocked.size <= MOST_CELLS:
            raise InputError(
                f"a map has two or three axes and at most {MOST_CELLS} cells, not {self.blocked.shape}", field="blocked"
            )
        if self.origin_m.shape != (self.blocked.ndim,) or not np.isfinite(self.origin_m).all():
            raise InputError(f"the map's corner needs {self.blocked.ndim} finite numbers", field="origin_m")
        if not 0 < self.cell_m < math.inf:
            raise InputError(f"a cell's edge must be positive and finite, not {self.cell_m:g}", field="cell_m")

    @property
    def dimensions(self) -> int:
        """2 or 3."""
        return self.blocked.ndim

    @property
    def size_m(self) -> NDArray[np.float64]:
        """Extent along each axis, shape (2,) or (3,)."""
        return np.array(self.blocked.shape) * self.cell_m

    def cells(self, points_m: ArrayLike) -> NDArray[np.float64]:
        """Points in units of cells from the low corner; shapes (..., d)."""
        return np.asarray((np.asarray(points_m, dtype=np.float64) - self.origin_m) / self.cell_m)

    def points_m(self, cells: ArrayLike) -> NDArray[np.float64]:
        """The inverse of `cells`."""
        return np.asarray(np.asarray(cells, dtype=np.float64) * self.cell_m + self.origin_m)

    def is_blocked(self, point_m: ArrayLike, off_map: bool = True) -> bool:
        """Whether a point (d,) is in a blocked cell; `off_map` outside the map."""
        cell = np.floor(self.cells(point_m)).astype(np.int64)
        if (cell < 0).any() or (cell >= self.blocked.shape).any():
            return off_map
        return bool(self.blocked[tuple(cell)])

    def grown(self, distance_m: float) -> BinaryMap:
        """The map with everything blocked that is nearer to a blocked cell than a distance.

        Every point of a cell that is left free keeps the distance from every point of every blocked cell.

        Raises:
            InputError: the distance is negative or not finite.
        """
        if not 0 <= distance_m < math.inf:
            raise InputError(f"the safe distance must be finite and not negative, not {distance_m:g}", field="R")
        # Two points in cells whose middles are d apart are at least d less one diagonal apart.
        reach = distance_m / self.cell_m + math.sqrt(self.dimensions)
        near = self._squared_distances < reach**2 if distance_m else self.blocked
        return BinaryMap(near, self.origin_m, self.cell_m)

    @cached_property
    def _squared_distances(self) -> NDArray[np.float32]:
        """From the nearest blocked cell, in cells, middle to middle: a map may be grown by one margin after another."""
        flat = self.blocked if self.dimensions == 3 else self.blocked[:, :, None]
        return squared_distance_transform(flat).reshape(self.blocked.shape)

    def room_m(self, point_m: ArrayLike) -> float:
        """The distance by which the map can be grown with a point (d,) still free; negative when there is none."""
        cells = np.argwhere(self.blocked)
        if not len(cells):
            return math.inf
        away = np.linalg.norm(cells - np.floor(self.cells(point_m)), axis=1).min()
        return float(away - math.sqrt(self.dimensions)) * self.cell_m - ROUNDING_M


@compiled
def mark_about(marked: Marks, start: Floats, end: Floats, reach: float) -> None:
    """Mark the cells of a map of the plane whose middles are nearer to a straight than a reach.

    Args:
        marked: shape (nx, ny).
        start: of the straight, in cells, shape (2,); it may be off the map.
        end: likewise.
        reach: in cells.
    """
    x, y = start
    dx, dy = end[0] - x, end[1] - y
    square = max(dx * dx + dy * dy, 1e-12)
    for i in range(max(int(min(x, x + dx) - reach), 0), min(int(max(x, x + dx) + reach) + 1, marked.shape[0])):
        for j in range(max(int(min(y, y + dy) - reach), 0), min(int(max(y, y + dy) + reach) + 1, marked.shape[1])):
            ox, oy = i + 0.5 - x, j + 0.5 - y
            along = min(max((ox * dx + oy * dy) / square, 0.0), 1.0)
            if (ox - along * dx) ** 2 + (oy - along * dy) ** 2 < reach * reach:
                marked[i, j] = True


def check_query(area: BinaryMap, start_m: ArrayLike, goal_m: ArrayLike) -> None:
    """Refuse a query that has no answer on a map, whatever the planner.

    Raises:
        InputError: start or goal is not a point of the map's dimensions, or is blocked.
    """
    for field, point in (("start", start_m), ("goal", goal_m)):
        check_point(field, point, area.dimensions)
        if area.is_blocked(point):
            raise blocked_error(field)


def check_point(field: str, point_m: ArrayLike, dimensions: int) -> None:
    """Refuse what is not a point.

    Raises:
        InputError: it names the field.
    """
    point = np.asarray(point_m, dtype=np.float64)
    if point.shape != (dimensions,) or not np.isfinite(point).all():
        raise InputError(f"a point needs {dimensions} finite coordinates", field=field)


def blocked_error(field: str) -> InputError:
    """What is said of a start or a goal that is inside an obstacle."""
    if field == "start":
        return InputError(
            "an obstacle is on the vehicle, or nearer than the safe distance: hold or back off", field=field
        )
    return InputError("the goal is inside an obstacle or off the map: rejoin the trajectory further on", field=field)
