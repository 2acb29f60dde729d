"""Safety rule 7: what the vehicle does by itself is clear of the scene from every point of the trajectory.

Whatever it does, it brakes first, along its velocity. A return then climbs straight up (`ReturnFlight` says how high,
or it stays where it is when it is higher), flies straight home, and comes down over home. Landing where it is means
straight down, a hold means staying. All of these are lines, traced exactly; what happens between two samples of the
curve is covered by keeping `MARGIN_M` besides.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.progress import SilentProgress
from gcs.core.way_home import ReturnFlight
from gcs.planning.scene.fence import fence_volume, room_in_fence
from gcs.planning.scene.free_length import free_lengths

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike, NDArray

    from gcs.core.fields import Point3
    from gcs.core.plan import Plan
    from gcs.core.progress import Progress
    from gcs.core.trajectory import PiecewisePolynomial
    from gcs.planning.scene.fence import FenceVolume
    from gcs.planning.scene.point_distance import SceneDistance

Intervals = tuple[tuple[float, float], ...]

SPACING_M = 0.2
"""Largest distance along the curve between two samples."""

MARGIN_M = 0.25
"""Kept besides: where the vehicle comes to rest moves by at most 2.5 times as much as where it begins to brake."""

BRAKING_SHARE = 0.8
"""Share of the plan's acceleration limit that braking is counted with."""

ALTITUDE_STEP_M = 1.0
"""Step of the search for the lowest safe return altitude."""

LANDING_PLACE_M = 2.0
"""About home the ground is where it lands anyway: braking may end on it there."""

_CLOSE_M = 0.01
_PROBE_M = 1e6
_CHUNK = 256


@dataclass(frozen=True)
class WaysHome:
    """Whether the vehicle's own ways home are clear.

    Attributes:
        ok: whether the asked return is clear from every point; False when none was asked.
        reason: what is in its way, in one line; empty when nothing is.
        blocked_s: intervals of plan time (from, to) from which the return would come too near to something.
        lowest_safe_m: lowest tried return altitude over home with which a return is clear from every point; None when
            there is none, because some climb is blocked.
        landing_blocked_s: intervals of plan time from which a landing on the spot would come too near to something.
        hold_blocked_s: the same for braking to a hold.
        clearest_m: lowest tried return altitude over home that is safe from wherever one above the whole scene is;
            `lowest_safe_m` where there is such; None when home itself is under something.
        never_clear_s: intervals of plan time from which the return is blocked at `clearest_m` too.
    """

    ok: bool
    reason: str
    blocked_s: Intervals
    lowest_safe_m: float | None
    landing_blocked_s: Intervals
    hold_blocked_s: Intervals = ()
    clearest_m: float | None = None
    never_clear_s: Intervals = ()


def check_ways_home(
    plan: Plan,
    distance: SceneDistance,
    flight: ReturnFlight | None,
    progress: Progress | None = None,
    *,
    rally_m: Sequence[Point3] = (),
) -> WaysHome:
    """Check the vehicle's return, landing and hold from every point of a plan.

    Hull and surfaces keep the errors of position and model apart: what is judged is flown by the vehicle alone.

    Args:
        plan: for its trajectory, home, hull radius and errors.
        distance: exact distance to the scene; the ground is not asked, returns end on it.
        flight: how the vehicle's own return flies; None when it is not known.
        progress: reports the stage `ways_home`.
        rally_m: places that it also returns to, if one is nearer than home.

    Raises:
        OperationCancelled: the progress said so.
    """
    return trace_ways_home(
        plan.trajectory,
        distance,
        np.asarray(plan.scenario.home_m, dtype=np.float64),
        flight,
        keep_m(plan),
        progress or SilentProgress(),
        deceleration_m_s2=BRAKING_SHARE * plan.scenario.vehicle.max_acceleration_m_s2,
        rally_m=rally_m,
        fence=_polygons(plan),
    )


def _polygons(plan: Plan) -> FenceVolume | None:
    """The fence that a return must not cross; how high it may go is the vehicle's own affair."""
    scenario = plan.scenario
    if scenario.fence is None:
        return None
    fence = fence_volume(scenario.fence, scenario.vehicle, scenario.safety)
    return fence._replace(max_height_m=math.inf, margin_m=scenario.vehicle.radius_m + scenario.safety.position_m)


def keep_m(plan: Plan) -> float:
    """What the vehicle's centre keeps from surfaces on its own ways: hull, and the errors of position and model."""
    safety = plan.scenario.safety
    return plan.scenario.vehicle.radius_m + safety.position_m + safety.model_m


def trace_ways_home(
    trajectory: PiecewisePolynomial,
    distance: SceneDistance,
    home_m: NDArray[np.float64],
    flight: ReturnFlight | None,
    keep_m: float,
    progress: Progress,
    *,
    deceleration_m_s2: float = math.inf,
    rally_m: Sequence[Point3] = (),
    fence: FenceVolume | None = None,
) -> WaysHome:
    """`check_ways_home` for a trajectory.

    Args:
        trajectory: the curve.
        distance: exact distance to the scene.
        home_m: where it returns to, on the ground, shape (3,).
        flight: how it returns; None when it is not known.
        keep_m: distance that the vehicle's centre keeps on the way; less than the curve itself keeps by at least
            `MARGIN_M`, or the curve's nearest points count as blocked.
        progress: reports the stage `ways_home`.
        deceleration_m_s2: how hard it brakes first.
        rally_m: places that it also returns to.
        fence: what to stay in on the way.
    """
    times = _sample_times(trajectory)
    velocity = trajectory.value(times, 1)
    scene = _Scene(distance, fence, keep_m + MARGIN_M)
    places = np.array([home_m, *rally_m], dtype=np.float64)
    returns = _Returns(trajectory.value(times), velocity, scene, places, deceleration_m_s2)
    progress.report("ways_home", 0.1)

    def intervals(flags: NDArray[np.bool_]) -> Intervals:
        return _intervals(times, flags)

    profile = flight or ReturnFlight(0.0)
    lowest, clearest, never = _best_altitude(returns, profile, progress)
    landing, hold = intervals(returns.landing_blocked()), intervals(returns.hold_blocked)
    rest = (lowest, landing, hold, clearest, intervals(never))
    if flight is None:
        return WaysHome(False, "the return altitude is not known", (), *rest)
    blocked = returns.blocked(flight)
    progress.report("ways_home", 1.0)
    reason = ""
    if blocked.any():
        x, y, z = returns.points[np.argmax(blocked)]
        reason = (
            f"from {blocked.mean():.0%} of the path, first from ({x:.1f}, {y:.1f}, {z:.1f}) m, the way up, home or "
            f"down over home comes nearer than {keep_m:.1f} m to the structure"
        )
    return WaysHome(not blocked.any(), reason, intervals(blocked), *rest)


def return_is_clear(
    plan: Plan, distance: SceneDistance, flight: ReturnFlight, position_m: ArrayLike, velocity_m_s: ArrayLike
) -> bool:
    """Whether the vehicle's own return is clear from where it is now, wherever that is.

    Args:
        plan: for home, hull radius, errors and the acceleration limit.
        distance: exact distance to the scene.
        flight: how it returns.
        position_m: scene ENU, shape (3,).
        velocity_m_s: shape (3,).
    """
    home = np.asarray(plan.scenario.home_m, dtype=np.float64)
    braking = BRAKING_SHARE * plan.scenario.vehicle.max_acceleration_m_s2
    point = np.asarray(position_m, dtype=np.float64).reshape(1, 3)
    moving = np.asarray(velocity_m_s, dtype=np.float64).reshape(1, 3)
    scene = _Scene(distance, _polygons(plan), keep_m(plan) + MARGIN_M)
    returns = _Returns(point, moving, scene, home[None], braking)
    return not returns.blocked(flight)[0]


def _best_altitude(
    returns: _Returns, flight: ReturnFlight, progress: Progress
) -> tuple[float | None, float | None, NDArray[np.bool_]]:
    """Lowest altitude that is safe from everywhere, and the one that is from wherever a high one is, and not there."""
    everywhere = np.arange(len(returns.points))
    lowest = returns.lowest_safe(flight, everywhere, progress)
    if lowest is not None:
        return lowest, lowest, np.zeros(len(everywhere), dtype=np.bool_)
    above_all = replace(flight, altitude_m=returns.open_m - returns.home_m[2])
    hopeless = returns.blocked(above_all)
    if hopeless.all():
        return None, None, hopeless
    clearest = returns.lowest_safe(flight, everywhere[~hopeless], progress)
    if clearest is None:
        return None, None, hopeless
    return None, clearest, returns.blocked(replace(flight, altitude_m=clearest))


@dataclass(frozen=True, eq=False)
class _Scene:
    """What the vehicle's own ways must keep clear of, and by how much."""

    distance: SceneDistance
    fence: FenceVolume | None
    keep_m: float

    def room(self, points: NDArray[np.float64], ground: bool | NDArray[np.bool_]) -> NDArray[np.float64]:
        """Distance to the scene, and room to the fence as if it were one."""
        distance = self.distance.distance(points, ground=ground)
        if self.fence is None:
            return distance
        return np.minimum(distance, room_in_fence(points, self.fence) + self.keep_m)


class _Returns:
    """Samples of a trajectory (`points`, shape (N, 3)) and the lines that lead home from where it then stands still.

    `places` are home and the rally points, shape (P, 3); it returns to the nearest.
    """

    def __init__(
        self,
        points: NDArray[np.float64],
        velocity: NDArray[np.float64],
        scene: _Scene,
        places: NDArray[np.float64],
        deceleration_m_s2: float,
    ) -> None:
        distance = scene.distance
        self._scene = scene
        self._places = places
        self.home_m = home_m = places[0]
        self.points = points
        self._keep = scene.keep_m
        speed = np.linalg.norm(velocity, axis=1)
        heading = velocity / np.maximum(speed, 1e-9)[:, None]
        way = speed**2 / (2 * deceleration_m_s2)
        self._rests = points + way[:, None] * heading
        moving = way > _CLOSE_M
        self.hold_blocked = np.zeros(len(points), dtype=np.bool_)
        braking = self._trace(points[moving], heading[moving], way[moving], ground=True)
        self.hold_blocked[moving] = braking < way[moving]

        top = _PROBE_M - float(distance.distance(np.array([[home_m[0], home_m[1], _PROBE_M]]), ground=False)[0])
        # From this height nothing is in the way of a level flight (the probe sees the top from afar, not from above).
        extent = float(np.linalg.norm(self._rests - home_m, axis=1).max())
        self.open_m = max(top, float(self._rests[:, 2].max())) + self._keep + 10 * _CLOSE_M + extent**2 / _PROBE_M
        up = np.broadcast_to([0.0, 0.0, 1.0], self._rests.shape)
        wanted = self.open_m - self._rests[:, 2]
        free = self._trace(self._rests, up, wanted)
        self._climb_m = np.where(free >= wanted, math.inf, free)

    def _trace(
        self,
        origins: NDArray[np.float64],
        directions: NDArray[np.float64],
        wanted: NDArray[np.float64],
        *,
        ground: bool = False,
    ) -> NDArray[np.float64]:
        keep = np.full(len(origins), self._keep)

        def room(points: NDArray[np.float64]) -> NDArray[np.float64]:
            if not ground:
                return self._scene.room(points, ground=False)
            aside = np.hypot(*(points - self.home_m)[:, :2].T)
            return self._scene.room(points, ground=aside > LANDING_PLACE_M)

        return free_lengths(origins, directions, wanted, keep, room, _CLOSE_M)

    def blocked(self, flight: ReturnFlight, chosen: NDArray[np.intp] | None = None) -> NDArray[np.bool_]:
        """Which of the (chosen) samples have no clear return."""
        index = np.arange(len(self._rests)) if chosen is None else chosen
        rests = self._rests[index]
        ways = self._places[None, :, :2] - rests[:, None, :2]
        lengths = np.linalg.norm(ways, axis=2)
        goal = lengths.argmin(axis=1)
        way, length = ways[np.arange(len(rests)), goal], lengths[np.arange(len(rests)), goal]
        level = self.home_m[2] + flight.level_m(rests[:, 2] - self.home_m[2], length)
        bad: NDArray[np.bool_] = self.hold_blocked[index] | (self._climb_m[index] < level - rests[:, 2])
        direction = np.column_stack([way / np.maximum(length, 1e-9)[:, None], np.zeros(len(rests))])
        bad = bad | (self._trace(np.column_stack([rests[:, :2], level]), direction, length) < length)
        down = np.array([[0.0, 0.0, -1.0]])
        for k in np.unique(goal):
            place, those = self._places[k], goal == k
            drop = np.array([level[those].max() - place[2]])
            over = np.array([[place[0], place[1], level[those].max()]])
            if self._trace(over, down, drop)[0] < drop[0]:
                bad[those] = True
        return bad

    def lowest_safe(self, flight: ReturnFlight, chosen: NDArray[np.intp], progress: Progress) -> float | None:
        """Lowest return altitude over home, in steps, with which every chosen sample's return is clear."""
        highest = self.open_m - self.home_m[2]
        altitude = math.ceil(self._keep / ALTITUDE_STEP_M) * ALTITUDE_STEP_M
        order = chosen
        while True:
            progress.report("ways_home", 0.1 + 0.8 * min(altitude / highest, 1.0))
            failed = self._first_failure(replace(flight, altitude_m=altitude), order)
            if failed is None:
                return altitude
            if altitude > highest:
                return None
            # What failed last is likely to fail again: it is asked first.
            order = np.concatenate([[failed], order[order != failed]])
            altitude += ALTITUDE_STEP_M

    def _first_failure(self, flight: ReturnFlight, order: NDArray[np.intp]) -> int | None:
        bounds = [0, 1, *range(_CHUNK, len(order), _CHUNK), len(order)]
        for first, last in itertools.pairwise(bounds):
            chosen = order[first:last]
            bad = self.blocked(flight, chosen) if len(chosen) else np.zeros(0, dtype=np.bool_)
            if bad.any():
                return int(chosen[np.argmax(bad)])
        return None

    def landing_blocked(self) -> NDArray[np.bool_]:
        """Which samples have something between them and the ground."""
        told = self._scene.distance.ground_m
        ground = self.home_m[2] if told is None else told
        drop = np.maximum(self._rests[:, 2] - ground, 0.0)
        down = np.broadcast_to([0.0, 0.0, -1.0], self._rests.shape)
        return np.asarray(self.hold_blocked | (self._trace(self._rests, down, drop) < drop))


def _intervals(times: NDArray[np.float64], flags: NDArray[np.bool_]) -> Intervals:
    """Intervals of plan time over which samples are flagged."""
    edges = np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8))
    starts, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1
    return tuple((float(times[a]), float(times[b])) for a, b in zip(starts, ends, strict=True))


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
