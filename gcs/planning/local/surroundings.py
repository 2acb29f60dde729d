"""What is about the vehicle: what stands, as the lidar saw it lately, what moves, what the known structure forbids."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.errors import InputError
from gcs.planning.local.binary_map import BinaryMap
from gcs.planning.local.lidar_map import BESIDE_M, LidarMap
from gcs.planning.local.moving_tracks import Tracker
from gcs.planning.local.scan_circles import scan_circles

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from gcs.planning.local.lidar_scan import LidarScan
    from gcs.planning.local.moving_tracks import Track

SeenDisc = tuple[float, float, float, float, float]
"""x, y and radius (m) of an obstacle, and its velocity east and north (m/s), scene ENU."""

ON_PLAN_M = 0.3
"""So near to the plan's own path the known structure forbids nothing: the plan was certified against it."""

AROUND_M = 0.15
"""What is round reaches no further than this and one deviation beyond its circle."""


@dataclass(frozen=True, eq=False)
class Scene:
    """The surroundings at one moment.

    Attributes:
        clock_s: when.
        seen: map of the plane as the lidar filled it, not grown; moving obstacles may be on it.
        tracks: of the moving obstacles.
        discs: rows of x, y and radius of what looked round in the last scan, shape (K, 3).
        forbidden: cells of the map that nothing new may enter though no lidar sees why.
        slab_m: heights for which the map holds; None for all.
    """

    clock_s: float
    seen: BinaryMap
    tracks: list[Track]
    discs: NDArray[np.float64]
    forbidden: NDArray[np.bool_] | None
    slab_m: tuple[float, float] | None

    def nearest(self, place_m: NDArray[np.float64]) -> SeenDisc | None:
        """The obstacle nearest to a place (3,); None when none is seen."""
        moving = [(*track.positions([self.clock_s])[0], track.radius_m, *track.state[2:]) for track in self.tracks]
        standing = [
            (*disc, 0.0, 0.0)
            for disc in self.discs
            if all(math.dist(disc[:2], track[:2]) > disc[2] + BESIDE_M for track in moving)
        ]
        seen = [tuple(float(value) for value in row) for row in (*moving, *standing)]
        return min(seen, key=lambda row: math.dist(row[:2], place_m[:2]) - row[2], default=None)  # type: ignore[return-value]


class Surroundings:
    """Takes scans in and says what is about the vehicle.

    Args:
        area: the map of what was seen, empty.
        known: see `NavigatorOptions`.
        slab_half_m: likewise.
    """

    def __init__(self, area: LidarMap, known: BinaryMap | None, slab_half_m: float | None) -> None:
        self._map, self._known, self._slab_half_m = area, known, slab_half_m
        self._tracker = Tracker()
        self._discs = np.empty((0, 3))

    def see(self, scan: LidarScan, position_m: NDArray[np.float64], heading_rad: float, clock_s: float) -> None:
        """Enter a scan.

        Args:
            scan: what was measured; each range is the least within its step.
            position_m: of the vehicle, scene ENU, shape (3,).
            heading_rad: of its nose, counter-clockwise from east.
            clock_s: when; not before the last scan's.

        Raises:
            InputError: the pose or the time is not a finite number, or the scan is older than the last one; nothing
                of it is entered.
        """
        position = np.asarray(position_m, dtype=np.float64)
        if position.shape != (3,) or not np.isfinite(position).all():
            raise InputError("the vehicle's place needs three finite numbers", field="position_m")
        if not (math.isfinite(heading_rad) and math.isfinite(clock_s)):
            raise InputError("the vehicle's heading and the scan's time must be finite numbers", field="heading_rad")
        circles = scan_circles(scan, position[:2], heading_rad)
        self._tracker.see(circles.discs, clock_s, circles.covariances)
        self._discs = circles.discs
        moving = np.array([[*track.state[:2], track.radius_m] for track in self._tracker.moving()]).reshape(-1, 3)
        reach = circles.discs[:, 2] + circles.deviations_m + AROUND_M
        round_things = np.column_stack([circles.discs[:, :2], reach])
        self._map.take(scan, position[:2], heading_rad, clock_s, moving, round_things)

    def at(self, clock_s: float, height_m: float, path_m: NDArray[np.float64]) -> Scene:
        """What is known now.

        Args:
            clock_s: now.
            height_m: of the vehicle.
            path_m: points of the plan's own path ahead, shape (N, 3).
        """
        slab = None if self._slab_half_m is None else (height_m - self._slab_half_m, height_m + self._slab_half_m)
        seen = self._map.blocked_at(clock_s)
        return Scene(clock_s, seen, self._tracker.moving(), self._discs, self._forbidden(seen, slab, path_m), slab)

    def _forbidden(
        self, seen: BinaryMap, slab: tuple[float, float] | None, path_m: NDArray[np.float64]
    ) -> NDArray[np.bool_] | None:
        if self._known is None:
            return None
        flat = _layers(self._known, slab)
        axes = [
            np.floor((seen.origin_m[k] + (np.arange(n) + 0.5) * seen.cell_m - flat.origin_m[k]) / flat.cell_m)
            for k, n in enumerate(seen.blocked.shape)
        ]
        inside = [(axis >= 0) & (axis < n) for axis, n in zip(axes, flat.blocked.shape, strict=True)]
        forbidden = np.ones(seen.blocked.shape, dtype=np.bool_)
        i, j = (axis[good].astype(np.int64) for axis, good in zip(axes, inside, strict=True))
        forbidden[np.ix_(*inside)] = flat.blocked[np.ix_(i, j)]
        reach = math.ceil(ON_PLAN_M / seen.cell_m)
        for cell in np.unique(np.floor(seen.cells(path_m[:, :2])).astype(np.int64), axis=0):
            low = np.maximum(cell - reach, 0)
            high = np.maximum(cell + reach + 1, 0)
            forbidden[low[0] : high[0], low[1] : high[1]] = False
        return forbidden


def _layers(known: BinaryMap, slab: tuple[float, float] | None) -> BinaryMap:
    """What is blocked at any of some heights, as a map of the plane; off the map everything is."""
    if known.dimensions == 2:
        return known
    count = known.blocked.shape[2]
    low, high = (0, count - 1)
    if slab is not None:
        low, high = (math.floor((z - known.origin_m[2]) / known.cell_m) for z in slab)
    blocked = np.asarray(known.blocked[:, :, max(low, 0) : max(high + 1, 0)].any(axis=2))
    if low < 0 or high >= count:
        blocked = np.ones_like(blocked)
    return BinaryMap(blocked, known.origin_m[:2], known.cell_m)
