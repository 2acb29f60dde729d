"""What the known structure forbids to local paths, about a plan that was certified against it.

The known map is grown by all that has to be kept, and its cells are coarse, so the plan itself may pass through cells
that it blocks: about the plan, and about the place where the vehicle already is, only what lies deeper is forbidden.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import maximum_filter1d

from gcs.planning.scene.distance_transform import squared_distance_transform

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from gcs.core.trajectory import PiecewisePolynomial
    from gcs.planning.local.binary_map import BinaryMap

DEEPER_M = 0.3
"""No deeper than this below the depth at which the plan is ..."""

BESIDE_PLAN_M = 1.0
"""... the known structure forbids nothing so near to the plan, seen from above ..."""

ABOVE_PLAN_M = 0.5
"""... and at heights so near to the plan's."""

LOOK_EVERY_S = 0.1
"""The plan's path is known by its places at these steps of time."""

LOOKS = 16
"""So many places of each piece of a curve are looked at: the known map has room for what lies between."""


class KnownRoom:
    """Answers for one plan.

    Args:
        known: cells that the known structure blocks; see `NavigatorOptions`.
        plan: scene ENU.
    """

    def __init__(self, known: BinaryMap, plan: PiecewisePolynomial) -> None:
        self._known = known
        self._plan_m = plan.value(np.linspace(0.0, plan.duration_s, math.ceil(plan.duration_s / LOOK_EVERY_S) + 1))

    def forbidden(self, seen: BinaryMap, place_m: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Which cells of a map of the plane nothing new may enter at the height of the vehicle.

        Args:
            seen: the map; what is on it does not matter.
            place_m: of the vehicle, shape (3,).

        Returns:
            Of the map's shape.
        """
        known = self._known
        axes = [
            np.floor((seen.origin_m[k] + (np.arange(n) + 0.5) * seen.cell_m - known.origin_m[k]) / known.cell_m)
            for k, n in enumerate(seen.blocked.shape)
        ]
        inside = [(axis >= 0) & (axis < n) for axis, n in zip(axes, known.blocked.shape[:2], strict=True)]
        i, j = (axis[good].astype(np.int64) for axis, good in zip(axes, inside, strict=True))
        forbidden = np.ones(seen.blocked.shape, dtype=np.bool_)
        forbidden[np.ix_(*inside)] = self._layer(float(place_m[2]))[np.ix_(i, j)]
        certified = self._plan_m[np.abs(self._plan_m[:, 2] - place_m[2]) <= ABOVE_PLAN_M]
        return _deeper_than(np.concatenate([certified, place_m[None]]), forbidden, seen)

    def forbids(self, curve: PiecewisePolynomial) -> NDArray[np.bool_]:
        """Which pieces of a curve enter, at their own heights, what is forbidden, shape (S,)."""
        shares = (np.arange(LOOKS) + 0.5) / LOOKS
        places = curve.value(curve.starts_s[:-1, None] + shares * curve.durations_s[:, None])
        bad = self._blocked(places)
        if bad.any():
            bad[bad] = ~self._is_certified(places[bad], np.concatenate([self._plan_m, curve.value(np.zeros(1))]))
        return np.asarray(bad.any(axis=1))

    def column_is_free(self, place_m: NDArray[np.float64], height_m: float) -> bool:
        """Whether the vehicle may go straight up or down from a place (3,) to a height."""
        count = math.ceil(abs(height_m - place_m[2]) / self._known.cell_m) + 1
        places = np.tile(place_m, (count, 1))
        places[:, 2] = np.linspace(place_m[2], height_m, count)
        bad = places[self._blocked(places)]
        return bool(self._is_certified(bad, np.concatenate([self._plan_m, place_m[None]])).all())

    def _layer(self, height_m: float) -> NDArray[np.bool_]:
        """What is blocked at a height; off the map everything is."""
        if self._known.dimensions == 2:
            return self._known.blocked
        layer = int(np.floor((height_m - self._known.origin_m[2]) / self._known.cell_m))
        if 0 <= layer < self._known.blocked.shape[2]:
            return np.asarray(self._known.blocked[:, :, layer])
        return np.ones(self._known.blocked.shape[:2], dtype=np.bool_)

    def _blocked(self, places_m: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Whether places (..., 3) are in blocked cells, or off the map."""
        known = self._known
        cells = np.floor(known.cells(places_m[..., : known.dimensions])).astype(np.int64)
        inside = ((cells >= 0) & (cells < known.blocked.shape)).all(axis=-1)
        blocked = np.ones(inside.shape, dtype=np.bool_)
        blocked[inside] = known.blocked[tuple(cells[inside].T)]
        return blocked

    def _is_certified(self, places_m: NDArray[np.float64], plan_m: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Which places (N, 3) are near to some of the plan's (M, 3)."""
        if not len(places_m):
            return np.ones(0, dtype=np.bool_)
        plan_m = plan_m[(np.abs(plan_m - places_m.mean(axis=0)) < 1.0 + np.ptp(places_m, axis=0)).all(axis=1)]
        away = np.linalg.norm(places_m[:, None, :2] - plan_m[:, :2], axis=2)
        off = np.abs(places_m[:, None, 2] - plan_m[:, 2])
        return np.asarray(((away <= BESIDE_PLAN_M) & (off <= ABOVE_PLAN_M)).any(axis=1))


def _deeper_than(points_m: NDArray[np.float64], forbidden: NDArray[np.bool_], area: BinaryMap) -> NDArray[np.bool_]:
    """What remains forbidden about some points (N, 3): only what lies deeper inside than the points themselves.

    From a point inside the way out is free, then, and the way on beside it, but not the way further in.
    """
    cells = np.floor(area.cells(points_m[:, :2])).astype(np.int64)
    cells = cells[((cells >= 0) & (cells < forbidden.shape)).all(axis=1)]
    if not forbidden[tuple(cells.T)].any():
        return forbidden
    depth = np.sqrt(squared_distance_transform(~forbidden[:, :, None])[:, :, 0].astype(np.float64))
    reached = np.full(forbidden.shape, -np.inf)
    reached[tuple(cells.T)] = depth[tuple(cells.T)]
    for axis in range(2):
        reached = maximum_filter1d(reached, 2 * math.ceil(BESIDE_PLAN_M / area.cell_m) + 1, axis=axis)
    return np.asarray(forbidden & (depth > reached + math.ceil(DEEPER_M / area.cell_m)))
