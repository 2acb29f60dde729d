"""Free space at the bare clearance that is connected with the outside: where a camera could be at all.

It is wider than the space that paths are searched in, without the corridor's reach. It only decides what counts as
coverable, and why something does not.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy import ndimage

from gcs.planning.numerics.worker_threads import in_threads

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from gcs.planning.scene.point_distance import SceneDistance

CELLS_ALONG = 160
FINEST_PITCH_M = 0.25
COARSEST_PITCH_M = 2.0
CHUNK = 50000

BLOCKED, ENCLOSED, OPEN = 0, 1, 2
"""A cell nearer to the structure than the clearance, a free one that nothing leads to, and a free one outside."""


class OuterSpace(NamedTuple):
    """Cells about the structure (a named tuple, so that kernels can take it).

    Attributes:
        low: centre of the first cell, scene ENU, shape (3,).
        pitch: edge of the cells (m).
        state: `BLOCKED`, `ENCLOSED` or `OPEN`, shape (nx, ny, nz) uint8. Cells that only the ground keeps from being
            free count as `OPEN`: the ground is judged by height alone. What is outside the grid is `OPEN`.
    """

    low: NDArray[np.float64]
    pitch: float
    state: NDArray[np.uint8]


def build_outer_space(
    distance: SceneDistance,
    clearance_m: float,
    bounds_m: NDArray[np.float64],
    margin_m: float,
    poll: Callable[[], None],
) -> OuterSpace:
    """Flood the free cells from the border of a grid.

    Args:
        distance: exact distances.
        clearance_m: what a centre keeps from everything.
        bounds_m: lowest and highest corner of the structure, shape (2, 3).
        margin_m: room about the structure; whatever is further out is connected.
        poll: called now and then; may raise to stop the work.
    """
    low, high = bounds_m[0] - margin_m, bounds_m[1] + margin_m
    ground = -np.inf if distance.ground_m is None else distance.ground_m
    low[2] = max(low[2], ground)
    pitch = float(np.clip((high - low).max() / CELLS_ALONG, FINEST_PITCH_M, COARSEST_PITCH_M))
    shape = np.maximum(np.ceil((high - low) / pitch).astype(np.int64) + 1, 1)
    size = int(shape.prod())
    look = partial(_clear_cells, distance, clearance_m, low, pitch, shape)
    parts = in_threads(look, range(0, size, CHUNK), lambda _: poll())
    clear = np.concatenate(parts).reshape(shape)
    high_enough = low[2] + pitch * np.arange(shape[2]) >= ground + clearance_m
    free = clear & high_enough
    labels, _ = ndimage.label(free)
    border = np.zeros(free.shape, dtype=np.bool_)
    border[[0, -1]] = border[:, [0, -1]] = True
    border[:, :, -1] = True
    connected = np.zeros(labels.max() + 1, dtype=np.bool_)
    connected[np.unique(labels[border & free])] = True
    connected[0] = False
    state = np.where(free & ~connected[labels], ENCLOSED, OPEN)
    return OuterSpace(low, pitch, np.where(clear, state, BLOCKED).astype(np.uint8))


def _clear_cells(
    distance: SceneDistance,
    clearance_m: float,
    low: NDArray[np.float64],
    pitch: float,
    shape: NDArray[np.int64],
    first: int,
) -> NDArray[np.bool_]:
    """Which of some cells' centres keep the clearance to the structure."""
    numbers = np.arange(first, min(first + CHUNK, int(shape.prod())))
    cells = np.column_stack(np.unravel_index(numbers, tuple(shape)))
    found = distance.distance(low + pitch * cells, ground=False, limit=clearance_m)
    return np.asarray(found >= clearance_m)
