"""Which viewpoints are flown through: those that may be, as far as it takes less time than to stop there.

A vehicle that flies through saves the standstill, but it has to slow down as far as the camera asks, and to take long
enough on its way for yaw, gimbal and camera. So all viewpoints that may be flown through are tried at once. Then a stop
is tried at one end of each leg that took longer than with a stop at both, and what is between two stops is flown anew;
it stays where it gains.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gcs.planning.trajectories.passing import Passing
from gcs.planning.trajectories.safe_corridor import joined_corridor
from gcs.planning.trajectories.time_allocation import TimedLeg, time_legs
from gcs.planning.views.viewing_angles import least_leg_times_s, schedule_views

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from gcs.core.progress import Progress
    from gcs.planning.numerics.chain_qp import ChainSolver
    from gcs.planning.numerics.qp_solver import QpSolver
    from gcs.planning.trajectories.flight_limits import FlightLimits
    from gcs.planning.trajectories.safe_corridor import LegCorridor
    from gcs.planning.views.viewing_angles import ViewingRates

ROUNDS = 8
"""How often more stops are tried at most."""


@dataclass(frozen=True, eq=False)
class Views:
    """What is photographed on a tour, in visiting order.

    Attributes:
        yaw_rad: vehicle yaw, shape (V,).
        gimbal_pitch_rad: camera pitch, shape (V,).
        passing_speeds_m_s: how fast each picture may be taken in flight; 0 where the vehicle has to stop, shape (V,).
        holds_s: how long the vehicle is asked to stand there at least; 0 where it is not, shape (V,).
    """

    yaw_rad: NDArray[np.float64]
    gimbal_pitch_rad: NDArray[np.float64]
    passing_speeds_m_s: NDArray[np.float64]
    holds_s: NDArray[np.float64]


def fly_through(
    corridors: Sequence[LegCorridor | None],
    stopping: Sequence[TimedLeg | None],
    views: Views,
    rates: ViewingRates,
    limits: FlightLimits,
    solvers: Sequence[QpSolver | ChainSolver],
    progress: Progress,
) -> tuple[list[TimedLeg | None], NDArray[np.bool_]]:
    """Fly a tour with as few stops as save time.

    Args:
        corridors: of the legs, home to the first viewpoint, ..., the last one to home; None for a leg without length.
        stopping: the same legs flown from rest to rest.
        views: what is photographed.
        rates: how fast views may follow each other.
        limits: of the vehicle.
        solvers: as of `time_legs`.
        progress: reports the stage `trajectory`.

    Returns:
        The legs as they are flown, and at which viewpoints the vehicle stops, shape (V,).

    Raises:
        OperationCancelled: the progress said so.
    """
    known: dict[tuple[int, int], list[TimedLeg]] = {}

    def times_s(stops: NDArray[np.bool_]) -> NDArray[np.float64]:
        """Time of each leg and of the dwell at its end, shape (V + 1,)."""
        runs = _runs(stops)
        least = least_leg_times_s(views.yaw_rad, views.gimbal_pitch_rad, stops, rates)
        new = [run for run in runs if run not in known]
        chains = [_chain(corridors[a:b], views.passing_speeds_m_s[a : b - 1], least[a:b]) for a, b in new]
        flown = time_legs(chains, limits, solvers, progress) if new else []
        known.update((run, _split(leg, chain)) for run, leg, chain in zip(new, flown, chains, strict=True))
        flights = np.array([0.0 if leg is None else leg.total_s for leg in _legs(stopping, runs, known)])
        schedule = schedule_views(
            flights, views.yaw_rad, views.gimbal_pitch_rad, rates, stops=stops, holds_s=views.holds_s
        )
        return np.asarray(flights + np.append(schedule.dwells_s, 0.0))

    still = np.array([corridor is None for corridor in corridors])
    stops = (views.passing_speeds_m_s <= 0) | still[:-1] | still[1:]
    most, times = times_s(np.ones_like(stops)), times_s(stops)
    for _ in range(ROUNDS):
        tried = _with_more_stops(stops, most - times)
        gains = times - times_s(tried)
        better = [(a, b) for a, b in _runs(stops) if gains[a:b].sum() > 0]
        if not better:
            break
        for a, b in better:
            stops[a : b - 1] = tried[a : b - 1]
        times = times_s(stops)
    for a, b in _runs(stops):
        if times[a:b].sum() >= most[a:b].sum():
            stops[a : b - 1] = True
    return _legs(stopping, _runs(stops), known), stops


def _with_more_stops(stops: NDArray[np.bool_], saved_s: NDArray[np.float64]) -> NDArray[np.bool_]:
    """A stop more at an end of each leg that loses more time than the stop would cost on its other side.

    That is taken to be half of what is saved there, as each of its ends has its share in that. A way that loses time as
    a whole has some place that no good curve was found through: it is halved.
    """
    before, after = saved_s[:-1], saved_s[1:]
    more = stops | (before + after / 2 < 0) | (after + before / 2 < 0)
    for a, b in _runs(stops):
        if saved_s[a:b].sum() < 0:
            more[a : b - 1] = np.arange(a, b - 1) == (a + b - 1) // 2
    return more


def _runs(stops: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First leg, and the leg after the last, of each way between two stops on which something is flown through."""
    ends = [0, *(np.flatnonzero(stops) + 1).tolist(), len(stops) + 1]
    return [(a, b) for a, b in itertools.pairwise(ends) if b - a > 1]


def _chain(
    corridors: Sequence[LegCorridor | None], speeds_m_s: NDArray[np.float64], least_s: NDArray[np.float64]
) -> LegCorridor:
    """Legs as one."""
    legs = [corridor for corridor in corridors if corridor is not None]
    joints = np.cumsum([len(leg.boxes_m) for leg in legs])[:-1]
    return joined_corridor(legs, Passing(joints, speeds_m_s, least_s))


def _split(flown: TimedLeg, chain: LegCorridor) -> list[TimedLeg]:
    assert chain.passing is not None
    joints = chain.passing.joints
    parts = zip(np.split(flown.control, joints), np.split(flown.durations_s, joints), strict=True)
    return [TimedLeg(control, durations) for control, durations in parts]


def _legs(
    stopping: Sequence[TimedLeg | None],
    runs: Sequence[tuple[int, int]],
    known: dict[tuple[int, int], list[TimedLeg]],
) -> list[TimedLeg | None]:
    legs = list(stopping)
    for a, b in runs:
        legs[a:b] = known[a, b]
    return legs
