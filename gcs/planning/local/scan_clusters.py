"""Objects in a lidar scan: beams side by side that end near each other, as discs."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from gcs.planning.local.lidar_scan import LidarScan

GAP_M = 0.6
"""Ends of neighbouring beams further apart than this belong to two objects ..."""

GAP_BEAMS = 3.0
"""... unless they are less than so many beams' spacing apart at their range."""

LARGEST_M = 4.0
"""What reaches further is a wall or the like: it is on the map and does not move."""

FEWEST_ON_CIRCLE = 6
"""Fewer ends than this do not show that something is round ..."""

ROUND_SHARE = 0.05
"""... nor do ends that lie off the circle, root mean square, by more than this share of its radius."""


def scan_discs(scan: LidarScan, position_m: NDArray[np.float64], heading_rad: float) -> NDArray[np.float64]:
    """Discs that hold the ends of the beams of each object.

    What looks round gets the circle through its ends, and so its far side too. Any other disc stands on the two ends
    furthest apart.

    Args:
        scan: what was measured.
        position_m: of the sensor, shape (2,), scene ENU.
        heading_rad: of the vehicle's nose, counter-clockwise from east.

    Returns:
        Rows of x, y and radius, shape (K, 3), m.
    """
    ends, hits = scan.rays(position_m, heading_rad)
    beams = np.flatnonzero(scan.measured)[hits]
    ends = ends[hits]
    if not len(ends):
        return np.empty((0, 3))
    spacing = np.linalg.norm(ends - position_m, axis=1) * abs(scan.step_rad)
    reach = np.maximum(GAP_M, GAP_BEAMS * spacing)
    following = np.roll(ends, -1, axis=0)
    once_round = round(2 * math.pi / abs(scan.step_rad))
    beside = np.mod(np.roll(beams, -1) - beams, once_round) <= GAP_BEAMS
    linked = beside & (np.linalg.norm(following - ends, axis=1) < reach)
    first = 0 if linked.all() else int(linked.argmin()) + 1  # an object may lie across the last beam and the first
    ends, linked = np.roll(ends, -first, axis=0), np.roll(linked, -first)
    groups = np.split(ends, np.flatnonzero(~linked[:-1]) + 1)
    discs = np.array([_disc(group) for group in groups])
    return discs[discs[:, 2] <= LARGEST_M]


def _disc(points: NDArray[np.float64]) -> tuple[float, float, float]:
    fitted = _fitted_circle(points)
    if fitted is not None:
        return fitted
    apart = np.linalg.norm(points[:, None] - points, axis=2)
    one, other = np.unravel_index(int(apart.argmax()), apart.shape)
    middle = (points[one] + points[other]) / 2
    return float(middle[0]), float(middle[1]), float(np.linalg.norm(points - middle, axis=1).max())


def _fitted_circle(points: NDArray[np.float64]) -> tuple[float, float, float] | None:
    """The circle of least algebraic error (Kasa 1976), where the points lie on it well enough."""
    if len(points) < FEWEST_ON_CIRCLE:
        return None
    about = points.mean(axis=0)
    off = points - about
    system = np.column_stack([2 * off, np.ones(len(off))])
    (x, y, rest), *_ = np.linalg.lstsq(system, (off**2).sum(axis=1), rcond=None)
    radius = float(np.sqrt(max(rest + x * x + y * y, 0.0)))
    error = np.abs(np.hypot(off[:, 0] - x, off[:, 1] - y) - radius)
    if radius > LARGEST_M or float(np.sqrt((error**2).mean())) > ROUND_SHARE * radius:
        return None
    return float(about[0] + x), float(about[1] + y), radius + float(error.max())
