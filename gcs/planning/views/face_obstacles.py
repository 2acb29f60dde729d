"""What is in the way of a viewpoint straight in front of a cell."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from gcs.planning.scene.fence import room_in_fence
from gcs.planning.scene.room import exact_distance
from gcs.planning.scene.visibility import SightLines

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from gcs.core.structure import Structure
    from gcs.planning.scene.free_space import FreeSpace

CABLE_NEAR = "a cable is too near the place in front of it"
STRUCTURE_NEAR = "the structure is too near the place in front of it"
GROUND_NEAR = "the place in front of it is too near the ground"
OUTSIDE_FENCE = "the place in front of it is outside the fence"
UNREACHABLE = "no free way leads to the place in front of it"
CABLE_HIDES = "a cable hides part of it from the place in front of it"
STRUCTURE_HIDES = "the structure hides part of it from the place in front of it"

UNDER_COVER = "the place in front of it is not under the open sky, where the vehicle's own return needs it"


class FaceObstacles:
    """Tells cables, structure, ground and fence apart.

    Args:
        structure: what stands in the scene.
        clearance_m: what a viewpoint keeps from surfaces.
        space: where the vehicle may be.
        sight: what hides the face.
    """

    def __init__(self, structure: Structure, clearance_m: float, space: FreeSpace, sight: SightLines) -> None:
        self._structure = structure
        self._clearance = clearance_m
        self._space = space
        self._sight = sight

    @cached_property
    def _without_cables(self) -> SightLines:
        return SightLines(replace(self._structure, cables=()))

    def reason(self, place_m: NDArray[np.float64], targets_m: NDArray[np.float64]) -> str:
        """Why a place will not do.

        Args:
            place_m: shape (3,); it is not free, not reachable, does not see all of the targets or is under cover.
            targets_m: what it has to see, shape (K, 3).
        """
        if not self._space.is_free(place_m)[0]:
            return self._too_near(place_m)
        if not self._space.is_reachable(place_m)[0]:
            return UNREACHABLE
        if self._sight.clear(place_m, targets_m).all():
            return UNDER_COVER
        return CABLE_HIDES if self._without_cables.clear(place_m, targets_m).all() else STRUCTURE_HIDES

    def _too_near(self, place_m: NDArray[np.float64]) -> str:
        model = self._space.model
        bare = model._replace(cable_ends=np.zeros((0, 2, 3)), cable_radii=np.zeros(0))
        limit = self._clearance + 1.0
        anything, structure = exact_distance(place_m, limit, model), exact_distance(place_m, limit, bare)
        if anything <= self._clearance:
            return CABLE_NEAR if anything < structure else STRUCTURE_NEAR
        return OUTSIDE_FENCE if room_in_fence(place_m, model.fence)[0] < model.tolerance else GROUND_NEAR
