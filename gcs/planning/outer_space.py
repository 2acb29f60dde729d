"""Free space at the bare clearance that is connected with the outside: where a camera could be at all.

It is coarser than the space that paths are searched in, and wider: without the corridor's reach. It only decides what
counts as coverable.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy import ndimage

from gcs.planning.fence import room_in_fence

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from gcs.planning.fence import FenceVolume
    from gcs.planning.point_distance import SceneDistance

CELLS_ALONG = 110
FINEST_PITCH_M = 0.25
COARSEST_PITCH_M = 2.0
CHUNK = 50000


class OuterSpace:
    """Free places that a flood from the border of a coarse grid reaches.

    Args:
        distance: exact distances; the ground counts.
        clearance_m: what a centre keeps from everything.
        bounds_m: lowest and highest corner of the structure, shape (2, 3).
        margin_m: room about the structure; whatever is further out is connected.
        fence: what to stay in.
        poll: called now and then; may raise to stop the work.
    """

    def __init__(
        self,
        distance: SceneDistance,
        clearance_m: float,
        bounds_m: NDArray[np.float64],
        margin_m: float,
        fence: FenceVolume,
        poll: Callable[[], None],
    ) -> None:
        self._distance = distance
        self._clearance = clearance_m
        self._fence = fence
        low, high = bounds_m[0] - margin_m, bounds_m[1] + margin_m
        if distance.ground_m is not None:
            low[2] = max(low[2], distance.ground_m)
        self._low = low
        self._pitch = float(np.clip((high - low).max() / CELLS_ALONG, FINEST_PITCH_M, COARSEST_PITCH_M))
        shape = np.ceil((high - low) / self._pitch).astype(np.int64) + 1
        axes = [low[k] + self._pitch * np.arange(shape[k]) for k in range(3)]
        cells = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        free = np.empty(len(cells), dtype=np.bool_)
        for first in range(0, len(cells), CHUNK):
            part = slice(first, first + CHUNK)
            free[part] = distance.distance(cells[part], limit=clearance_m) >= clearance_m
            poll()
        free = free.reshape(shape)
        labels, _ = ndimage.label(free)
        border = np.zeros(free.shape, dtype=np.bool_)
        border[[0, -1]] = border[:, [0, -1]] = True
        border[:, :, -1] = True
        self._connected = free & np.isin(labels, np.unique(labels[border & free]))

    def holds(self, points_m: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Whether a camera could be at points, shape (N, 3) -> (N,)."""
        cell = np.rint((points_m - self._low) / self._pitch).astype(np.int64)
        within = ((cell >= 0) & (cell < self._connected.shape)).all(axis=1)
        result = np.ones(len(points_m), dtype=np.bool_)
        inner = cell[within]
        result[within] = self._connected[inner[:, 0], inner[:, 1], inner[:, 2]]
        result &= room_in_fence(points_m, self._fence) >= 0
        left = np.flatnonzero(result)
        result[left] = self._distance.distance(points_m[left], limit=self._clearance) >= self._clearance
        return result
