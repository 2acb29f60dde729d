"""The way back to a leg of the plan, for a vehicle that stands beside it.

Local paths stay at the heights that the lidar scans. So there are three kinds of way: joining the leg in passing, or
flying straight to its end, where they are at such a height; and where they are not, a stepping stone: first above or
below a place of the leg beyond what stands, at the present height, and then slowly up or down to the leg. What stands
is taken to be upright: what was seen at one height is in the way at all of them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.errors import InfeasibleError
from gcs.planning.local.curve_clearance import CellCounts
from gcs.planning.local.curve_parts import part_of_curve
from gcs.planning.local.detour import NEAREST_M, plan_return
from gcs.planning.local.evasion import places_about
from gcs.planning.local.flown_leg import JUMP_S, FlownLeg
from gcs.planning.local.hover import hover
from gcs.planning.local.rest_path import climb_to, rest_path, straight_path
from gcs.planning.local.search_budget import SearchBudget
from gcs.planning.local.soft_start import soft_start
from gcs.planning.local.space_time import Predictions

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from gcs.core.trajectory import PiecewisePolynomial
    from gcs.planning.local.binary_map import BinaryMap
    from gcs.planning.local.evasion import EvasionOptions
    from gcs.planning.local.room import Room
    from gcs.planning.local.surroundings import Scene
    from gcs.planning.trajectories.flight_limits import FlightLimits

MARGIN_M = 0.3
"""So much more than asked a way back keeps from what moves, or the vehicle would turn round at once."""

LOOKS = 60
"""So many places on a leg are looked at."""

WORTH_M = 1.0
"""A stepping stone is so far from the vehicle at least, and from others that were tried."""

MOST_STONES = 3
"""So many stepping stones are tried at most."""

ASIDE_ROOM_M = 0.4
"""Nearer to what blocks than this the vehicle first goes aside ..."""

ASIDES_M = (0.4, 0.7, 1.0, 1.5)
"""... by one of these distances."""

FREE_S = 4.0
"""The leg is flown on from rest where it is free for so long behind the place at which it has its own pace."""

BESIDE_M = 0.3
"""What is so near is straight above or below."""

LEAST_CLIMB_M = 0.1
"""It is not worth while for less."""


@dataclass(frozen=True, eq=False)
class WayBack:
    """Finds ways back.

    Args:
        leg: of the plan, at rest at its end.
        first_s: time on the leg before which it is not joined.
        last_s: time on the leg behind which it is not joined, but at its end: a viewpoint that is passed.
        scene: what is about the vehicle.
        room: how far everything is from what stands.
        limits: kept on the true extrema.
        options: what is kept.
        budget: what may be spent on looking for it.
    """

    leg: PiecewisePolynomial
    first_s: float
    last_s: float
    scene: Scene
    room: Room
    limits: FlightLimits
    options: EvasionOptions
    budget: SearchBudget = field(default_factory=SearchBudget)

    @cached_property
    def area(self) -> BinaryMap:
        """Where new pieces must not go."""
        return self.room.blocked_below(self.options.safe_m)

    @cached_property
    def standing(self) -> BinaryMap:
        """Where the leg is blocked, at all heights."""
        return self.room.standing_below(self.options.safe_m)

    @property
    def _end_is_blocked(self) -> bool:
        return self.standing.is_blocked(self.leg.value(self.leg.duration_s)[:2], off_map=False)

    def find(self, place_m: NDArray[np.float64], left_s: float) -> FlownLeg | None:
        """The best way from a place (3,) at which the vehicle stands, or None while there is none.

        Args:
            place_m: where it stands.
            left_s: time on the leg at which it was left.
        """
        end = self.leg.value(self.leg.duration_s)
        near = float(np.linalg.norm(place_m - end)) < NEAREST_M
        if not self._end_is_blocked:
            if near:
                return self._flown(hover(place_m), 0.0, self.leg.duration_s, left_s)
            along = self._along(place_m)
            if along is not None:
                return along
            direct = self._direct(place_m, end, left_s)
            if direct is not None and self.last_s >= self.leg.duration_s:
                return direct
            joining = self._joining(place_m, left_s)
            if joining is not None or direct is not None:
                return joining or direct
        stone = next((c for c in self._stones(place_m) if self._is_calm(c)), None)
        return None if stone is None else self._flown(stone, math.inf, left_s, left_s)

    def _along(self, place_m: NDArray[np.float64]) -> FlownLeg | None:
        """On along the leg, where the vehicle stands on it and it is free ahead."""
        found = soft_start(place_m, self.leg, self.first_s, self.limits, self.scene.clock_s)
        if found is None:
            return None
        ahead = part_of_curve(found.curve, 0.0, min(found.joins_s + FREE_S, found.curve.duration_s))
        blocked = CellCounts(self.standing, off_map_blocked=False).blocked_pieces(ahead).any()
        return None if blocked or not self._is_calm(found.curve) else found

    def _direct(self, place_m: NDArray[np.float64], end_m: NDArray[np.float64], left_s: float) -> FlownLeg | None:
        if not self._is_scanned(float(end_m[2])):
            return None
        curve = rest_path(place_m, end_m, self.area, self.limits, self.options.detour, self.budget)
        if curve is None or not self._is_calm(curve):
            return None
        return self._flown(curve, curve.duration_s, self.leg.duration_s, left_s)

    def _joining(self, place_m: NDArray[np.float64], left_s: float) -> FlownLeg | None:
        """Join the leg in passing."""
        standing = np.stack([place_m, *np.zeros((3, 3))])
        try:
            back = plan_return(
                standing,
                self.leg,
                self.first_s,
                self.area,
                self.limits,
                self.options.detour,
                self.standing,
                self.budget,
            )
        except InfeasibleError:
            return None
        onward = back.onward(self.leg)
        if not self._is_calm(onward):
            return None
        joins_s = back.curve.duration_s
        slowed_s = joins_s + (back.own_pace_s - back.rejoin_s) / back.pace
        times = np.array([0.0, joins_s - JUMP_S, joins_s, slowed_s, onward.duration_s + JUMP_S])
        legs = np.array([left_s, left_s, back.rejoin_s, back.own_pace_s, self.leg.duration_s])
        return FlownLeg(onward, self.scene.clock_s, times, legs, joins_s)

    def _stones(self, place_m: NDArray[np.float64]) -> Iterator[PiecewisePolynomial]:
        """Curves to above or below places of the leg, the last of them first, and straight up or down to it."""
        places = self.leg.value(np.linspace(self.first_s, self.leg.duration_s, LOOKS))
        blocked = np.array([self.area.is_blocked(place[:2], off_map=True) for place in places])
        tried: list[NDArray[np.float64]] = []
        for k in np.flatnonzero(~blocked)[::-1]:
            goal = np.array([places[k, 0], places[k, 1], place_m[2]])
            climb_m = float(places[k, 2] - place_m[2])
            if not self.scene.column_is_free(goal, float(places[k, 2])):
                continue
            if np.linalg.norm(goal - place_m) < BESIDE_M:
                if abs(climb_m) > LEAST_CLIMB_M:
                    yield climb_to(place_m, float(places[k, 2]), self.limits)
                break
            if len(tried) < MOST_STONES and all(np.linalg.norm(goal - other) > WORTH_M for other in [place_m, *tried]):
                tried.append(goal)
                curve = rest_path(place_m, goal, self.area, self.limits, self.options.detour, self.budget)
                if curve is not None:
                    yield curve
        if not self._end_is_blocked:
            yield from self._aside(place_m)
        if not blocked.all():
            height = float(places[np.flatnonzero(~blocked)[-1], 2])
            if abs(height - place_m[2]) > LEAST_CLIMB_M and self.scene.column_is_free(place_m, height):
                yield climb_to(place_m, height, self.limits)

    def _aside(self, place_m: NDArray[np.float64]) -> Iterator[PiecewisePolynomial]:
        """A little away from what is so near that no curve could begin along it."""
        roomy_m = self.options.safe_m + ASIDE_ROOM_M
        if self.room.at(place_m) >= roomy_m:
            return
        for away_m in ASIDES_M:
            places = places_about(place_m, away_m)
            rooms = [self.room.at(place) for place in places]
            if max(rooms) >= roomy_m:
                goal = places[int(np.argmax(rooms))]
                curve = straight_path(place_m, goal, self.area, self.limits, self.options.detour)
                if curve is not None:
                    yield curve

    def _flown(self, curve: PiecewisePolynomial, joins_s: float, joined_s: float, left_s: float) -> FlownLeg:
        """A curve that joins the leg at its own end, or not at all."""
        if joins_s == math.inf:
            return FlownLeg(curve, self.scene.clock_s, np.zeros(1), np.full(1, left_s), joins_s)
        times = np.array([joins_s - JUMP_S, joins_s])
        return FlownLeg(curve, self.scene.clock_s, times, np.array([left_s, joined_s]), joins_s)

    def _is_scanned(self, height_m: float) -> bool:
        low, high = self.scene.slab_m or (-math.inf, math.inf)
        return low <= height_m <= high

    def _is_calm(self, curve: PiecewisePolynomial) -> bool:
        """Whether nothing that moves comes near."""
        predictions = Predictions.of(self.scene.tracks, self.scene.clock_s, self.options.moving)
        return predictions.least_margin_m(curve) >= MARGIN_M
