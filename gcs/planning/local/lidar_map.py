"""What a lidar saw lately, on a map about the vehicle: filled where beams end, carved where they pass, and fading.

Every cell holds the logarithm of the odds that it is occupied (Moravec and Elfes 1985), from even upwards: one hit is
enough to block a cell whatever passed it before, several beams that pass are needed to free it again, and without new
measurements the odds fade to even, so that what has driven away does not stay. Cells never seen are even too, and
count as free.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.errors import InputError
from gcs.planning.local.binary_map import MOST_CELLS, BinaryMap
from gcs.planning.numerics.compiled import compiled

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from gcs.planning.local.lidar_scan import LidarScan

HIT, PASSED = 0.9, -0.4
"""What a beam that ends in a cell, or passes it, adds to its log-odds."""

MOST = 3.0
"""The log-odds stay below, so that a cell can change its mind."""

BLOCKED = 0.3
"""Log-odds above which a cell counts as blocked."""

BESIDE_M = 0.5
"""What is so near to a moving obstacle's disc is part of it."""

NO_DISCS = np.empty((0, 3))

UNTOUCHED, IS_PASSED, IS_HIT = 0, 1, 2

Floats = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
SingleFloats = np.ndarray[tuple[int, ...], np.dtype[np.float32]]
Bytes = np.ndarray[tuple[int, ...], np.dtype[np.uint8]]
Marks = np.ndarray[tuple[int, ...], np.dtype[np.bool_]]


class LidarMap:
    """A square that goes with the vehicle, by whole cells.

    Args:
        side_m: edge of the square.
        cell_m: edge of a cell.
        fade_s: time after which log-odds are down to 1/e of what they were.

    Raises:
        InputError: a length or time that is not positive and finite, or too many cells.
    """

    def __init__(self, side_m: float, cell_m: float, fade_s: float) -> None:
        for field, value in (("side_m", side_m), ("cell_m", cell_m), ("fade_s", fade_s)):
            if not 0 < value < math.inf:
                raise InputError(f"it must be positive and finite, not {value:g}", field=field)
        count = math.ceil(side_m / cell_m)
        if count**2 > MOST_CELLS:
            raise InputError(f"{count} x {count} cells are too many: take larger cells", field="cell_m")
        self._cell_m, self._fade_s = cell_m, fade_s
        self._log_odds = np.zeros((count, count), dtype=np.float32)
        self._corner = np.zeros(2, dtype=np.int64)  # of cell 0, in cells from the scene's origin
        self._time_s = -math.inf

    def take(
        self,
        scan: LidarScan,
        position_m: ArrayLike,
        heading_rad: float,
        time_s: float,
        moving: NDArray[np.float64] = NO_DISCS,
        round_things: NDArray[np.float64] = NO_DISCS,
    ) -> None:
        """Enter a scan.

        Args:
            scan: what was measured; each range is the least within its step.
            position_m: of the sensor, shape (2,), scene ENU.
            heading_rad: of the vehicle's nose, counter-clockwise from east.
            time_s: when; not before the last scan's.
            moving: discs of x, y and radius (K, 3) of what is tracked as moving: what is hit in them does not stay on
                the map, or it would leave a trail.
            round_things: discs (K, 3) that what is round reaches no further than, errors included: a sector in which
                one of them begins where it ends is hit there alone, not over its whole width.

        Raises:
            InputError: the pose or the time is not a finite number, or the scan is older than the last one.
        """
        position = np.asarray(position_m, dtype=np.float64)
        if position.shape != (2,) or not np.isfinite(position).all() or not math.isfinite(heading_rad):
            raise InputError("the sensor's place and heading must be finite numbers", field="position_m")
        if not self._time_s <= time_s < math.inf:
            raise InputError(f"a scan of {time_s:g} s is older than the map of {self._time_s:g} s", field="time_s")
        self._fade_to(time_s)
        self._follow(position)
        beams, each = scan.spread()
        ends, hits = beams.rays(position, heading_rad)
        hits &= (_off(ends, moving) > BESIDE_M).all(axis=1)
        of_round = (_off(ends, round_things) <= 0).any(axis=1)
        explained = np.repeat(of_round.reshape(-1, each).any(axis=1), each)
        hits &= of_round | ~explained
        _enter(self._log_odds, self._in_cells(position), self._in_cells(ends), hits)

    def blocked_at(self, time_s: float) -> BinaryMap:
        """The binarised map as it is at a time not before the last scan; grow it by the safe distance to plan on it."""
        fade = math.exp(-max(time_s - self._time_s, 0.0) / self._fade_s) if math.isfinite(self._time_s) else 1.0
        return BinaryMap(self._log_odds * fade > BLOCKED, self._corner.astype(np.float64) * self._cell_m, self._cell_m)

    def _in_cells(self, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(points_m / self._cell_m - self._corner)

    def _fade_to(self, time_s: float) -> None:
        if math.isfinite(self._time_s):
            self._log_odds *= np.float32(math.exp(-(time_s - self._time_s) / self._fade_s))
        self._time_s = time_s

    def _follow(self, position_m: NDArray[np.float64]) -> None:
        """Keep the vehicle in the middle half of the square; what leaves the square is forgotten."""
        count = len(self._log_odds)
        off = np.floor(self._in_cells(position_m)).astype(np.int64) - count // 2
        if (np.abs(off) <= count // 4).all():
            return
        self._corner += off
        kept = [slice(max(o, 0), max(count + min(o, 0), 0)) for o in off]
        moved = np.zeros_like(self._log_odds)
        if (np.abs(off) < count).all():
            into = tuple(slice(max(-o, 0), count - max(o, 0)) for o in off)
            moved[into] = self._log_odds[tuple(kept)]
        self._log_odds = moved


def _off(points: NDArray[np.float64], discs: NDArray[np.float64]) -> NDArray[np.float64]:
    """How far points (N, 2) are from the edges of discs (K, 3), negative inside, shape (N, K)."""
    return np.asarray(np.linalg.norm(points[:, None] - discs[:, :2], axis=2) - discs[:, 2])


@compiled
def _enter(log_odds: SingleFloats, origin: Floats, ends: Floats, hits: Marks) -> None:
    """Add one scan's evidence, once to each cell; where one beam ends, others that pass do not count."""
    touched = np.zeros(log_odds.shape, np.uint8)
    for ray in range(len(ends)):
        if hits[ray]:
            i, j = math.floor(ends[ray, 0]), math.floor(ends[ray, 1])
            if 0 <= i < touched.shape[0] and 0 <= j < touched.shape[1]:
                touched[i, j] = IS_HIT
    for ray in range(len(ends)):
        _mark_passed(touched, origin, ends[ray])
    for i in range(log_odds.shape[0]):
        for j in range(log_odds.shape[1]):
            if touched[i, j] != UNTOUCHED:
                added = HIT if touched[i, j] == IS_HIT else PASSED
                log_odds[i, j] = min(max(log_odds[i, j] + added, 0.0), MOST)


@compiled
def _mark_passed(touched: Bytes, origin: Floats, end: Floats) -> None:
    """Mark the cells that a beam passes before its end, as far as the map goes; the origin is on it."""
    i, j = math.floor(origin[0]), math.floor(origin[1])
    last_i, last_j = math.floor(end[0]), math.floor(end[1])
    dx, dy = end[0] - origin[0], end[1] - origin[1]
    step_i, step_j = (1 if dx > 0.0 else -1), (1 if dy > 0.0 else -1)
    next_x = ((i + (step_i > 0)) - origin[0]) / dx if i != last_i else np.inf
    next_y = ((j + (step_j > 0)) - origin[1]) / dy if j != last_j else np.inf
    while i != last_i or j != last_j:
        if i < 0 or j < 0 or i >= touched.shape[0] or j >= touched.shape[1]:
            return
        if touched[i, j] == UNTOUCHED:
            touched[i, j] = IS_PASSED
        if next_x < next_y:
            i += step_i
            next_x = next_x + abs(1.0 / dx) if i != last_i else np.inf
        else:
            j += step_j
            next_y = next_y + abs(1.0 / dy) if j != last_j else np.inf
