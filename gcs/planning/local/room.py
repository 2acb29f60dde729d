"""How far every cell of a map is from what stands."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gcs.planning.local.binary_map import BinaryMap
from gcs.planning.scene.distance_transform import squared_distance_transform

if TYPE_CHECKING:
    from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class Room:
    """Distances on a map of the plane.

    Attributes:
        room_m: every point of the cell is at least so far from everything that stands or is forbidden, shape (nx, ny).
        standing_m: the same from what stands alone.
        origin_m: low corner, shape (2,).
        cell_m: edge of a cell.
    """

    room_m: NDArray[np.float64]
    standing_m: NDArray[np.float64]
    origin_m: NDArray[np.float64]
    cell_m: float

    def blocked_below(self, distance_m: float) -> BinaryMap:
        """The map of what is nearer than a distance: as if what stands were grown by it."""
        return BinaryMap(self.room_m < distance_m, self.origin_m, self.cell_m)

    def standing_below(self, distance_m: float) -> BinaryMap:
        """The same without what is only forbidden."""
        return BinaryMap(self.standing_m < distance_m, self.origin_m, self.cell_m)

    def at(self, place_m: NDArray[np.float64]) -> float:
        """The room at a place (2,) or (3,); zero off the map."""
        cell = np.floor((place_m[:2] - self.origin_m) / self.cell_m).astype(np.int64)
        if (cell < 0).any() or (cell >= self.room_m.shape).any():
            return 0.0
        return float(self.room_m[tuple(cell)])


def room_about(standing: BinaryMap, forbidden: NDArray[np.bool_] | None, safe_m: float) -> Room:
    """Measure a map.

    Args:
        standing: of the plane, not grown.
        forbidden: cells of it that are grown already: what lies just outside of them keeps the safe distance, and what
            lies inside keeps the less the deeper it is.
        safe_m: R.
    """
    standing_m = room_m = _distance_m(standing.blocked, standing.cell_m)
    if forbidden is not None:
        outside_m, inside_m = (_distance_m(cells, standing.cell_m) for cells in (forbidden, ~forbidden))
        room_m = np.minimum(room_m, safe_m + outside_m - np.maximum(inside_m, 0.0))
    return Room(room_m, standing_m, standing.origin_m, standing.cell_m)


def _distance_m(blocked: NDArray[np.bool_], cell_m: float) -> NDArray[np.float64]:
    cells = np.sqrt(squared_distance_transform(blocked[:, :, None])[:, :, 0].astype(np.float64))
    # Two points in cells whose middles are d apart are at least d less one diagonal apart.
    return np.asarray((cells - math.sqrt(2)) * cell_m)
