"""When the vehicles of a fleet fly their legs, so that they stay apart: later starts and waits where they stop.

Vehicles are scheduled one after the other, those with the longest flights first; each keeps clear of all before it
("prioritised planning", M. Erdmann and T. Lozano-Perez, Algorithmica 2, 1987). One vehicle's schedule is the earliest
end over all waits at its stops, by a best-first search over stops and times. Distances are looked at in steps here;
that they hold at every moment is proved afterwards (`gcs.planning.flights.separation`).
"""

from __future__ import annotations

import heapq
import itertools
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.errors import InfeasibleError
from gcs.core.trajectory import AngleProfile, PiecewisePolynomial
from gcs.planning.flights.separation import TOLERANCE_M, TimedCurve
from gcs.planning.trajectories.trajectory_builder import BuiltTrajectory

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from gcs.core.progress import Progress

WAIT_S = 1.0
"""Step of waits."""

STEP_S = 0.05
"""Step in which distances are looked at."""

MOST_WAIT_S = 1800.0
"""A vehicle that would wait longer than this in all is not scheduled behind the others."""

MOST_ORDERS = 24


@dataclass(frozen=True, eq=False)
class ScheduledFlight:
    """A flight on the fleet's clock.

    Attributes:
        built: what is flown, waits where it stops included, on its own time from take-off.
        start_s: take-off on the fleet's clock.
    """

    built: BuiltTrajectory
    start_s: float

    @property
    def curve(self) -> TimedCurve:
        """Its curve on the fleet's clock."""
        return TimedCurve(self.built.trajectory, self.start_s)


def with_waits(built: BuiltTrajectory, waits_s: NDArray[np.float64]) -> BuiltTrajectory:
    """A trajectory that rests longer at the viewpoints it stops at, after the pictures.

    Args:
        built: at rest in one piece at each of these R viewpoints.
        waits_s: for each of them, not negative, shape (R,).
    """
    rests = rest_pieces(built)
    durations = built.trajectory.durations_s.copy()
    durations[rests] += waits_s
    leaves = built.trajectory.starts_s[rests + 1]
    waited = np.concatenate([[0.0], np.cumsum(waits_s)])
    knots = built.yaw.times_s + waited[np.searchsorted(leaves - 1e-6, built.yaw.times_s, side="right")]
    return replace(
        built,
        trajectory=PiecewisePolynomial(built.trajectory.coefficients, durations),
        yaw=AngleProfile(knots, built.yaw.angles_rad),
        gimbal_pitch=AngleProfile(knots, built.gimbal_pitch.angles_rad),
        exposures_s=built.exposures_s + waited[np.searchsorted(leaves, built.exposures_s)],
    )


def rest_pieces(built: BuiltTrajectory) -> NDArray[np.int64]:
    """Which pieces of a trajectory are the rests at viewpoints, shape (R,)."""
    return np.searchsorted(built.trajectory.starts_s, built.exposures_s[built.stops], side="right") - 1


def schedule_fleet(
    flights: Sequence[BuiltTrajectory], apart_m: float, names: Sequence[str], progress: Progress
) -> list[ScheduledFlight]:
    """Find starts and waits with which vehicles stay apart.

    Args:
        flights: of each vehicle.
        apart_m: least distance between centres.
        names: of the vehicles, for messages.
        progress: told about the stage `separation`; may cancel.

    Returns:
        The schedule of each vehicle; of the orders of precedence that were tried, the one that ends first.

    Raises:
        InfeasibleError: no schedule was found; two vehicles in each other's way are named.
    """
    longest_first = sorted(range(len(flights)), key=lambda k: -flights[k].trajectory.duration_s)
    free: float = flights[longest_first[0]].trajectory.duration_s
    best: list[ScheduledFlight] | None = None
    blocked = ""
    for order in itertools.islice(itertools.permutations(longest_first), MOST_ORDERS):
        progress.report("separation", 0.0)
        done: dict[int, ScheduledFlight] = {}
        for number in order:
            others = [done[k].curve for k in done]
            found = _Schedule(flights[number], others, apart_m, progress).find()
            if found is None:
                blocked = names[number]
                break
            done[number] = found
        else:
            schedule = [done[k] for k in range(len(flights))]
            if best is None or _end(schedule) < _end(best):
                best = schedule
            if _end(best) <= free + WAIT_S:
                break
    if best is None:
        raise InfeasibleError(
            f"no start and no waits keep {blocked} {apart_m:.1f} m from the others: place the pads further apart, use "
            "fewer vehicles, or ask for less separation",
            field="safety.separation_m",
        )
    return best


def _end(schedule: Sequence[ScheduledFlight]) -> float:
    return max(flight.curve.end_s for flight in schedule)


class _Schedule:
    """Best-first search for one vehicle's waits; a state is a stop (0: the pad) and a time at which it may be left."""

    def __init__(
        self,
        built: BuiltTrajectory,
        others: Sequence[TimedCurve],
        apart_m: float,
        progress: Progress,
    ) -> None:
        self._built = built
        self._others = others
        self._progress = progress
        leaves = built.trajectory.starts_s[rest_pieces(built) + 1]
        self._leaves = np.concatenate([[0.0], leaves, [built.trajectory.duration_s]])
        fastest = max([_fastest(built.trajectory), *(_fastest(other.trajectory) for other in others)])
        # between two looks each of both moves by half a step at most
        self._apart = apart_m + fastest * STEP_S + 2 * TOLERANCE_M

    def find(self) -> ScheduledFlight | None:
        """The schedule that ends first; None when there is none."""
        last = len(self._leaves) - 1
        queue = [(float(self._leaves[-1]), 0, 0.0)]
        came_from: dict[tuple[int, float], tuple[int, float]] = {}
        seen = {(0, 0)}
        while queue:
            _, stop, leave = heapq.heappop(queue)
            self._progress.report("separation", 0.5)
            if stop == last:
                return self._schedule(came_from, stop, leave)
            after = leave + float(self._leaves[stop + 1] - self._leaves[stop])
            stay = leave + WAIT_S
            waited = stay - self._leaves[stop]
            steps = []
            if self._clear(self._leaves[stop], self._leaves[stop + 1], leave) and (
                stop + 1 < last or self._clear(self._leaves[-1], self._leaves[-1] + self._horizon(after), after)
            ):
                steps.append((stop + 1, after))
            if waited <= MOST_WAIT_S and self._clear(self._leaves[stop], None, leave):
                steps.append((stop, stay))
            for next_stop, time in steps:
                key = (next_stop, round((time - self._leaves[next_stop]) / WAIT_S))
                if key not in seen:
                    seen.add(key)
                    came_from[next_stop, time] = (stop, leave)
                    heapq.heappush(queue, (time + float(self._leaves[-1] - self._leaves[next_stop]), next_stop, time))
        return None

    def _horizon(self, after: float) -> float:
        """How long the others still fly."""
        return max([0.0, *(other.end_s - after for other in self._others)])

    def _clear(self, begin_s: float, end_s: float | None, at_s: float) -> bool:
        """Whether flying a part of the own time (None: resting for a wait at its begin) from a time on is clear."""
        span = WAIT_S if end_s is None else end_s - begin_s
        if not self._others or span <= 0:
            return True
        offsets = np.linspace(0.0, span, int(np.ceil(span / STEP_S)) + 1)
        own = self._built.trajectory.value(begin_s + (0.0 if end_s is None else 1.0) * offsets)
        return all(
            bool(np.linalg.norm(own - other.position(at_s + offsets), axis=1).min() >= self._apart)
            for other in self._others
        )

    def _schedule(
        self, came_from: dict[tuple[int, float], tuple[int, float]], stop: int, leave: float
    ) -> ScheduledFlight:
        waits = np.zeros(len(self._leaves) - 1)
        state = (stop, leave)
        while state in came_from:
            before = came_from[state]
            if before[0] == state[0]:
                waits[state[0]] += state[1] - before[1]
            state = before
        return ScheduledFlight(with_waits(self._built, waits[1:]), float(waits[0]))


def _fastest(trajectory: PiecewisePolynomial) -> float:
    times = np.arange(0.0, trajectory.duration_s, STEP_S)
    return float(np.linalg.norm(trajectory.value(times, 1), axis=1).max(initial=0.0)) * 1.05
