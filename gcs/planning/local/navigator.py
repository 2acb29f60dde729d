"""Flies a plan among what is not in it: from scans to the motion that is commanded, on an injected clock.

The plan is flown leg by leg, from one stop to the next; a leg rests at both ends. Whatever has to be evaded, the
vehicle either is on its leg, or on a piece that leads back to it, or away from it: it then comes to rest where there is
room, and looks for a way back to the leg from there. A stop that cannot be reached is waited for, and then left out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.errors import InfeasibleError, InputError
from gcs.core.replanning import ReplanReason
from gcs.planning.local.curve_parts import motion_at, part_of_curve
from gcs.planning.local.detour import NEAREST_M, DetourOptions, plan_return
from gcs.planning.local.evasion import EvasionOptions, evade, standing_map
from gcs.planning.local.flown_leg import AT_REST_S, JUMP_S, FlownLeg, detoured
from gcs.planning.local.hover import hover
from gcs.planning.local.lidar_map import LidarMap
from gcs.planning.local.local_replan import Departure
from gcs.planning.local.space_time import MovingClearance, Predictions
from gcs.planning.local.surroundings import Surroundings

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from gcs.core.trajectory import PiecewisePolynomial
    from gcs.planning.local.binary_map import BinaryMap
    from gcs.planning.local.evasion import Evasion
    from gcs.planning.local.lidar_scan import LidarScan
    from gcs.planning.local.local_replan import LocalReplan
    from gcs.planning.local.surroundings import Scene
    from gcs.planning.trajectories.flight_limits import FlightLimits

AT_REST_M_S = 1e-3
"""What is slower at a stop counts as rest."""

RETURN_MARGIN_M = 0.3
"""So much more than asked a way back keeps from what moves, or the vehicle would turn round at once."""

NEXT_WAIT_S = 5.0
"""After one stop was left out the next is waited for so long."""

PROGRESS_S = 0.5
"""So much further on the plan counts as progress."""

NEARER_M = 2.0
"""A stop that looks blocked is flown nearer to, if it is by so much."""

AHEAD_S = 1.0
"""What is nearest to where the vehicle would be then is what it evades."""

LOOKS = 60
"""So many places on a leg are looked at."""

SEARCH_EVERY_S = 0.4
"""While the vehicle stands off the plan, a way back is looked for so often: less often than it is scanned."""

OF_SLAB = 0.8
"""The vehicle changes its height by this share of what is scanned above and below, and looks again."""

LEAST_CLIMB_M = 0.1
"""It is not worth while for less."""


@dataclass(frozen=True)
class Stop:
    """A viewpoint on the trajectory.

    Attributes:
        time_s: when the trajectory is there.
        viewpoint: its number in the plan.
        dwell: the vehicle waits there, at rest, until it is told to go on; otherwise it passes.
    """

    time_s: float
    viewpoint: int
    dwell: bool = True


@dataclass(frozen=True)
class NavigatorOptions:
    """What is kept from obstacles, and how long is waited.

    Attributes:
        safe_m: R, between the vehicle's centre and what stands: hull, tracking, errors of the lidar, clearance.
        keep_moving_m: the same from what moves; what is not sure of its motion comes on top.
        slab_half_m: what the lidar sees counts for heights so far above and below the vehicle; None for all heights.
        known: cells that the known structure blocks, scene ENU; in the plane they count at every height, in space
            those layers that the slab meets.
        wait_s: a viewpoint that cannot be reached is waited for so long.
        give_up_s: without any progress for so long the flight is given up.
        map_side_m: edge of the square about the vehicle that is remembered.
        cell_m: edge of its cells.
        fade_s: time after which what is not seen again is down to 1/e.
    """

    safe_m: float = 1.2
    keep_moving_m: float = 1.4
    slab_half_m: float | None = 1.0
    known: BinaryMap | None = None
    wait_s: float = 15.0
    give_up_s: float = 60.0
    map_side_m: float = 50.0
    cell_m: float = 0.2
    fade_s: float = 4.0

    def surroundings(self) -> Surroundings:
        """An empty map and no tracks."""
        return Surroundings(LidarMap(self.map_side_m, self.cell_m, self.fade_s), self.known, self.slab_half_m)

    def evasion(self, slab_m: tuple[float, float] | None) -> EvasionOptions:
        """The same for one decision at some heights."""
        moving = MovingClearance(keep_m=self.keep_moving_m)
        return EvasionOptions(self.safe_m, moving, DetourOptions(slab_m=slab_m))


class LocalNavigator:
    """See the module.

    Args:
        trajectory: the plan, scene ENU; it rests at its end.
        stops: viewpoints on it, in order of time; those before `start_s` are left out.
        limits: kept on the true extrema of all that is new.
        options: what is kept, how long is waited.
        start_s: time on the trajectory from which it is flown, at rest; the flight begins with the first call that
            names a time.
        place_m: where the vehicle hovers, shape (3,), when that is not the trajectory's place: it joins it from there.

    Attributes:
        finished: the vehicle rests at the trajectory's end.
        gave_up: why the flight was given up; the vehicle hovers and still evades.

    Raises:
        InputError: stops out of order or off the trajectory, or a stop at which it moves; it names it.
    """

    def __init__(
        self,
        trajectory: PiecewisePolynomial,
        stops: Sequence[Stop],
        limits: FlightLimits,
        options: NavigatorOptions | None = None,
        start_s: float = 0.0,
        place_m: NDArray[np.float64] | None = None,
    ) -> None:
        _check(trajectory, stops, start_s)
        self._trajectory, self._limits = trajectory, limits
        self._options = options or NavigatorOptions()
        self._todo = [stop for stop in stops if stop.time_s >= start_s]
        self._around = self._options.surroundings()
        self._departure: Departure | None = None
        self._reports: list[LocalReplan] = []
        self._clock_s = -math.inf
        self._progress_s, self._furthest_s = 0.0, -math.inf
        self._waits_at: Stop | None = None
        self._holding = False
        self._searched_s = -math.inf
        self.finished = False
        self.gave_up: str | None = None
        self._begin_leg(start_s)
        if place_m is not None:
            curve = hover(np.asarray(place_m, dtype=np.float64))
            self._flown = FlownLeg(curve, 0.0, np.zeros(1), np.zeros(1), math.inf)

    def see(self, scan: LidarScan, position_m: NDArray[np.float64], heading_rad: float, clock_s: float) -> None:
        """Enter a scan; see `Surroundings.see`.

        Raises:
            InputError: as there; nothing has changed then.
        """
        self._around.see(scan, position_m, heading_rad, clock_s)

    def motion(self, clock_s: float) -> NDArray[np.float64]:
        """Position, velocity and acceleration to be commanded, scene ENU, shape (3, 3); not before the last call."""
        self._start(clock_s)
        return motion_at(self._flown.curve, self._flown.at(clock_s))[:3]

    @property
    def plan_time_s(self) -> float:
        """Time on the plan's trajectory; off the plan that at which it was left."""
        return self._leg_begin_s + min(self._flown.on_leg(self._clock_s), self._leg_length_s)

    @property
    def arrived(self) -> int | None:
        """The viewpoint at which the vehicle waits; None elsewhere, and while it has to evade there."""
        return None if self._waits_at is None or self.away else self._waits_at.viewpoint

    @property
    def away(self) -> bool:
        """Whether the vehicle is off the plan."""
        return self._flown.at(self._clock_s) < self._flown.joins_s - JUMP_S

    @property
    def held(self) -> bool:
        """Whether it stands still because it was told to."""
        return self._holding and self._flown.ended(self._clock_s)

    def hold(self) -> None:
        """Come to rest and stay, but evade what comes."""
        self._holding = True

    def release(self) -> None:
        """Go on after `hold`."""
        self._holding = False
        self._progress_s = self._clock_s

    def go_on(self) -> None:
        """Leave the stop at which the vehicle waits."""
        if self._waits_at is None:
            return
        self._todo.remove(self._waits_at)
        self._next_leg()

    def decide(self, clock_s: float) -> tuple[LocalReplan, ...]:
        """Look again whether all is well, and change what is flown where it is not.

        Args:
            clock_s: now.

        Returns:
            The departures from the plan that are over since the last call.
        """
        self._start(clock_s)
        place = self._flown.curve.value(self._flown.at(clock_s))
        leg_s = self._flown.on_leg(clock_s)
        ahead = self._leg.value(np.linspace(max(leg_s - 2.0, 0.0), leg_s + 10.0, 60))
        scene = self._around.at(clock_s, float(place[2]), ahead)
        if self.away and not self._holding and self.gave_up is None and self._flown.joins_s == math.inf:
            self._come_back(scene)
            if self._flown.joins_s == math.inf:
                self._wait(clock_s)
        self._evade(scene)
        self._take_note(clock_s)
        reports, self._reports = tuple(self._reports), []
        return reports

    # -- the leg

    def _begin_leg(self, begin_s: float) -> None:
        """Fly from a time on the trajectory to the next stop, or to the end."""
        self._target = next((stop for stop in self._todo if stop.dwell), None)
        end_s = self._trajectory.duration_s if self._target is None else self._target.time_s
        self._leg_begin_s, self._leg_length_s = begin_s, end_s - begin_s
        if self._leg_length_s > AT_REST_S:
            self._leg = part_of_curve(self._trajectory, begin_s, end_s)
        else:
            self._leg = hover(self._trajectory.value(end_s))
        length = self._leg.duration_s
        knots = np.array([0.0, length])
        self._flown = FlownLeg(self._leg, self._clock_s, knots, knots, 0.0)

    def _next_leg(self) -> None:
        """Go on behind the stop that is done or left out, from where the vehicle is."""
        away, flown = self.away, self._flown
        self._waits_at = None
        self._progress_s = self._clock_s
        self._begin_leg(self._leg_begin_s + self._leg_length_s)
        if away:
            self._flown = FlownLeg(flown.curve, flown.begun_s, np.zeros(1), np.zeros(1), math.inf)

    def _start(self, clock_s: float) -> None:
        if self._clock_s == -math.inf:
            self._flown.begun_s = self._progress_s = clock_s
        self._clock_s = max(self._clock_s, clock_s)

    # -- decisions

    def _evade(self, scene: Scene) -> None:
        """Fly something else where what is flown is not safe any more, or the vehicle is to hold."""
        clock_s, flown = scene.clock_s, self._flown
        now_s, curve = flown.at(clock_s), flown.curve
        if flown.ended(clock_s):
            now_s, curve = 0.0, hover(curve.value(now_s))
        stay = self._holding or self.gave_up is not None
        try:
            evasion = evade(
                curve,
                now_s,
                scene.seen,
                scene.tracks,
                clock_s,
                self._limits,
                self._options.evasion(scene.slab_m),
                forbidden=scene.forbidden,
                stay=stay and not flown.ended(clock_s) and flown.joins_s < math.inf,
            )
        except InfeasibleError:
            return  # there is nothing better than what is flown; it ends at rest
        if evasion.kind == "fly on":
            return
        leg_s = flown.on_leg(clock_s)
        self._depart(evasion, scene)
        if evasion.detour is None or flown.joins_s == math.inf:
            self._flown = FlownLeg(evasion.curve, clock_s, np.zeros(1), np.full(1, leg_s), math.inf)
        else:
            self._flown = detoured(flown, evasion.detour, evasion.curve, now_s, clock_s)
            self._leave_out_passed(flown.leg_at(evasion.detour.leave_s), flown.leg_at(evasion.detour.rejoin_s))

    def _come_back(self, scene: Scene) -> None:
        """Find a way back to the leg once the vehicle stands; give the stop up after a while without one."""
        clock_s = scene.clock_s
        if not self._flown.ended(clock_s) or clock_s < self._searched_s + SEARCH_EVERY_S:
            return
        self._searched_s = clock_s
        place = self._flown.curve.value(self._flown.curve.duration_s)
        options = self._options.evasion(scene.slab_m)
        leg_s = min(self._flown.on_leg(clock_s), self._leg.duration_s)
        area = standing_map(scene, options.safe_m)
        leg, from_s = self._leg, self._time_beside(place, leg_s)
        if area.is_blocked(leg.value(leg.duration_s)[:2], off_map=False):  # it may look so from afar
            nearer = _nearest_free(leg, leg_s, area, place)
            if nearer is None:
                return
            leg = hover(nearer)
            from_s = leg.duration_s
        if np.linalg.norm(place - leg.value(leg.duration_s)) < NEAREST_M:
            self._flown = FlownLeg(hover(place), clock_s, np.zeros(1), np.full(1, leg.duration_s), 0.0)
            return
        standing = np.stack([place, *np.zeros((3, 3))])
        try:
            back = plan_return(standing, leg, from_s, area, self._limits, options.detour)
        except InfeasibleError:
            higher = _towards_height(leg, from_s, area, place, scene.slab_m)
            if higher is None:
                return
            leg = hover(higher)
            try:
                back = plan_return(standing, leg, leg.duration_s, area, self._limits, options.detour)
            except InfeasibleError:
                return
        onward = back.onward(leg)
        if Predictions.of(scene.tracks, clock_s, options.moving).least_margin_m(onward) < RETURN_MARGIN_M:
            return  # something is coming
        if leg is not self._leg:
            self._flown = FlownLeg(onward, clock_s, np.zeros(1), np.full(1, leg_s), math.inf)
            self._progress_s = clock_s + onward.duration_s
            return
        joins_s = back.curve.duration_s
        slowed_s = joins_s + (back.own_pace_s - back.rejoin_s) / back.pace
        times = np.array([0.0, joins_s - JUMP_S, joins_s, slowed_s, onward.duration_s + JUMP_S])
        legs = np.array([leg_s, leg_s, back.rejoin_s, back.own_pace_s, self._leg.duration_s])
        self._leave_out_passed(leg_s, back.rejoin_s)
        self._flown = FlownLeg(onward, clock_s, times, legs, joins_s)

    def _time_beside(self, place_m: NDArray[np.float64], leg_s: float) -> float:
        """Time on the leg that is nearest to a place, from one on and before the next viewpoint."""
        passes = [stop.time_s - self._leg_begin_s for stop in self._todo if not stop.dwell]
        times = np.linspace(leg_s, min([*passes, self._leg.duration_s]), LOOKS)
        return float(times[np.linalg.norm(self._leg.value(times) - place_m, axis=1).argmin()])

    def _wait(self, clock_s: float) -> None:
        """What becomes of the stop, or of the flight, when there is no way for long."""
        waited_s = clock_s - self._progress_s
        if self._target is not None and waited_s > self._options.wait_s:
            departure = self._departure_now(ReplanReason.VIEWPOINT_BLOCKED)
            departure.skipped.append(self._target.viewpoint)
            self._todo.remove(self._target)
            self._next_leg()
            self._progress_s = clock_s - self._options.wait_s + NEXT_WAIT_S
        elif self._target is None and waited_s > self._options.give_up_s:
            self.gave_up = f"no way on was found in {waited_s:.0f} s: the vehicle hovers, take over or order anew"
            self._reports.append(self._departure_now(ReplanReason.HELD).report(None))
            self._departure = None

    def _take_note(self, clock_s: float) -> None:
        """What has been reached since."""
        flown = self._flown
        if self._departure is not None:
            self._departure.passes(flown.curve.value(flown.at(clock_s)))
        if self.away:
            self._waits_at = None
            return
        if self._departure is not None and flown.at(clock_s) >= flown.joins_s - JUMP_S:
            self._reports.append(self._departure.report(flown.begun_s + flown.joins_s))
            self._departure = None
        plan_s = self.plan_time_s
        self._todo = [stop for stop in self._todo if stop.dwell or stop.time_s > plan_s]
        if plan_s > self._furthest_s + PROGRESS_S or flown.ended(clock_s):
            self._furthest_s, self._progress_s = plan_s, clock_s
        if flown.ended(clock_s):
            self._waits_at = self._target
            self.finished = self._target is None

    def _depart(self, evasion: Evasion, scene: Scene) -> None:
        flown = self._flown
        obstacle = scene.nearest(flown.curve.value(flown.at(scene.clock_s) + AHEAD_S))
        moves = obstacle is not None and obstacle[3:] != (0.0, 0.0)
        round_it = ReplanReason.MOVING_OBSTACLE if moves else ReplanReason.STANDING_OBSTACLE
        reasons = {"hover": ReplanReason.HELD, "back off": ReplanReason.BACKED_OFF}
        departure = self._departure_now(reasons.get(evasion.kind, round_it))
        departure.obstacle = departure.obstacle or obstacle

    def _departure_now(self, reason: ReplanReason) -> Departure:
        if self._departure is None:
            self._departure = Departure(reason, self._clock_s, self.plan_time_s)
        self._departure.grows(reason)
        return self._departure

    def _leave_out_passed(self, from_s: float, to_s: float) -> None:
        """Viewpoints to be passed on a part of the leg that is not flown."""
        begin_s, end_s = self._leg_begin_s + from_s, self._leg_begin_s + to_s
        lost = [stop for stop in self._todo if not stop.dwell and begin_s < stop.time_s < end_s]
        if lost:
            departure = self._departure_now(ReplanReason.VIEWPOINT_BLOCKED)
            departure.skipped.extend(stop.viewpoint for stop in lost)
            self._todo = [stop for stop in self._todo if stop not in lost]


def _nearest_free(
    leg: PiecewisePolynomial, from_s: float, area: BinaryMap, place_m: NDArray[np.float64]
) -> NDArray[np.float64] | None:
    """The free place on a leg that is nearest to its end, if that is worth the way."""
    places = leg.value(np.linspace(from_s, leg.duration_s, LOOKS))
    away = np.linalg.norm(places - places[-1], axis=1)
    near = away < np.linalg.norm(place_m - places[-1]) - NEARER_M
    for k in np.argsort(away):
        if near[k] and not area.is_blocked(places[k, :2]):
            return np.asarray(places[k])
    return None


def _towards_height(
    leg: PiecewisePolynomial,
    from_s: float,
    area: BinaryMap,
    place_m: NDArray[np.float64],
    slab_m: tuple[float, float] | None,
) -> NDArray[np.float64] | None:
    """Above or below a place, towards the height at which the leg comes free, as far as the lidar sees there.

    A way back keeps to the heights that are scanned from where it begins; so a leg that is not among them there needs
    the vehicle to climb or to sink first.
    """
    if slab_m is None:
        return None
    places = leg.value(np.linspace(from_s, leg.duration_s, LOOKS))
    blocked = np.array([area.is_blocked(place[:2], off_map=False) for place in places])
    behind = int(np.flatnonzero(blocked)[-1]) + 1 if blocked.any() else 0
    reach_m = OF_SLAB * (slab_m[1] - slab_m[0]) / 2
    climb_m = float(np.clip(places[min(behind, LOOKS - 1), 2] - place_m[2], -reach_m, reach_m))
    if abs(climb_m) < LEAST_CLIMB_M:
        return None
    return np.asarray(place_m + np.array([0.0, 0.0, climb_m]))


def _check(trajectory: PiecewisePolynomial, stops: Sequence[Stop], start_s: float) -> None:
    if not 0 <= start_s <= trajectory.duration_s:
        raise InputError(f"{start_s:g} s is not on a trajectory of {trajectory.duration_s:g} s", field="start_s")
    before = 0.0
    for stop in stops:
        field = f"viewpoint {stop.viewpoint}"
        if not before <= stop.time_s <= trajectory.duration_s + AT_REST_S:
            raise InputError(f"{stop.time_s:g} s is not on the trajectory, or before the stop before it", field=field)
        if stop.dwell and np.linalg.norm(trajectory.value(stop.time_s, 1)) > AT_REST_M_S:
            raise InputError(f"the trajectory does not rest at {stop.time_s:g} s", field=field)
        before = stop.time_s
