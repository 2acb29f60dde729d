"""What to do about obstacles that stand and obstacles that move: fly on, fly round, hover, or back off.

The first of these that is proved free is taken, in this order: the trajectory as it is, a detour, a little more of the
trajectory and then coming to rest, coming to rest at once, and coming to rest somewhere else. Standing obstacles are
on the map; moving ones are taken off it, predicted, and kept away from in space and time. Where nothing is proved free
of what moves, what keeps away from it the most is done; where nothing keeps the safe distance from what stands, what
keeps nearly as much.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

import numpy as np

from gcs.core.errors import InfeasibleError
from gcs.planning.local.binary_map import BinaryMap
from gcs.planning.local.curve_checks import heights_in_slab
from gcs.planning.local.curve_clearance import CellCounts
from gcs.planning.local.curve_parts import joined_curves, motion_at, part_of_curve
from gcs.planning.local.detour import STILL_M_S, Detour, DetourOptions, plan_detour
from gcs.planning.local.lidar_map import BESIDE_M
from gcs.planning.local.rest_curve import curve_to_rest
from gcs.planning.local.space_time import MovingClearance, first_conflict_s, margins_m

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from gcs.core.trajectory import PiecewisePolynomial
    from gcs.planning.local.moving_tracks import Track
    from gcs.planning.trajectories.flight_limits import FlightLimits

Kind = Literal["fly on", "detour", "hover", "back off"]

BRAKING_SHARES = (1.5, 2.0, 2.5, 3.2)
"""Tried multiples of the distance that the acceleration limit alone needs to stop."""

LEAST_BRAKING_M = 0.3

COMMITTED_S = 0.5
"""So far along the trajectory the vehicle may go on while it can still come to rest from there."""

RETREATS_M = (2.0, 4.0, 7.0)
DIRECTIONS = 12

KEPT_SHARES = (1.0, 0.8, 0.6, 0.4)
"""Shares of the safe distance that a way to rest keeps: one cell more on the map must not leave the vehicle without."""

SWEPT_S = 1.0
"""A detour keeps off where a moving obstacle is this long before and after it would be met."""


@dataclass(frozen=True)
class EvasionOptions:
    """What is kept, and how.

    Attributes:
        safe_m: R, between the vehicle's centre and what stands, errors included.
        moving: what is kept from what moves.
        detour: what detours may be like.
    """

    safe_m: float
    moving: MovingClearance
    detour: DetourOptions = field(default_factory=DetourOptions)


@dataclass(frozen=True, eq=False)
class Evasion:
    """What to do now.

    Attributes:
        kind: which of the four.
        curve: what is flown from now on, on its own time from 0; it rests at its end. Whatever a later call says, it
            stays as good as the predictions were.
        margin_m: how much more than asked it keeps from what moves, at least, up to the horizon; negative when it does
            not keep it, infinity when nothing moves.
        kept_m: what is kept from what stands: R, or less where nothing else was left.
        detour: the piece, for a detour.
    """

    kind: Kind
    curve: PiecewisePolynomial
    margin_m: float
    kept_m: float
    detour: Detour | None = None


def evade(
    trajectory: PiecewisePolynomial,
    now_s: float,
    seen: BinaryMap,
    tracks: Sequence[Track],
    clock_s: float,
    limits: FlightLimits,
    options: EvasionOptions,
    stops_s: Sequence[float] = (),
) -> Evasion:
    """Choose what to do.

    Args:
        trajectory: what is flown, scene ENU.
        now_s: how far it is flown.
        seen: map of the plane as the lidar filled it, not grown; moving obstacles may be on it.
        tracks: of the moving obstacles.
        clock_s: now, on the tracks' clock.
        limits: kept on the true extrema of what is new.
        options: what is kept.
        stops_s: times of the viewpoints on the trajectory.

    Raises:
        InputError: `now_s` is not on the trajectory.
        InfeasibleError: no curve to rest keeps off what stands.
    """
    standing = _without(seen, tracks, clock_s)
    rest = part_of_curve(trajectory, now_s, trajectory.duration_s)
    met_s = first_conflict_s(margins_m(rest, clock_s, tracks, options.moving))
    best: Evasion | None = None
    for area in _maps_to_fly_round(standing, tracks, clock_s, met_s, options):
        try:
            detour = plan_detour(trajectory, now_s, area, limits, options.detour, stops_s)
        except InfeasibleError:
            continue
        flown = rest if detour is None else _from_now(detour, trajectory, now_s)
        margin = float(margins_m(flown, clock_s, tracks, options.moving).min())
        best = _better(best, Evasion("fly on" if detour is None else "detour", flown, margin, options.safe_m, detour))
        if margin >= 0:
            return best
    curves = _curves_to_rest(trajectory, now_s, limits)
    # Where the vehicle is nearer than it should be, it comes no nearer.
    room_m = max(min(options.safe_m, standing.room_m(trajectory.value(now_s)[:2])), 0.0)
    full = standing.grown(options.safe_m)
    # Rest at the safe distance is wanted more than a way there that keeps as much as now.
    for at_distance, kept_m in itertools.product((True, False), room_m * np.array(KEPT_SHARES)):
        wall = CellCounts(standing.grown(kept_m))
        curves, again = itertools.tee(curves)  # made one by one, and once
        for kind, curve in again:
            if at_distance and full.is_blocked(curve.value(curve.duration_s)[:2]):
                continue
            if wall.blocked_pieces(curve).any() or not heights_in_slab(curve, options.detour.slab_m).all():
                continue
            margin = float(margins_m(curve, clock_s, tracks, options.moving).min())
            best = _better(best, Evasion(kind, curve, margin, float(kept_m)))
            if margin >= 0:
                return best
        if best is not None:
            return best
    raise InfeasibleError("the vehicle can come to rest nowhere without touching what stands: take over by hand")


def _better(one: Evasion | None, other: Evasion) -> Evasion:
    """The one that keeps away the more from what moves."""
    return one if one is not None and one.margin_m >= other.margin_m else other


def _without(seen: BinaryMap, tracks: Sequence[Track], clock_s: float) -> BinaryMap:
    """The map without the cells of moving obstacles."""
    blocked = seen.blocked.copy()
    cells = np.argwhere(blocked)
    middles = seen.points_m(cells + 0.5)
    for track in tracks:
        own = np.linalg.norm(middles - track.positions([clock_s]), axis=1) < track.radius_m + BESIDE_M
        blocked[tuple(cells[own].T)] = False
    return BinaryMap(blocked, seen.origin_m, seen.cell_m)


def _maps_to_fly_round(
    standing: BinaryMap, tracks: Sequence[Track], clock_s: float, met_s: float | None, options: EvasionOptions
) -> Iterator[BinaryMap]:
    """Grown maps: of what stands, and with the moving obstacles where they are about the time at which one is met."""
    grown = standing.grown(options.safe_m)
    yield grown
    if met_s is None:
        return
    blocked = grown.blocked.copy()
    middles = standing.points_m(np.argwhere(np.ones_like(blocked)) + 0.5)
    times = clock_s + max(met_s - SWEPT_S, 0.0), clock_s + met_s + SWEPT_S
    for track in tracks:
        first, last = track.positions(times)
        kept = options.moving.keep_m + track.radius_m + options.moving.sigmas * float(track.deviations_m(times).max())
        move = last - first
        along = np.clip((middles - first) @ move / max(float(move @ move), 1e-9), 0.0, 1.0)
        near = np.linalg.norm(middles - first - along[:, None] * move, axis=1) < kept
        blocked |= near.reshape(blocked.shape)
    yield BinaryMap(blocked, standing.origin_m, standing.cell_m)


def _from_now(detour: Detour, trajectory: PiecewisePolynomial, now_s: float) -> PiecewisePolynomial:
    flown = detour.flown(trajectory)
    return part_of_curve(flown, now_s, flown.duration_s)


def _curves_to_rest(
    trajectory: PiecewisePolynomial, now_s: float, limits: FlightLimits
) -> Iterator[tuple[Kind, PiecewisePolynomial]]:
    """Curves from now on that end at rest: a little further along the trajectory, soon, and where there is room."""
    later_s = min(now_s + COMMITTED_S, trajectory.duration_s)
    onward = part_of_curve(trajectory, now_s, later_s)
    later = motion_at(trajectory, later_s)
    for curve in _quickest_to(_places_ahead(later, limits), later, limits):
        yield "fly on", joined_curves(onward, curve)
    state = motion_at(trajectory, now_s)
    for curve in _quickest_to(_places_ahead(state, limits), state, limits):
        yield "hover", curve
    for curve in _quickest_to(_places_about(state), state, limits):
        yield "back off", curve


def _quickest_to(
    places: Iterator[NDArray[np.float64]], state: NDArray[np.float64], limits: FlightLimits
) -> Iterator[PiecewisePolynomial]:
    """The curves to rest at some places from a state (4, 3) that the limits allow."""
    for place in places:
        curve = curve_to_rest(state, place, limits)
        if curve is not None:
            yield curve


def _places_ahead(state: NDArray[np.float64], limits: FlightLimits) -> Iterator[NDArray[np.float64]]:
    """Where the vehicle can come to rest without a turn."""
    speed = float(np.linalg.norm(state[1]))
    if speed < STILL_M_S:
        yield state[0]
        return
    for multiple in BRAKING_SHARES:
        braking_m = max(speed**2 / (2 * limits.acceleration_m_s2), LEAST_BRAKING_M)
        yield state[0] + multiple * braking_m * state[1] / speed


def _places_about(state: NDArray[np.float64]) -> Iterator[NDArray[np.float64]]:
    """Round about at the same height, first those behind the vehicle."""
    behind = math.atan2(-state[1, 1], -state[1, 0])
    for distance in RETREATS_M:
        for step in range(DIRECTIONS):
            turn = behind + (step + 1) // 2 * (-1) ** step * 2 * math.pi / DIRECTIONS
            yield state[0] + distance * np.array([math.cos(turn), math.sin(turn), 0.0])
