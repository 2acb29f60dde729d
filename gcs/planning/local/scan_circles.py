"""Round objects in a lidar scan whose ranges are each the least within a sector.

A sector of 5 degrees is nearly a metre wide at 10 m, so a range alone says little about where in it something stands.
But a circle of some middle and radius makes a certain pattern of ranges in the sectors that it touches, and leaves
those beside them as they are. All circles of a grid are compared with what was measured: their mean, weighted by
likelihood, is what is seen, and their spread is how sure that is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gcs.planning.numerics.compiled import compiled

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from gcs.planning.local.lidar_scan import LidarScan

GAP_M = 1.2
"""Neighbouring ranges further apart than this belong to two objects."""

SMALL_GAP_M = 0.4
"""What is no circle is cut where its ranges jump by more than this, and tried again."""

RADII_M = np.array([0.2, 0.3, 0.4, 0.55, 0.7, 0.9, 1.1, 1.3, 1.5, 1.8])

BEARINGS = 49
"""So many bearings of the middle are tried over the sectors of an object."""

WIDEST_RAD = 2.2
"""What covers more than this is a wall, or too near to be told from one: it is on the map and does not move."""

RANGE_ERROR_M = 0.07
"""Standard deviation of a range, with that of beams that miss the nearest point."""

WORST = 25.0
"""Square of the most deviations that one sector can count."""

FITS = 9.0
"""Worse than this in the mean of its sectors, the best circle is none."""

LEAST_ERROR_M = 0.04

REPEATED = 2.0
"""Errors of one scan are much those of the next: each counts as so much less."""

MISS, GRAZED_M, BEHIND_M = math.inf, 0.06, 0.3

Floats = np.ndarray[tuple[int, ...], np.dtype[np.float64]]


@dataclass(frozen=True, eq=False)
class SeenCircles:
    """What was found.

    Attributes:
        discs: rows of x, y and radius, scene ENU, m, shape (K, 3).
        covariances: of the middles, m^2, shape (K, 2, 2).
    """

    discs: NDArray[np.float64]
    covariances: NDArray[np.float64]

    @property
    def deviations_m(self) -> NDArray[np.float64]:
        """Of the middles in their worst direction, shape (K,)."""
        return np.asarray(np.sqrt(np.linalg.eigvalsh(self.covariances)[:, -1]))


def scan_circles(scan: LidarScan, position_m: NDArray[np.float64], heading_rad: float) -> SeenCircles:
    """Find round objects.

    Args:
        scan: what was measured.
        position_m: of the sensor, shape (2,), scene ENU.
        heading_rad: of the vehicle's nose, counter-clockwise from east.
    """
    turned = -1 if scan.step_rad < 0 else 1
    step = abs(scan.step_rad)
    middles = heading_rad + (scan.first_rad + scan.step_rad * np.arange(len(scan.ranges_m)))[::turned]
    ranges = np.where(scan.measured, scan.ranges_m, math.nan)[::turned]
    once_round = len(ranges) * step > 2 * math.pi - step / 2
    found = []
    for group, beside in _groups(np.where(ranges > scan.most_m, math.inf, ranges), once_round):
        if len(group) * step > WIDEST_RAD:
            continue
        row = _circle_of(middles[group[0]], beside, step)
        if row[0] < 0:  # perhaps several
            jumps = np.flatnonzero(np.abs(np.diff(beside[1:-1])) > SMALL_GAP_M) + 1
            ends = zip([0, *jumps], [*jumps, len(group)], strict=True)
            found += [_circle_of(middles[group[a]], beside[a : b + 2], step) for a, b in ends if len(jumps)]
        found.append(row)
    rows = np.array([row for row in found if row[0] >= 0]).reshape(-1, 7)
    covariances = np.empty((len(rows), 2, 2))
    covariances[:, 0, 0], covariances[:, 1, 1] = rows[:, 4], rows[:, 5]
    covariances[:, 0, 1] = covariances[:, 1, 0] = rows[:, 6]
    discs = rows[:, 1:4] + np.array([*position_m, 0.0])
    return SeenCircles(discs, REPEATED * covariances + LEAST_ERROR_M**2 * np.eye(2))


def _circle_of(first_rad: float, ranges: NDArray[np.float64], step: float) -> NDArray[np.float64]:
    """`_circle` of sectors from a bearing on, with one more range on either side.

    What shows in one sector alone, and goes on behind something nearer, may as well be the end of a wall.
    """
    if len(ranges) == 3 and min(ranges[0], ranges[2]) < ranges[1]:
        return np.full(7, -1.0)
    return _circle(first_rad + step * np.arange(-1.0, len(ranges) - 1), ranges, step)


def _groups(ranges: NDArray[np.float64], once_round: bool) -> list[tuple[NDArray[np.int64], NDArray[np.float64]]]:
    """Sectors side by side with ranges near each other, and these ranges with that of the sector on either side."""
    count = len(ranges)
    following = np.roll(ranges, -1)
    linked = np.isfinite(ranges) & np.isfinite(following)
    linked[linked] = np.abs(following[linked] - ranges[linked]) < GAP_M
    if not once_round:
        linked[-1] = False
    if linked.all():
        return []
    first = int((~linked).argmax()) + 1
    order = (np.arange(count) + first) % count
    groups = []
    for group in np.split(order, np.flatnonzero(~linked[order][:-1]) + 1):
        if not np.isfinite(ranges[group[0]]):
            continue
        before, behind = (group[0] - 1) % count, (group[-1] + 1) % count
        sides = [ranges[before], ranges[behind]]
        if not once_round:
            sides = [sides[0] if group[0] > 0 else math.nan, sides[1] if group[-1] < count - 1 else math.nan]
        groups.append((group, np.concatenate([[sides[0]], ranges[group], [sides[1]]])))
    return groups


@compiled
def _circle(bearings: Floats, ranges: Floats, step: float) -> Floats:
    """The mean circle of one object.

    Args:
        bearings: middles of its sectors and of one more on either side, rising, shape (n + 2,).
        ranges: least range in each; infinite where free, not a number where unknown.
        step: width of a sector.

    Returns:
        -1 when nothing fits, or 0; x, y from the sensor and radius; variance of x, of y, covariance. Shape (7,).
    """
    n = len(ranges)
    sums = np.zeros(8)
    best = np.inf
    for trial in range(2):  # first the best cost, then weights relative to it
        for b in range(BEARINGS):
            share = (b + 0.5) / BEARINGS
            middle = bearings[1] - step / 2 + share * (n - 2) * step
            inside = 1 + min(int(share * (n - 2)), n - 3)
            for radius in RADII_M:
                away = ranges[inside] + radius
                cost = 0.0
                for k in range(n):
                    cost += _cost(k, n, middle - bearings[k], away, radius, ranges[k], step)
                if trial == 0:
                    best = min(best, cost)
                    continue
                weight = math.exp(-0.5 * (cost - best))
                x, y = away * math.cos(middle), away * math.sin(middle)
                sums += weight * np.array([1.0, x, y, radius, x * x, y * y, x * y, 0.0])
        if best > FITS * (n - 2):
            break
    result = np.full(7, -1.0)
    if sums[0] > 0.0:
        mean = sums / sums[0]
        result[0] = 0.0
        result[1], result[2], result[3] = mean[1], mean[2], mean[3]
        result[4], result[5] = max(mean[4] - mean[1] ** 2, 0.0), max(mean[5] - mean[2] ** 2, 0.0)
        result[6] = mean[6] - mean[1] * mean[2]
    return result


@compiled
def _cost(k: int, n: int, off: float, away: float, radius: float, measured: float, step: float) -> float:
    """How little a circle agrees with one sector, as a square of deviations."""
    if math.isnan(measured):
        return 0.0
    turn = max(abs(off) - step / 2, 0.0)
    deep = radius - away * math.sin(min(turn, 0.5 * math.pi))
    expected = MISS
    if deep > 0.0:
        expected = away * math.cos(turn) - math.sqrt(radius**2 - (radius - deep) ** 2)
    if 0 < k < n - 1:
        if expected == MISS:
            return min((max(-deep, 0.0) / RANGE_ERROR_M) ** 2 + 4.0, WORST)
        return min(((expected - measured) / RANGE_ERROR_M) ** 2, WORST)
    if expected == MISS or measured < expected - BEHIND_M:
        return 0.0  # it is not there, or hidden by what is nearer
    return min((deep / GRAZED_M) ** 2, WORST)
