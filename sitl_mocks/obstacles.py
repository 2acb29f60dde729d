"""What no plan knows of: upright cylinders that stand, or go along paths, as vehicles, people and other drones do."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sitl_mocks import obstacle_kernel as kernel

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Obstacle:
    """One upright cylinder.

    Attributes:
        name: tells it from others.
        path_m: corners (x, y) of its way, scene ENU; one alone for what stands.
        radius_m: of the cylinder.
        base_m: height of its lower end, scene ENU.
        height_m: from there to its upper end.
        speed_m_s: along the path.
        start_s: vehicle's clock at which it sets out.
        pause_s: how long it stops at each corner between the first and the last.
        repeats: whether it goes to and fro for ever.
    """

    name: str
    path_m: tuple[tuple[float, float], ...]
    radius_m: float
    base_m: float
    height_m: float
    speed_m_s: float = 1.0
    start_s: float = 0.0
    pause_s: float = 0.0
    repeats: bool = False

    def knots(self) -> Array:
        """Time, x and y of each moment at which it sets out, turns or stops, shape (K, 3)."""
        way = [*self.path_m, *self.path_m[-2::-1]] if self.repeats else list(self.path_m)
        rows, now_s = [(self.start_s, *way[0])], self.start_s
        for start, end in itertools.pairwise(way):
            now_s += math.dist(start, end) / self.speed_m_s
            rows.append((now_s, *end))
            if self.pause_s > 0.0:
                now_s += self.pause_s
                rows.append((now_s, *end))
        return np.array(rows)


class Obstacles:
    """All obstacles of a scene.

    Args:
        obstacles: any number.
    """

    def __init__(self, obstacles: Sequence[Obstacle]) -> None:
        self.names = [obstacle.name for obstacle in obstacles]
        paths = [obstacle.knots() for obstacle in obstacles]
        self._shapes = np.array([(o.radius_m, o.base_m, o.base_m + o.height_m) for o in obstacles]).reshape(-1, 3)
        self._knots = np.vstack([np.empty((0, 3)), *paths])
        self._first = np.cumsum([0, *map(len, paths)], dtype=np.int64)
        self._periods = np.array(
            [path[-1, 0] - path[0, 0] if o.repeats else 0.0 for o, path in zip(obstacles, paths, strict=True)]
        )

    def __len__(self) -> int:
        return len(self.names)

    def place_m(self, index: int, time_s: float) -> tuple[float, float]:
        """Where the middle of an obstacle is, scene ENU."""
        return kernel.place(index, time_s, self._knots, self._first, self._periods)

    def nearest(self, point_m: Array, time_s: float) -> tuple[float, int]:
        """Signed distance of a point (3,) from the nearest obstacle, negative within, and its index; -1 when none."""
        return kernel.nearest(point_m, time_s, self._shapes, self._knots, self._first, self._periods)

    def sweep(self, point_m: Array, bearings_rad: Array, reach_m: float, time_s: float) -> Array:
        """Ranges along bearings (from east, counter-clockwise) in the level plane of a point (3,).

        What does not cross the plane is not seen. Returns infinity where nothing is within reach, 0 everywhere when
        the point is within an obstacle.
        """
        return kernel.sweep(
            point_m, bearings_rad, reach_m, time_s, self._shapes, self._knots, self._first, self._periods
        )
