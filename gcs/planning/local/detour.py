"""A detour: the local path that leaves the planned trajectory before an obstacle and joins it again behind it.

The shortest way on the map between the two places (`tangent_path`) gives the corners of a minimum-snap curve with the
trajectory's own velocity, acceleration and jerk at both ends. Slower and slower curves are tried, with more points on
the way where one cuts into an obstacle, until the limits hold on the true extrema and the whole curve is proved free.
A slow one joins a trajectory that is itself flown slower, until it next stands still: as all its times are stretched
alike, that joins as smoothly. Both the search and the curves are bounded by a budget; when nothing holds within it,
that is said, and the vehicle must stop.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.errors import InfeasibleError, InputError
from gcs.core.trajectory import PiecewisePolynomial
from gcs.planning.local.binary_map import BinaryMap
from gcs.planning.local.curve_checks import heights_in_slab, within_limits
from gcs.planning.local.curve_clearance import CellCounts
from gcs.planning.local.curve_parts import joined_curves, motion_at, part_of_curve
from gcs.planning.local.detour_times import profile_times
from gcs.planning.local.map_ways import REFINEMENTS, at_heights, way_on_map, with_middles
from gcs.planning.local.search_budget import SearchBudget
from gcs.planning.trajectories.unconstrained_minimum_snap import minimum_snap_spline

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from gcs.planning.local.known_room import KnownRoom
    from gcs.planning.trajectories.flight_limits import FlightLimits

WINDOW_S = 0.2
"""The trajectory is held against the map in parts of this length."""

CLEAR_S = 0.6
"""It is joined again where it stays free for so long at least, or to its end."""

REJOINS = (0.0, 1.0, 2.5, 4.5, 8.0)
"""How long (s) after it has come free the trajectory is joined again, tried in this order."""

PACES = {1.0: (0.9, 0.65, 0.45, 0.3), 0.75: (0.75, 0.5), 0.5: (0.5, 0.3)}
"""Shares of its own pace at which the trajectory is flown on, and shares of the speed limit that are tried before each.

A slower trajectory stays slow until it next stands still; at a lower pace than these, stopping and going on is better.
"""

STILL_M_S = 1e-6
"""What is slower stands still."""

NEAREST_M = 1e-3
"""No piece joins the trajectory nearer to where it begins."""

SHARE_OF_ACCELERATION = 0.5
"""What the speed profile may use of the acceleration limit: snap is finite, and corners need the rest."""


@dataclass(frozen=True)
class DetourOptions:
    """What a detour may be like.

    Attributes:
        react_s: it leaves the trajectory no earlier after now.
        look_ahead_s: how far the trajectory is looked along.
        margins_m: the way's corners keep these distances from the grown map, tried in this order.
        slab_m: least and greatest height of what the lidar scans, which no piece leaves; None for no bounds.
        known: what the known structure forbids at other heights than the map's; None for nothing.
    """

    react_s: float = 0.3
    look_ahead_s: float = 30.0
    margins_m: tuple[float, ...] = (0.4, 0.1)
    slab_m: tuple[float, float] | None = None
    known: KnownRoom | None = None

    def bad_pieces(self, curve: PiecewisePolynomial, wall: CellCounts) -> NDArray[np.bool_]:
        """Which pieces of a curve are not proved to be free on a map, or at heights where they must not be."""
        bad = wall.blocked_pieces(curve) | ~heights_in_slab(curve, self.slab_m)
        return bad if self.known is None or bad.any() else self.known.forbids(curve)


@dataclass(frozen=True, eq=False)
class Detour:
    """A piece that takes the place of a part of the trajectory.

    Attributes:
        leave_s: time on the trajectory at which it leaves it (S_l).
        rejoin_s: time on the trajectory at which it joins it again (E_l).
        curve: from there to there; it starts at its own time 0.
        pace: how quick the trajectory is flown from `rejoin_s` to `own_pace_s`, as a share of its own pace.
        own_pace_s: time on the trajectory at which it stands still and goes on at its own pace.
        path_m: the way on the map whose corners it rounds, shape (K, 2), scene ENU.
    """

    leave_s: float
    rejoin_s: float
    curve: PiecewisePolynomial
    pace: float
    own_pace_s: float
    path_m: NDArray[np.float64]

    @property
    def delay_s(self) -> float:
        """How much later the rest of the trajectory is flown."""
        slowed = (self.own_pace_s - self.rejoin_s) * (1 / self.pace - 1)
        return self.curve.duration_s - (self.rejoin_s - self.leave_s) + slowed

    def skipped(self, stops_s: Sequence[float]) -> list[int]:
        """Which of some times on the trajectory are not flown: those inside the part that is left out."""
        return [k for k, stop in enumerate(stops_s) if self.leave_s < stop < self.rejoin_s]

    def flown(self, trajectory: PiecewisePolynomial) -> PiecewisePolynomial:
        """The whole trajectory with the piece in its place."""
        onward = self.onward(trajectory)
        return joined_curves(part_of_curve(trajectory, 0.0, self.leave_s), onward) if self.leave_s > 0 else onward

    def onward(self, trajectory: PiecewisePolynomial) -> PiecewisePolynomial:
        """The piece and the trajectory behind it."""
        parts = [self.curve]
        if self.rejoin_s < self.own_pace_s:
            slowed = part_of_curve(trajectory, self.rejoin_s, self.own_pace_s)
            parts.append(PiecewisePolynomial(slowed.coefficients, slowed.durations_s / self.pace))
        if self.own_pace_s < trajectory.duration_s:
            parts.append(part_of_curve(trajectory, self.own_pace_s, trajectory.duration_s))
        return joined_curves(*parts)


def plan_detour(
    trajectory: PiecewisePolynomial,
    now_s: float,
    area: BinaryMap,
    limits: FlightLimits,
    options: DetourOptions | None = None,
    stops_s: Sequence[float] = (),
    standing: BinaryMap | None = None,
    budget: SearchBudget | None = None,
) -> Detour | None:
    """Fly round what blocks the trajectory, as soon as may be.

    Args:
        trajectory: what is flown, scene ENU.
        now_s: how far it is flown.
        area: map of the plane, grown by the safe distance and all errors.
        limits: kept on the true extrema of the piece.
        options: what it may be like.
        stops_s: times of the viewpoints. The piece does not leave the trajectory before those that can be reached.
        standing: what the trajectory itself is held against, at all heights, when that is less than `area`.
        budget: what may be spent on it; a whole one when it is not given.

    Returns:
        The piece, or None when nothing blocks the trajectory as far as is looked.

    Raises:
        InputError: `now_s` is not on the trajectory.
        InfeasibleError: no piece holds, or none was found within the budget: hold or back off.
    """
    options = options or DetourOptions()
    if not 0 <= now_s < trajectory.duration_s:
        raise InputError(f"{now_s:g} s is not on a trajectory of {trajectory.duration_s:g} s", field="now_s")
    times, blocked = _blocked_windows(trajectory, now_s, standing or area, options)
    if not blocked.any():
        return None
    trouble_s = float(times[blocked.argmax()])
    earliest = now_s + options.react_s
    if trouble_s <= earliest:
        raise InfeasibleError("the trajectory is blocked before a detour can begin: stop now, then hold or back off")
    leave_s = max([earliest, *[stop for stop in stops_s if earliest < stop <= trouble_s]])
    rejoins_s = _rejoins(times, blocked, int(blocked.argmax()) + 1)
    start = motion_at(trajectory, leave_s)
    return _joining(start, trajectory, leave_s, rejoins_s, area, limits, options, stops_s, budget or SearchBudget())


def plan_return(
    state: NDArray[np.float64],
    trajectory: PiecewisePolynomial,
    from_s: float,
    area: BinaryMap,
    limits: FlightLimits,
    options: DetourOptions | None = None,
    standing: BinaryMap | None = None,
    budget: SearchBudget | None = None,
) -> Detour:
    """Come back to a trajectory from somewhere beside it, behind all that blocks it as far as is looked.

    Args:
        state: position, velocity, acceleration and jerk now, shape (4, 3).
        trajectory: what is to be flown, scene ENU; it rests at its end.
        from_s: time on it before which it is not joined.
        area: map of the plane, grown by the safe distance and all errors.
        limits: kept on the true extrema of the piece.
        options: what the piece may be like.
        standing: what the trajectory itself is held against, at all heights, when that is less than `area`.
        budget: what may be spent on it; a whole one when it is not given.

    Raises:
        InfeasibleError: no piece holds, or none was found within the budget.
    """
    options = options or DetourOptions()
    rejoins_s = [trajectory.duration_s]
    if from_s < trajectory.duration_s:
        times, blocked = _blocked_windows(trajectory, from_s, standing or area, options)
        behind = int(np.flatnonzero(blocked)[-1]) + 1 if blocked.any() else 0
        rejoins_s = _rejoins(times, blocked, behind) or rejoins_s
    return _joining(state, trajectory, from_s, rejoins_s, area, limits, options, (), budget or SearchBudget())


def _joining(
    start: NDArray[np.float64],
    trajectory: PiecewisePolynomial,
    leave_s: float,
    rejoins_s: Sequence[float],
    area: BinaryMap,
    limits: FlightLimits,
    options: DetourOptions,
    stops_s: Sequence[float],
    budget: SearchBudget,
) -> Detour:
    """The first piece that holds from a state (4, 3) to one of some times on the trajectory."""
    wall = CellCounts(area)
    ends = [(rejoin_s, motion_at(trajectory, rejoin_s)) for rejoin_s in rejoins_s]
    ends = [(rejoin_s, end) for rejoin_s, end in ends if np.linalg.norm(end[0] - start[0]) >= NEAREST_M]
    ways = list(_ways(start[0], ends, area, options, budget))
    for (after, paces), (rejoin_s, end, way) in itertools.product(PACES.items(), ways):
        slower = end * after ** np.arange(4)[:, None]
        curve = _free_curve(start, slower, way, paces, wall, limits, options, budget)
        if curve is not None:
            own_pace_s = rejoin_s if after == 1.0 else _next_standstill_s(trajectory, rejoin_s, stops_s)
            return Detour(leave_s, rejoin_s, curve, after, own_pace_s, way)
    raise InfeasibleError("no way round the obstacle holds the limits and the clearance: stop, then hold or back off")


def _next_standstill_s(trajectory: PiecewisePolynomial, after_s: float, stops_s: Sequence[float]) -> float:
    """The first viewpoint from a time on at which the vehicle stands still, or the end."""
    still = [stop for stop in stops_s if stop >= after_s and np.abs(trajectory.value(stop, 1)).max() < STILL_M_S]
    return min([*still, trajectory.duration_s])


def _blocked_windows(
    trajectory: PiecewisePolynomial, now_s: float, standing: BinaryMap, options: DetourOptions
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Borders of short parts of the trajectory ahead (n + 1,), and which of them are not free (n,)."""
    end = min(now_s + options.look_ahead_s, trajectory.duration_s)
    times = np.linspace(now_s, end, max(math.ceil((end - now_s) / WINDOW_S), 1) + 1)
    seen = CellCounts(standing, off_map_blocked=False)
    ahead = part_of_curve(trajectory, now_s, end, times[1:-1])
    window = np.searchsorted(times, now_s + ahead.starts_s[:-1] + ahead.durations_s / 2) - 1
    blocked = seen.blocked_pieces(ahead)
    return times, np.bincount(window, blocked, len(times) - 1) > 0


def _rejoins(times: NDArray[np.float64], blocked: NDArray[np.bool_], first: int) -> list[float]:
    """Times from a window on at which the trajectory may be joined again, in the order in which they are tried."""
    needed = math.ceil(CLEAR_S / WINDOW_S)
    good = [
        float(times[k])
        for k in range(first, len(times))
        if not blocked[max(k - 1, 0)] and not blocked[k : k + needed].any()
    ]
    wanted = [good[0] + after for after in REJOINS] if good else []
    return list(dict.fromkeys(min(good, key=lambda time, aim=aim: abs(time - aim)) for aim in wanted))  # type: ignore[misc]


def _ways(
    start: NDArray[np.float64],
    ends: Sequence[tuple[float, NDArray[np.float64]]],
    area: BinaryMap,
    options: DetourOptions,
    budget: SearchBudget,
) -> Iterator[tuple[float, NDArray[np.float64], NDArray[np.float64]]]:
    """Ways on the map from a place (3,) to each end (4, 3), with its time on the trajectory."""
    for margin_m in options.margins_m:
        for rejoin_s, end in ends:
            if not all(_in_slab(point[2], options) for point in (start, end[0])):
                continue
            way = way_on_map(start[:2], end[0, :2], area, margin_m, budget)
            if way is not None:
                yield rejoin_s, end, way


def _in_slab(height_m: float, options: DetourOptions) -> bool:
    return options.slab_m is None or options.slab_m[0] <= height_m <= options.slab_m[1]


def _free_curve(
    start: NDArray[np.float64],
    end: NDArray[np.float64],
    way_m: NDArray[np.float64],
    paces: Sequence[float],
    wall: CellCounts,
    limits: FlightLimits,
    options: DetourOptions,
    budget: SearchBudget,
) -> PiecewisePolynomial | None:
    """The quickest of some curves along a way that holds the limits and is free, or None.

    Args:
        start: position, velocity, acceleration and jerk there, shape (4, 3).
        end: likewise.
        way_m: shape (K, 2).
        paces: shares of the speed limit, tried in this order.
        wall: the map.
        limits: kept on the true extrema.
        options: for the slab.
        budget: for the curves.
    """
    for pace in paces:
        points = at_heights(way_m, float(start[0, 2]), float(end[0, 2]))
        points[0], points[-1] = start[0], end[0]
        for _ in range(REFINEMENTS + 1):
            if not budget.curves:
                return None
            budget.curves -= 1
            lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
            times = profile_times(
                lengths,
                pace * limits.speed_m_s,
                pace**2 * SHARE_OF_ACCELERATION * limits.acceleration_m_s2,
                float(np.linalg.norm(start[1])),
                float(np.linalg.norm(end[1])),
            )
            curve = minimum_snap_spline(points, times, list(start[1:]), list(end[1:])).piecewise_polynomial()
            if not within_limits(curve, limits):
                break
            bad = options.bad_pieces(curve, wall)
            if not bad.any():
                return curve
            points = with_middles(points, bad)
    return None
