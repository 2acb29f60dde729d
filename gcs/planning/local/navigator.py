"""Flies a plan among what is not in it: from scans to the motion that is commanded, on an injected clock.

The plan is flown leg by leg, from one stop to the next; a leg rests at both ends. Whatever has to be evaded, the
vehicle either is on its leg, or on a piece that leads back to it, or away from it: it then comes to rest where there is
room, and looks for a way back to the leg from there. A stop that cannot be reached is waited for; then its picture is
taken from another place, if there is one, or it is left out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.errors import InfeasibleError, InputError
from gcs.core.replanning import ReplanReason
from gcs.planning.local.curve_parts import motion_at, part_of_curve
from gcs.planning.local.evasion import evade, standing_room
from gcs.planning.local.flown_leg import AT_REST_S, JUMP_S, FlownLeg, detoured, slowed
from gcs.planning.local.hover import hover
from gcs.planning.local.local_replan import Departure
from gcs.planning.local.moved_view import way_to_moved_view
from gcs.planning.local.navigator_options import NavigatorOptions
from gcs.planning.local.search_budget import SearchBudget
from gcs.planning.local.space_time import MovingClearance, Predictions
from gcs.planning.local.stream_loss_pace import slowed_for_stream_loss
from gcs.planning.local.way_back import LOOKS, WayBack

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from gcs.core.trajectory import PiecewisePolynomial
    from gcs.planning.local.evasion import Evasion
    from gcs.planning.local.lidar_scan import LidarScan
    from gcs.planning.local.local_replan import LocalReplan
    from gcs.planning.local.moved_view import MovedViews
    from gcs.planning.local.room import Room
    from gcs.planning.local.surroundings import Scene
    from gcs.planning.trajectories.flight_limits import FlightLimits

AT_REST_M_S = 1e-3
"""What is slower at a stop counts as rest."""

NEXT_WAIT_S = 5.0
"""After one stop was left out the next is waited for so long, and so is a place to take its picture from instead."""

MOST_MOVES = 3
"""So many places, one after the other, are gone for to take the picture of a stop from."""

MOST_AWAY = 3.0
"""A flight is given up, too, when it was off the plan for so many times as long, whatever it did there."""

PROGRESS_S = 0.5
"""So much further on the plan counts as progress."""

AHEAD_S = 1.0
"""What is nearest to where the vehicle would be then is what it evades."""

SEARCH_EVERY_S = 0.4
"""While the vehicle stands off the plan, a way back is looked for so often: less often than it is scanned."""


@dataclass(frozen=True)
class Stop:
    """A viewpoint on the trajectory.

    Attributes:
        time_s: when the trajectory is there.
        viewpoint: its number in the plan.
        dwell: the vehicle waits there, at rest, until it is told to go on; otherwise it passes.
        others: places from which its picture can be taken instead; None when it is not to be.
    """

    time_s: float
    viewpoint: int
    dwell: bool = True
    others: MovedViews | None = None


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
        moved_to: from where, shape (3,), the picture of the next stop is taken instead of there; None for there.

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
        self._around = self._options.surroundings(trajectory)
        self._departure: Departure | None = None
        self._reports: list[LocalReplan] = []
        self._clock_s = -math.inf
        self._progress_s, self._furthest_s = 0.0, -math.inf
        self._waits_at: Stop | None = None
        self._holding = False
        self._searched_s = -math.inf
        self._decided_s, self._stuck_s = 0.0, 0.0
        self.finished = False
        self.gave_up: str | None = None
        self.moved_to: NDArray[np.float64] | None = None
        self._moves = 0
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
        """The viewpoint for which the vehicle waits; None elsewhere, and while it has to evade there."""
        return None if self._waits_at is None or self._off_leg else self._waits_at.viewpoint

    @property
    def away(self) -> bool:
        """Whether the vehicle is off the plan."""
        return self.moved_to is not None or self._off_leg

    @property
    def _off_leg(self) -> bool:
        return self._flown.at(self._clock_s) < self._flown.joins_s - JUMP_S

    @property
    def departing(self) -> ReplanReason | None:
        """Why it is off the plan; None while it is on it."""
        return None if self._departure is None else self._departure.reason

    def break_off(self) -> LocalReplan | None:
        """The flight ends here: what is to be told of a departure that still lasts."""
        departure, self._departure = self._departure, None
        return None if departure is None else departure.report(None)

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

    def go_on(self, viewpoint: int, moved_to: NDArray[np.float64] | None = None) -> None:
        """Leave the stop at a viewpoint, where the vehicle waits, or waited until it gave way to something.

        Args:
            viewpoint: which.
            moved_to: from where its picture was taken, shape (3,); None for from there, or not at all.
        """
        if self._target is None or self._target.viewpoint != viewpoint:
            return
        if moved_to is not None:
            self._departure_now(ReplanReason.VIEWPOINT_BLOCKED).moved.append((viewpoint, moved_to))
        self._todo.remove(self._target)
        self._next_leg()

    def decide(self, clock_s: float) -> tuple[LocalReplan, ...]:
        """Look again whether all is well, and change what is flown where it is not.

        What it looks for is bounded by a `SearchBudget` for the whole of a decision: where nothing better is found
        within it, the vehicle comes to rest, and looks again the next time.

        Args:
            clock_s: now.

        Returns:
            The departures from the plan that are over since the last call.
        """
        self._start(clock_s)
        since_s, self._decided_s = clock_s - self._decided_s, clock_s
        scene = self._around.at(clock_s, self._flown.curve.value(self._flown.at(clock_s)))
        room = standing_room(scene, self._options.safe_m)
        budget = SearchBudget()
        if not self._holding and self.gave_up is None and self._flown.joins_s == math.inf:
            self._come_back(scene, room, budget)
            if self._flown.joins_s == math.inf:
                if self._flown.ended(clock_s):
                    self._stuck_s += since_s
                self._lose_patience(scene, room, budget)
        self._evade(scene, room, budget)
        self._mind_stream_loss(scene, room)
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
        self._waits_at = self.moved_to = None
        self._moves = 0
        self._progress_s, self._stuck_s = self._clock_s, 0.0
        self._begin_leg(self._leg_begin_s + self._leg_length_s)
        if away:
            self._flown = FlownLeg(flown.curve, flown.begun_s, np.zeros(1), np.zeros(1), math.inf)

    def _start(self, clock_s: float) -> None:
        if self._clock_s == -math.inf:
            self._flown.begun_s = self._progress_s = self._decided_s = clock_s
        self._clock_s = max(self._clock_s, clock_s)

    # -- decisions

    def _evade(self, scene: Scene, room: Room, budget: SearchBudget) -> None:
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
                self._options.evasion(scene),
                forbidden=scene.forbidden,
                stay=stay and not flown.ended(clock_s) and flown.joins_s < math.inf,
                room=room,
                budget=budget,
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

    def _mind_stream_loss(self, scene: Scene, room: Room) -> None:
        """Fly slower where the vehicle's own stop would meet what stands; but not into the way of what moves."""
        rule, clock_s, flown = self._options.stream_loss, scene.clock_s, self._flown
        if rule is None or flown.ended(clock_s):
            return
        now_s = flown.at(clock_s)
        rest = part_of_curve(flown.curve, now_s, flown.curve.duration_s)
        near = room.standing_below(rule.keep_m)
        slow = slowed_for_stream_loss(rest, near, rule.loss, self._limits)
        if slow is None:
            return
        moving = Predictions.of(scene.tracks, clock_s, MovingClearance(keep_m=self._options.keep_moving_m))
        if moving.least_margin_m(slow.curve) >= min(moving.least_margin_m(rest), 0.0):
            self._flown = slowed(flown, slow, now_s, clock_s)

    def _come_back(self, scene: Scene, room: Room, budget: SearchBudget) -> None:
        """Look for a way back to the leg once the vehicle stands."""
        clock_s = scene.clock_s
        if not self._flown.ended(clock_s) or clock_s < self._searched_s + SEARCH_EVERY_S:
            return
        self._searched_s = clock_s
        if self.moved_to is not None and room.at(self.moved_to) < self._options.safe_m:
            self._move_view(scene, room, budget)  # it sees more from here than when it chose the place
            if self._flown.joins_s < math.inf:
                return
        place = self._flown.curve.value(self._flown.curve.duration_s)
        options = self._options.evasion(scene)
        leg_s = min(self._flown.on_leg(clock_s), self._leg.duration_s)
        passes = [stop.time_s - self._leg_begin_s for stop in self._todo if not stop.dwell]
        last_s = min([*passes, self._leg.duration_s])
        first_s = self._time_beside(place, leg_s, last_s)
        found = WayBack(self._leg, first_s, last_s, scene, room, self._limits, options, budget).find(place, leg_s)
        if found is None:
            return
        if found.joins_s < math.inf:
            self._leave_out_passed(leg_s, found.leg_at(found.joins_s))
        self._flown = found

    def _time_beside(self, place_m: NDArray[np.float64], leg_s: float, last_s: float) -> float:
        """Time on the leg that is nearest to a place, between two."""
        times = np.linspace(leg_s, last_s, LOOKS)
        return float(times[np.linalg.norm(self._leg.value(times) - place_m, axis=1).argmin()])

    def _lose_patience(self, scene: Scene, room: Room, budget: SearchBudget) -> None:
        """What becomes of the stop, or of the flight, when there is no way for long."""
        away_s, options = scene.clock_s - self._progress_s, self._options
        if self._target is not None and (self._stuck_s > options.wait_s or away_s > options.give_up_s):
            departure = self._departure_now(ReplanReason.VIEWPOINT_BLOCKED)
            self._leave_out_passed(self._flown.on_leg(scene.clock_s), self._leg_length_s)
            if self.moved_to is None:
                self._move_view(scene, room, budget)
                if self.moved_to is not None:
                    self._stuck_s = max(options.wait_s - NEXT_WAIT_S, 0.0)
                    return
            departure.skipped.append(self._target.viewpoint)
            self._todo.remove(self._target)
            self._next_leg()
            if self._target is not None:
                self._stuck_s = max(options.wait_s - NEXT_WAIT_S, 0.0)
        elif self._target is None and (self._stuck_s > options.give_up_s or away_s > MOST_AWAY * options.give_up_s):
            self.gave_up = f"no way on was found in {away_s:.0f} s: the vehicle hovers, take over or order anew"
            self._reports.append(self._departure_now(ReplanReason.HELD).report(None))
            self._departure = None

    def _move_view(self, scene: Scene, room: Room, budget: SearchBudget) -> None:
        """Begin to fly from where it stands to where the picture of the next stop can be taken instead, if it can."""
        stop = self._target
        if stop is None or stop.others is None or self._moves == MOST_MOVES or not self._flown.ended(scene.clock_s):
            return
        place = self._flown.curve.value(self._flown.curve.duration_s)
        options = self._options.evasion(scene)
        found = way_to_moved_view(stop.others, place, scene, room, self._limits, options, budget)
        if found is None:
            return
        self._moves += 1
        self._leg_begin_s, self._leg_length_s = stop.time_s, 0.0
        self.moved_to, self._flown = found
        self._leg = hover(self.moved_to)

    def _take_note(self, clock_s: float) -> None:
        """What has been reached since."""
        flown = self._flown
        if self._departure is not None:
            self._departure.passes(flown.curve.value(flown.at(clock_s)))
        if self._off_leg:
            self._waits_at = None
            return
        if self._departure is not None and not self.away:
            self._reports.append(self._departure.report(flown.begun_s + flown.joins_s))
            self._departure = None
        plan_s = self.plan_time_s
        self._todo = [stop for stop in self._todo if stop.dwell or stop.time_s > plan_s]
        if plan_s > self._furthest_s + PROGRESS_S or flown.ended(clock_s):
            self._furthest_s, self._progress_s, self._stuck_s = plan_s, clock_s, 0.0
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
            self._departure.passes(self._flown.curve.value(self._flown.at(self._clock_s)))
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
