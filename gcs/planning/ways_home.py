"""Safety rule 7: the vehicle's own return is clear of the scene from every point of the trajectory.

A return climbs straight up to the return altitude over home (or stays where it is when it is higher), flies straight
home, and comes down over home. Landing where it is means straight down. All three are lines, traced exactly; points of
the curve between the samples differ from them by half their spacing at most, which is kept besides.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.progress import SilentProgress
from gcs.planning.free_length import free_lengths

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from gcs.core.plan import Plan
    from gcs.core.progress import Progress
    from gcs.core.trajectory import PiecewisePolynomial
    from gcs.planning.point_distance import SceneDistance

SPACING_M = 0.5
"""Largest distance along the curve between two samples."""

ALTITUDE_STEP_M = 1.0
"""Step of the search for the lowest safe return altitude."""

_CLOSE_M = 0.01
_PROBE_M = 1e6
_CHUNK = 256


@dataclass(frozen=True)
class WaysHome:
    """Whether the vehicle's own ways home are clear.

    Attributes:
        ok: whether a return at the asked altitude is clear from every point; False when no altitude was asked.
        reason: what is in the way, in one line; empty when nothing is.
        blocked_s: intervals of plan time (from, to) from which a return would come too near to something.
        lowest_safe_m: lowest tried return altitude over home with which a return is clear from every point; None when
            there is none, because some climb is blocked.
        landing_blocked_s: intervals of plan time from which a landing on the spot would come too near to something.
    """

    ok: bool
    reason: str
    blocked_s: tuple[tuple[float, float], ...]
    lowest_safe_m: float | None
    landing_blocked_s: tuple[tuple[float, float], ...]


def check_ways_home(
    plan: Plan, distance: SceneDistance, return_altitude_m: float | None, progress: Progress | None = None
) -> WaysHome:
    """Check the vehicle's return and landing from every point of a plan.

    Hull and surfaces keep the errors of position and model apart: the return is flown by the vehicle alone.

    Args:
        plan: for its trajectory, home, hull radius and errors.
        distance: exact distance to the scene; the ground is not asked, returns end on it.
        return_altitude_m: the vehicle's own, over home; None when it is not known.
        progress: reports the stage `ways_home`.

    Raises:
        OperationCancelled: the progress said so.
    """
    safety = plan.scenario.safety
    keep = plan.scenario.vehicle.radius_m + safety.position_m + safety.model_m
    home = np.asarray(plan.scenario.home_m, dtype=np.float64)
    return trace_ways_home(plan.trajectory, distance, home, return_altitude_m, keep, progress or SilentProgress())


def trace_ways_home(
    trajectory: PiecewisePolynomial,
    distance: SceneDistance,
    home_m: NDArray[np.float64],
    return_altitude_m: float | None,
    keep_m: float,
    progress: Progress,
) -> WaysHome:
    """`check_ways_home` for a trajectory.

    Args:
        trajectory: the curve.
        distance: exact distance to the scene.
        home_m: where it returns to, on the ground, shape (3,).
        return_altitude_m: over home; None when it is not known.
        keep_m: distance that the vehicle's centre keeps on the way; less than the curve itself keeps by at least
            `SPACING_M / 2`, or the curve's nearest points count as blocked.
        progress: reports the stage `ways_home`.
    """
    returns = _Returns(trajectory, distance, home_m, keep_m)
    progress.report("ways_home", 0.1)
    lowest = returns.lowest_safe(progress)
    landing = returns.intervals(returns.landing_blocked())
    if return_altitude_m is None:
        return WaysHome(False, "the return altitude is not known", (), lowest, landing)
    blocked = returns.blocked(return_altitude_m)
    progress.report("ways_home", 1.0)
    reason = ""
    if blocked.any():
        x, y, z = returns.points[np.argmax(blocked)]
        reason = (
            f"from {blocked.mean():.0%} of the path, first from ({x:.1f}, {y:.1f}, {z:.1f}) m, the way up, home or "
            f"down over home comes nearer than {keep_m:.1f} m to the structure"
        )
    return WaysHome(not blocked.any(), reason, returns.intervals(blocked), lowest, landing)


class _Returns:
    """Samples of a trajectory (`points`, shape (N, 3)) and the lines that lead home from them."""

    def __init__(
        self, trajectory: PiecewisePolynomial, distance: SceneDistance, home_m: NDArray[np.float64], keep_m: float
    ) -> None:
        self._distance = distance
        self._home = home_m
        self._times = _sample_times(trajectory)
        self.points = trajectory.value(self._times)
        self._keep = keep_m + SPACING_M / 2
        top = _PROBE_M - float(distance.distance(np.array([[home_m[0], home_m[1], _PROBE_M]]), ground=False)[0])
        # From this height nothing is in the way of a level flight (the probe sees the top from afar, not from above).
        extent = float(np.linalg.norm(self.points - home_m, axis=1).max())
        self._open_m = max(top, float(self.points[:, 2].max())) + self._keep + 10 * _CLOSE_M + extent**2 / _PROBE_M
        up = np.broadcast_to([0.0, 0.0, 1.0], self.points.shape)
        wanted = self._open_m - self.points[:, 2]
        free = self._trace(self.points, up, wanted)
        self._climb_m = np.where(free >= wanted, math.inf, free)

    def _trace(
        self, origins: NDArray[np.float64], directions: NDArray[np.float64], wanted: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        keep = np.full(len(origins), self._keep)
        return free_lengths(
            origins, directions, wanted, keep, lambda p: self._distance.distance(p, ground=False), _CLOSE_M
        )

    def blocked(self, altitude_m: float, chosen: NDArray[np.intp] | None = None) -> NDArray[np.bool_]:
        """Which of the (chosen) samples have no clear return with an altitude over home."""
        index = np.arange(len(self.points)) if chosen is None else chosen
        points = self.points[index]
        level = np.maximum(points[:, 2], self._home[2] + altitude_m)
        bad: NDArray[np.bool_] = self._climb_m[index] < level - points[:, 2]
        way = self._home[:2] - points[:, :2]
        length = np.linalg.norm(way, axis=1)
        direction = np.column_stack([way / np.maximum(length, 1e-9)[:, None], np.zeros(len(points))])
        bad = bad | (self._trace(np.column_stack([points[:, :2], level]), direction, length) < length)
        down = np.array([[0.0, 0.0, -1.0]])
        drop = np.array([level.max() - self._home[2]])
        over_home = np.array([[self._home[0], self._home[1], level.max()]])
        if self._trace(over_home, down, drop)[0] < drop[0]:
            bad[:] = True
        return bad

    def lowest_safe(self, progress: Progress) -> float | None:
        """Lowest return altitude over home, in steps, with which every sample's return is clear."""
        highest = self._open_m - self._home[2]
        altitude = math.ceil(self._keep / ALTITUDE_STEP_M) * ALTITUDE_STEP_M
        order = np.arange(len(self.points))
        while True:
            progress.report("ways_home", 0.3 + 0.6 * min(altitude / highest, 1.0))
            failed = self._first_failure(altitude, order)
            if failed is None:
                return altitude
            if altitude > highest:
                return None
            # What failed last is likely to fail again: it is asked first.
            order = np.concatenate([[failed], order[order != failed]])
            altitude += ALTITUDE_STEP_M

    def _first_failure(self, altitude_m: float, order: NDArray[np.intp]) -> int | None:
        bounds = [0, 1, *range(_CHUNK, len(order), _CHUNK), len(order)]
        for first, last in itertools.pairwise(bounds):
            chosen = order[first:last]
            bad = self.blocked(altitude_m, chosen) if len(chosen) else np.zeros(0, dtype=np.bool_)
            if bad.any():
                return int(chosen[np.argmax(bad)])
        return None

    def landing_blocked(self) -> NDArray[np.bool_]:
        """Which samples have something between them and the ground."""
        ground = self._home[2] if self._distance.ground_m is None else self._distance.ground_m
        drop = self.points[:, 2] - ground
        down = np.broadcast_to([0.0, 0.0, -1.0], self.points.shape)
        return np.asarray(self._trace(self.points, down, drop) < drop)

    def intervals(self, flags: NDArray[np.bool_]) -> tuple[tuple[float, float], ...]:
        """Intervals of plan time over which samples are flagged."""
        edges = np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8))
        starts, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1
        return tuple((float(self._times[a]), float(self._times[b])) for a, b in zip(starts, ends, strict=True))


def _sample_times(trajectory: PiecewisePolynomial) -> NDArray[np.float64]:
    """Times between which the curve is no longer than `SPACING_M`, ends included."""
    count = max(2, math.ceil(trajectory.duration_s / 0.01))
    grid = np.linspace(0.0, trajectory.duration_s, count + 1)
    # A tenth more than the chords, and the spacing less one step, make up for what lies between the grid's times.
    steps = 1.1 * np.linalg.norm(np.diff(trajectory.value(grid), axis=0), axis=1)
    way = np.concatenate([[0.0], np.cumsum(steps)])
    spacing = max(SPACING_M - float(steps.max(initial=0.0)), SPACING_M / 5)
    chosen = np.searchsorted(way, np.arange(0.0, way[-1], spacing))
    return np.asarray(grid[np.unique(np.concatenate([chosen, [count]]))], dtype=np.float64)
