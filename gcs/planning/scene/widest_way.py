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


def largest_clearance_m(space: FreeSpace, places_m: NDArray[np.float64], *, fenced: bool = True) -> float:
    """Largest clearance about the vehicle's centre at which one of some places can be reached from home.

    The ways are those over the space's own grid, so it is a little less than what a finer grid would find; it is never
    more. The fence is kept as it is, or left out.

    Args:
        space: of a larger clearance, at which none of them can be reached.
        places_m: shape (N, 3).
        fenced: whether the fence is kept.

    Returns:
        Metres; 0 when no clearance will do.
    """
    model = space.model
    places = places_m[room_in_fence(places_m, model.fence) >= 0] if fenced else places_m
    cells = space.cell_of(places)
    inside = ((cells >= 0) & (cells < model.distance.shape)).all(axis=1)
    places, cells = places[inside], cells[inside]
    limit = space.clearance_m + space.pitch_m
    own = np.array([min(exact_distance(p, limit, model), p[2] - model.ground) for p in places])
    start = tuple(space.cell_of(space.take_off_m)[0])

    def reached(clearance: float) -> bool:
        labels, _ = ndimage.label(space.free_cells(clearance, fenced=fenced))
        if labels[start] == 0:
            return False
        near = ndimage.binary_dilation(labels == labels[start], np.ones((3, 3, 3), dtype=np.bool_))
        return bool((near[tuple(cells.T)] & (own >= clearance)).any())

    low, high = 0.0, space.clearance_m
    while high - low > STEP_M:
        middle = (low + high) / 2
        low, high = (middle, high) if reached(middle) else (low, middle)
    return low
