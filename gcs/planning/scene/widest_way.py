"""How much room the widest way from home to a place has: what to say when the asked clearance leaves none."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy import ndimage

from gcs.planning.scene.fence import room_in_fence
from gcs.planning.scene.room import exact_distance

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from gcs.planning.scene.free_space import FreeSpace

STEP_M = 0.01
"""The answer is found to this."""


def largest_clearance_m(space: FreeSpace, places_m: NDArray[np.float64]) -> float:
    """Largest clearance about the vehicle's centre at which one of some places can be reached from home.

    The ways are those over the space's own grid, so it is a little less than what a finer grid would find; it is never
    more. The fence is kept as it is.

    Args:
        space: of a larger clearance, at which none of them can be reached.
        places_m: shape (N, 3).

    Returns:
        Metres; 0 when no clearance will do.
    """
    model, pitch = space.model, space.pitch_m
    ground = model.ground
    heights = space.low_m[2] + (np.arange(model.distance.shape[2]) + 0.5) * pitch
    room = np.minimum(model.distance, (heights - ground)[None, None, :])
    fenced = _inside_fence(space)
    places = places_m[room_in_fence(places_m, model.fence) >= 0]
    cells = space.cell_of(places)
    inside = ((cells >= 0) & (cells < room.shape)).all(axis=1)
    places, cells = places[inside], cells[inside]
    limit = space.clearance_m + pitch
    own = np.array([min(exact_distance(p, limit, model), p[2] - ground) for p in places])
    step = 0.5 * pitch  # between centres of neighbours that both keep so much more, all of the way is clear
    start = tuple(space.cell_of(space.take_off_m)[0])

    def reached(clearance: float) -> bool:
        labels, _ = ndimage.label((room >= clearance + step) & fenced)
        if labels[start] == 0:
            return False
        near = ndimage.binary_dilation(labels == labels[start], np.ones((3, 3, 3), dtype=np.bool_))
        return bool((near[tuple(cells.T)] & (own >= clearance)).any())

    low, high = 0.0, space.clearance_m
    while high - low > STEP_M:
        middle = (low + high) / 2
        low, high = (middle, high) if reached(middle) else (low, middle)
    return low


def _inside_fence(space: FreeSpace) -> NDArray[np.bool_]:
    """Cells whose centre lies inside the fence, shape (nx, ny, nz)."""
    nx, ny, nz = space.model.distance.shape
    columns = np.stack(np.meshgrid(np.arange(nx), np.arange(ny), [0], indexing="ij"), axis=-1).reshape(-1, 3)
    low = space.centre_of(columns)
    inside = (room_in_fence(low, space.model.fence) >= 0).reshape(nx, ny, 1)
    heights = space.low_m[2] + (np.arange(nz) + 0.5) * space.pitch_m
    return np.asarray(inside & (heights <= space.model.fence.max_height_m - space.model.fence.margin_m))
