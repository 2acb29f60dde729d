"""Segment times: how long each piece of a leg takes, so that the limits hold on the curve's true extrema.

The times first follow a profile along the leg that keeps the acceleration limit on the straights and slows for corners
as far as the corridor lets them be rounded; the profile is then averaged over a window of time, because snap is finite.
The minimum-snap curve for these times exceeds the limits somewhere or stays under them everywhere. A curve keeps its
shape when all its times are multiplied by the same factor, so one factor a leg brings its worst extremum exactly to its
limit.

Most of such a leg then has room left. So time is taken, over and over, from where there is room, in proportion to a
power of the use of the limits averaged over a while; the quickest curve on the way is kept. It is a descent without a
guarantee, so it is made twice, with a wide and with a narrow average, both from the same outset.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from gcs.planning.numerics.chain_qp import ChainSolver
from gcs.planning.numerics.compiled import compiled
from gcs.planning.numerics.qp_solver import SolverError
from gcs.planning.trajectories.corridor_checks import check_corridors
from gcs.planning.trajectories.flight_limits import FlightLimits
from gcs.planning.trajectories.minimum_snap import solve_legs
from gcs.planning.trajectories.speed_profile import initial_times
from gcs.planning.trajectories.straight_moves import straight_moves, straight_times

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from gcs.core.progress import Progress
    from gcs.planning.numerics.qp_solver import QpSolver
    from gcs.planning.trajectories.passing import Passing
    from gcs.planning.trajectories.safe_corridor import LegCorridor

__all__ = ["FlightLimits", "TimedLeg", "fit_limits", "time_legs"]

WINDOWS = (0.3, 0.6)
"""Tried lengths of the averaging window, as shares of the time from rest to full speed."""

DESCENTS = ((0.7, 0.5), (1.0, 0.2))
"""Power of the use, and width of its average as a share of the time from rest to full speed, of each descent."""

SNAP_TOLERANCE = 1e-4
"""How far, as a share, a curve's snap may be above the least one: the time is what is searched for."""

LONG = 30
"""Legs of this many pieces or more are searched with more patience and for smaller gains."""

PATIENCE, LONG_PATIENCE = 2, 3
"""A descent ends after this many rounds without a gain."""

GAIN, LONG_GAIN = 0.01, 0.003
"""Least share of its time that a leg must gain for a round to count."""

ROUNDS = 30
"""Most rounds of both descents together."""

LEAST_USE = 0.5
"""No segment's use counts as less than this share of the leg's largest."""

_AVERAGE_POWER = 8
"""The average leans towards the largest use: it is that of this power."""

_FAR = 4.0
"""Widths beyond which nothing is averaged."""

Floats = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Ints = np.ndarray[tuple[int, ...], np.dtype[np.int64]]


@dataclass(frozen=True, eq=False)
class TimedLeg:
    """A leg's curve.

    Attributes:
        control: control points of the pieces, scene ENU m, shape (n, 8, 3).
        durations_s: of the pieces, shape (n,).
    """

    control: NDArray[np.float64]
    durations_s: NDArray[np.float64]

    @cached_property
    def total_s(self) -> float:
        """Duration of the whole leg."""
        return float(self.durations_s.sum())


def fit_limits(control: NDArray[np.float64], durations_s: NDArray[np.float64], limits: FlightLimits) -> TimedLeg:
    """The same curve with all times scaled so that its worst extremum is at its limit (less the margin)."""
    return _fit_all([TimedLeg(control, durations_s)], limits, [None])[0]


def _fit_all(legs: Sequence[TimedLeg], limits: FlightLimits, passings: Sequence[Passing | None]) -> list[TimedLeg]:
    if not legs:
        return []
    first = _first(legs)
    control, durations = _stacked(legs)
    factors = np.maximum(
        limits.stretch(limits.worst_peaks(first, control, durations)), _passing_factors(legs, passings)
    )
    return [TimedLeg(leg.control, leg.durations_s * factor) for leg, factor in zip(legs, factors, strict=True)]


def _passing_factors(legs: Sequence[TimedLeg], passings: Sequence[Passing | None]) -> NDArray[np.float64]:
    """Factor on all times of each leg that the places it passes ask for, shape (L,); 0 where it passes none."""
    pairs = zip(legs, passings, strict=True)
    return np.array([0.0 if asked is None else asked.stretch(leg.control, leg.durations_s) for leg, asked in pairs])


def _use(legs: Sequence[TimedLeg], limits: FlightLimits, passings: Sequence[Passing | None]) -> NDArray[np.float64]:
    """Factor on the time of each piece of the legs that is asked for, shape (S,); above 1 is too quick."""
    use = limits.use(*_stacked(legs))
    for begin, leg, passing in zip(_first(legs), legs, passings, strict=False):
        if passing is not None:
            part = use[begin : begin + len(leg.durations_s)]
            np.maximum(part, passing.use(leg.durations_s), out=part)
    return use


def _first(legs: Sequence[TimedLeg]) -> NDArray[np.int64]:
    return np.concatenate([[0], np.cumsum([len(leg.durations_s) for leg in legs])])


def _stacked(legs: Sequence[TimedLeg]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    return np.concatenate([leg.control for leg in legs]), np.concatenate([leg.durations_s for leg in legs])


@dataclass(eq=False)
class _Search:
    """One leg's search for short times.

    Attributes:
        latest: the last curve, its times roughly at the limits.
        best: the quickest so far.
        outset: where every descent starts.
        descent: which descent it is in.
        mark_s: time that the next gain is measured from.
        waited: rounds of this descent without a gain.
    """

    latest: TimedLeg
    best: TimedLeg
    outset: TimedLeg
    descent: int = 0
    mark_s: float = 0.0
    waited: int = 0

    @property
    def is_over(self) -> bool:
        """Whether all descents are done; a single piece has only one time, and that is at the limits."""
        return self.descent == len(DESCENTS) or len(self.best.durations_s) == 1

    def take(self, found: TimedLeg | None) -> None:
        """Go on from a curve, or to the next descent when none was found or none that gains."""
        is_long = len(self.best.durations_s) >= LONG
        if found is not None:
            self.latest = found
            self.best = min(self.best, found, key=lambda leg: leg.total_s)
            gained = found.total_s < (1 - (LONG_GAIN if is_long else GAIN)) * self.mark_s
            self.mark_s = found.total_s if gained else self.mark_s
            self.waited = 0 if gained else self.waited + 1
        if found is None or self.waited == (LONG_PATIENCE if is_long else PATIENCE):
            self.latest, self.mark_s, self.waited = self.outset, self.outset.total_s, 0
            self.descent += 1


def time_legs(
    legs: Sequence[LegCorridor],
    limits: FlightLimits,
    solvers: Sequence[QpSolver | ChainSolver],
    progress: Progress,
) -> list[TimedLeg]:
    """Minimum-snap curves through the corridors, from rest to rest, as quick as was found within the limits.

    Where no solver finds a curve, or none that is quicker, a leg is flown by straight moves.

    Args:
        legs: corridors from stop to stop.
        limits: hold on the whole of every curve.
        solvers: for the quadratic programs, in order of trial.
        progress: reports the stage `trajectory`.

    Raises:
        InputError: limits that cannot be met; a corridor with a number that is not finite or a segment without length,
            by leg and segment.
        InfeasibleError: a corridor that no curve can be in; it names leg and segment.
        OperationCancelled: the progress said so.
    """
    limits.check()
    check_corridors(legs)
    solvers = [s.coarser(SNAP_TOLERANCE) if isinstance(s, ChainSolver) else s for s in solvers]
    rounds = len(WINDOWS) + ROUNDS
    outsets: dict[int, TimedLeg] = {}
    for turn, window in enumerate(_windows(limits)):
        progress.report("trajectory", turn / rounds)
        times = {k: initial_times(leg, limits, window) for k, leg in enumerate(legs)}
        progress.report("trajectory", (turn + 0.5) / rounds)
        for k, found in _solve(legs, times, limits, solvers).items():
            if found is not None:
                outsets[k] = min(outsets.get(k, found), found, key=lambda leg: leg.total_s)
    searches = {k: _Search(leg, leg, leg, mark_s=leg.total_s) for k, leg in outsets.items()}
    for turn in range(ROUNDS):
        open_ = {k: search for k, search in searches.items() if not search.is_over}
        if not open_:
            break
        progress.report("trajectory", (len(WINDOWS) + turn) / rounds)
        for k, found in _solve(legs, _shorter_times(legs, open_, limits), limits, solvers).items():
            open_[k].take(found)
    return _finished(legs, {k: search.best for k, search in searches.items()}, limits)


def _windows(limits: FlightLimits) -> list[float]:
    """Lengths of the averaging windows (s); the longer one leaves the jerk its time to turn the acceleration round."""
    short, long = (share * limits.speed_m_s / limits.acceleration_m_s2 for share in WINDOWS)
    turn = 0.0 if limits.jerk_m_s3 is None else 2 * limits.acceleration_m_s2 / limits.jerk_m_s3
    return [short, max(long, turn)]


def _solve(
    legs: Sequence[LegCorridor],
    times: dict[int, NDArray[np.float64]],
    limits: FlightLimits,
    solvers: Sequence[QpSolver | ChainSolver],
) -> dict[int, TimedLeg | None]:
    """Curves for these times, stretched so that samples keep the limits; None where there is no curve."""
    curves = solve_legs([legs[k] for k in times], list(times.values()), solvers)
    found = {
        k: TimedLeg(control, durations)
        for (k, durations), control in zip(times.items(), curves, strict=True)
        if not isinstance(control, SolverError)
    }
    if not found:
        return dict.fromkeys(times)
    timed, passings = list(found.values()), [legs[k].passing for k in found]
    factors = np.maximum.reduceat(_use(timed, limits, passings), _first(timed)[:-1])
    factors = np.maximum(factors, _passing_factors(timed, passings))
    fitted = {
        k: TimedLeg(leg.control, leg.durations_s * factor)
        for (k, leg), factor in zip(found.items(), factors, strict=True)
    }
    return {k: fitted.get(k) for k in times}


def _shorter_times(
    legs: Sequence[LegCorridor], searches: dict[int, _Search], limits: FlightLimits
) -> dict[int, NDArray[np.float64]]:
    """Segment times with less for those that have room."""
    latest = [search.latest for search in searches.values()]
    first = _first(latest)
    _, durations = _stacked(latest)
    use = _use(latest, limits, [legs[k].passing for k in searches])
    settings = np.array([DESCENTS[search.descent] for search in searches.values()])
    widths = settings[:, 1] * limits.speed_m_s / limits.acceleration_m_s2
    average = _averaged_use(first, durations, use, widths)
    counts = np.diff(first)
    largest = np.maximum.reduceat(average, first[:-1])
    # Where a place is to be passed slowly, all of a curve may have room.
    largest[[legs[k].passing is not None for k in searches]] = 1.0
    largest = np.repeat(largest, counts)
    share = np.maximum(average / largest, LEAST_USE) ** np.repeat(settings[:, 0], counts)
    return dict(zip(searches, np.split(durations * share, first[1:-1]), strict=True))


@compiled
def _averaged_use(first: Ints, durations: Floats, use: Floats, widths: Floats) -> Floats:
    """Power mean of the use about the middle of each segment, with Gaussian weights in time; shape (S,)."""
    result = np.empty(len(use))
    middles = np.empty(len(use))
    for leg in range(len(first) - 1):
        begin, end, time = first[leg], first[leg + 1], 0.0
        for k in range(begin, end):
            middles[k] = time + durations[k] / 2
            time += durations[k]
        near = begin
        for k in range(begin, end):
            total = weight = 0.0
            while middles[k] - middles[near] > _FAR * widths[leg]:
                near += 1
            for other in range(near, end):
                away = (middles[other] - middles[k]) / widths[leg]
                if away > _FAR:
                    break
                w = durations[other] * np.exp(-0.5 * away * away)
                weight += w
                total += w * use[other] ** _AVERAGE_POWER
            result[k] = (total / weight) ** (1.0 / _AVERAGE_POWER)
    return result


def _finished(legs: Sequence[LegCorridor], found: dict[int, TimedLeg], limits: FlightLimits) -> list[TimedLeg]:
    """The quicker of the curve found and straight moves, at the limits on their true extrema.

    Straight moves rest at every corner: where places are passed they only stand in for a curve that was not found.
    """
    result: list[TimedLeg] = []
    for k, leg in enumerate(legs):
        straight = straight_times(leg, limits)
        quicker = k not in found or (leg.passing is None and straight.sum() < found[k].total_s)
        result.append(TimedLeg(*straight_moves(leg, straight)) if quicker else found[k])
    return _fit_all(result, limits, [leg.passing for leg in legs])
