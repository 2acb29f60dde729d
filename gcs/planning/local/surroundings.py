"""What is about the vehicle: what stands, as the lidar saw it lately, what moves, what the known structure forbids."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.errors import InputError
from gcs.planning.local.lidar_map import BESIDE_M, LidarMap
from gcs.planning.local.moving_tracks import Tracker
from gcs.planning.local.scan_circles import scan_circles

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from gcs.planning.local.binary_map import BinaryMap
    from gcs.planning.local.known_room import KnownRoom
    from gcs.planning.local.lidar_scan import LidarScan
    from gcs.planning.local.moving_tracks import Track

SeenDisc = tuple[float, float, float, float, float]
"""x, y and radius (m) of an obstacle, and its velocity east and north (m/s), scene ENU."""

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
        known: what the known structure forbids elsewhere; None without one.
    """

    clock_s: float
    seen: BinaryMap
    tracks: list[Track]
    discs: NDArray[np.float64]
    forbidden: NDArray[np.bool_] | None
    slab_m: tuple[float, float] | None
    known: KnownRoom | None

    def column_is_free(self, place_m: NDArray[np.float64], height_m: float) -> bool:
        """Whether the known structure leaves the way from a place (3,) straight up or down to a height."""
        return self.known is None or self.known.column_is_free(place_m, height_m)

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
        known: what the known structure forbids; None without one.
        slab_half_m: see `NavigatorOptions`.
    """

    def __init__(self, area: LidarMap, known: KnownRoom | None, slab_half_m: float | None) -> None:
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

    def at(self, clock_s: float, place_m: NDArray[np.float64]) -> Scene:
        """What is known now about the vehicle at a place (3,)."""
        height_m = float(place_m[2])
        slab = None if self._slab_half_m is None else (height_m - self._slab_half_m, height_m + self._slab_half_m)
        seen = self._map.blocked_at(clock_s)
        forbidden = None if self._known is None else self._known.forbidden(seen, place_m)
        return Scene(clock_s, seen, self._tracker.moving(), self._discs, forbidden, slab, self._known)
