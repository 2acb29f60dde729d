"""What to do about obstacles that stand and obstacles that move: fly on, fly round, hover, or back off.

The first of these that is proved free is taken, in this order: the trajectory as it is, a detour, a little more of the
trajectory and then coming to rest, and coming to rest with the least move. Standing obstacles are on the map; moving
ones are taken off it, predicted, and kept away from in space and time. Where nothing keeps all that is asked, that is
done which lacks least of it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

import numpy as np

from gcs.core.errors import InfeasibleError
from gcs.planning.local.binary_map import BinaryMap, mark_about
from gcs.planning.local.curve_checks import within_limits
from gcs.planning.local.curve_clearance import CellCounts
from gcs.planning.local.curve_parts import joined_curves, motion_at, part_of_curve
from gcs.planning.local.detour import STILL_M_S, Detour, DetourOptions, plan_detour
from gcs.planning.local.lidar_map import BESIDE_M
from gcs.planning.local.rest_search import search_rest
from gcs.planning.local.room import Room, room_about
from gcs.planning.local.search_budget import SearchBudget
from gcs.planning.local.space_time import STEP_S, MovingClearance, Predictions, first_conflict_s

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from gcs.core.trajectory import PiecewisePolynomial
    from gcs.planning.local.moving_tracks import Track
    from gcs.planning.local.surroundings import Scene
    from gcs.planning.trajectories.flight_limits import FlightLimits

Kind = Literal["fly on", "detour", "hover", "back off"]

BRAKING_SHARES = (1.5, 2.0, 2.5, 3.2, 4.5)
"""Tried multiples of the distance that the acceleration limit alone needs to stop."""

LEAST_BRAKING_M = 0.3

COMMITTED_S = 0.5
"""So far along the trajectory the vehicle may go on while it can still come to rest from there."""

RETREATS_M = (0.7, 1.5, 2.5, 4.0, 6.0)
DIRECTIONS = 16

WORTH_M = 0.15
"""What is flown is changed only for so much more margin."""

STANDING_WEIGHT, END_WEIGHT = 1.5, 0.3
"""A metre that lacks towards what stands counts for so many towards what moves: on the way, and at rest alone."""

LEAST_SHARE = 0.5
"""No curve to rest comes nearer to what stands than this share of what is kept now, or of the safe distance."""

VERIFIED = 6
"""So many of the best curves are proved at most."""

ROUNDED_M = 0.05
"""What the search bounds is proved for so much less."""

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
    forbidden: NDArray[np.bool_] | None = None,
    stay: bool = False,
    room: Room | None = None,
    budget: SearchBudget | None = None,
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
        forbidden: cells of the map that nothing new may enter though no lidar sees why, of the map's shape.
        stay: come to rest, whatever comes.
        room: `standing_room` of all this where it is known already.
        budget: what may be spent on detours; a whole one when it is not given.

    Raises:
        InputError: `now_s` is not on the trajectory.
        InfeasibleError: no curve to rest keeps off what stands.
    """
    room = room or room_about(_without(seen, tracks, clock_s), forbidden, options.safe_m)
    budget = budget or SearchBudget()
    predictions = Predictions.of(tracks, clock_s, options.moving)
    best: Evasion | None = None
    if not stay:
        rest = part_of_curve(trajectory, now_s, trajectory.duration_s)
        met_s = first_conflict_s(predictions.margins_m(rest))
        for area, standing in _maps_to_fly_round(room, tracks, clock_s, met_s, options):
            try:
                detour = plan_detour(trajectory, now_s, area, limits, options.detour, stops_s, standing, budget)
            except InfeasibleError:
                continue
            flown = rest if detour is None else _from_now(detour, trajectory, now_s)
            margin = predictions.least_margin_m(flown)
            found = Evasion("fly on" if detour is None else "detour", flown, margin, options.safe_m, detour)
            if margin >= 0:
                return found
            best = found if best is None or margin > best.margin_m else best
        committed = _committed(trajectory, now_s, limits, room, predictions, options)
        if committed is not None:
            return committed
    resting = _to_rest(motion_at(trajectory, now_s), limits, room, predictions, options)
    if best is not None and (resting is None or best.margin_m > resting.margin_m - WORTH_M):
        return best
    if resting is None:
        raise InfeasibleError("the vehicle can come to rest nowhere without touching what stands: take over by hand")
    return resting


def standing_room(scene: Scene, safe_m: float) -> Room:
    """How far everything is from what stands."""
    return room_about(_without(scene.seen, scene.tracks, scene.clock_s), scene.forbidden, safe_m)


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
    room: Room, tracks: Sequence[Track], clock_s: float, met_s: float | None, options: EvasionOptions
) -> Iterator[tuple[BinaryMap, BinaryMap]]:
    """Grown maps with and without what is forbidden: of what stands, and with what moves when one of it is met."""
    area, standing = room.blocked_below(options.safe_m), room.standing_below(options.safe_m)
    yield area, standing
    if met_s is None:
        return
    swept = np.zeros(area.blocked.shape, dtype=np.bool_)
    times = clock_s + max(met_s - SWEPT_S, 0.0), clock_s + met_s + SWEPT_S
    for track in tracks:
        first, last = area.cells(track.positions(times))
        unsure = options.moving.sigmas * float(track.deviations_m(times).max())
        kept = options.moving.keep_m + track.radius_m + min(unsure, options.moving.most_unsure_m)
        mark_about(swept, first, last, kept / area.cell_m)
    yield (
        BinaryMap(area.blocked | swept, area.origin_m, area.cell_m),
        BinaryMap(standing.blocked | swept, area.origin_m, area.cell_m),
    )


def _from_now(detour: Detour, trajectory: PiecewisePolynomial, now_s: float) -> PiecewisePolynomial:
    flown = detour.flown(trajectory)
    return part_of_curve(flown, now_s, flown.duration_s)


def _committed(
    trajectory: PiecewisePolynomial,
    now_s: float,
    limits: FlightLimits,
    room: Room,
    predictions: Predictions,
    options: EvasionOptions,
) -> Evasion | None:
    """A little further along the trajectory, and to rest from there: None when that does not keep all that is asked."""
    later_s = min(now_s + COMMITTED_S, trajectory.duration_s)
    if later_s - now_s < STEP_S:
        return None
    later = motion_at(trajectory, later_s)
    places = _places_ahead(later, limits)
    found = search_rest(later, places, limits, room, predictions, later_s - now_s)
    onward = part_of_curve(trajectory, now_s, later_s)
    wall = CellCounts(room.blocked_below(options.safe_m))
    for k in range(len(places)):
        if math.isfinite(found.durations_s[k]) and min(found.rooms_m[k], found.end_rooms_m[k]) >= options.safe_m:
            curve = joined_curves(onward, found.curve(k))
            margin = predictions.least_margin_m(curve)
            if margin >= 0 and not wall.blocked_pieces(curve).any() and within_limits(curve, limits):
                return Evasion("fly on", curve, margin, options.safe_m)
    return None


def _to_rest(
    state: NDArray[np.float64], limits: FlightLimits, room: Room, predictions: Predictions, options: EvasionOptions
) -> Evasion | None:
    """The curve to rest that lacks least of what is asked, and among those that lack nothing the least move."""
    ahead = _places_ahead(state, limits)
    places = np.concatenate([ahead, places_about(ahead[0], *RETREATS_M)])
    found = search_rest(state, places, limits, room, predictions)
    here_m = min(room.at(state[0]), options.safe_m)
    lack = np.minimum(found.margins_m, 0.0)
    lack += STANDING_WEIGHT * np.minimum(found.rooms_m - options.safe_m, 0.0)
    lack += END_WEIGHT * np.minimum(found.end_rooms_m - options.safe_m, 0.0)
    lack -= 1e-3 * np.linalg.norm(places - ahead[0], axis=1)
    lack[~(np.isfinite(found.durations_s) & (found.rooms_m > LEAST_SHARE * here_m))] = -np.inf
    for k in np.argsort(-lack)[:VERIFIED]:
        if lack[k] == -np.inf:
            break
        curve = found.curve(int(k))
        kept_m = min(float(found.rooms_m[k]) - ROUNDED_M, options.safe_m)
        if CellCounts(room.blocked_below(kept_m)).blocked_pieces(curve).any() or not within_limits(curve, limits):
            continue
        kind: Kind = "hover" if k < len(ahead) else "back off"
        return Evasion(kind, curve, predictions.least_margin_m(curve), kept_m)
    return None


def _places_ahead(state: NDArray[np.float64], limits: FlightLimits) -> NDArray[np.float64]:
    """Where the vehicle can come to rest without a turn, shape (K, 3)."""
    speed = float(np.linalg.norm(state[1]))
    if speed < STILL_M_S:
        return state[:1].copy()
    braking_m = max(speed**2 / (2 * limits.acceleration_m_s2), LEAST_BRAKING_M)
    return np.asarray(state[0] + np.array(BRAKING_SHARES)[:, None] * braking_m * state[1] / speed)


def places_about(place_m: NDArray[np.float64], *away_m: float) -> NDArray[np.float64]:
    """Round about a place at the same height, at some distances, shape (K, 3)."""
    turns = 2 * math.pi / DIRECTIONS * np.arange(DIRECTIONS)
    ways = np.column_stack([np.cos(turns), np.sin(turns), np.zeros(DIRECTIONS)])
    return np.asarray(place_m + (np.array(away_m)[:, None, None] * ways).reshape(-1, 3))
