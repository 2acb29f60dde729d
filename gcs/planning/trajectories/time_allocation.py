"""Segment times: how long each piece of a leg takes, so that the limits hold on the curve's true extrema.

The times first follow a profile along the leg that keeps the acceleration limit on the straights and slows for corners
as far as the corridor lets them be rounded; the profile is then averaged over a window of time, because snap is finite.
The minimum-snap curve for these times exceeds the limits somewhere or stays under them everywhere. A curve keeps its
shape when all its times are multiplied by the same factor, so one factor a leg brings its worst extremum exactly to its
limit. A few window lengths and a few rounds of moving time between the segments are tried, and the quickest is kept.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gcs.planning.numerics.bernstein import derivative, monomial_from_control, squared_norm
from gcs.planning.numerics.qp_solver import SolverError
from gcs.planning.trajectories.minimum_snap import solve_legs
from gcs.planning.trajectories.straight_moves import straight_moves, straight_times

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from gcs.core.progress import Progress
    from gcs.planning.numerics.qp_solver import QpSolver
    from gcs.planning.trajectories.safe_corridor import LegCorridor

LIMIT_MARGIN = 0.001
"""Share of each limit that is left unused."""

WINDOWS = (0.3, 0.6)
"""Tried lengths of the averaging window, as shares of the time from rest to full speed."""

REBALANCINGS = 2
"""Rounds of moving time from the segments with room to those at a limit."""

_PROFILE_SAMPLES = 400

_SHORTEST_SHARE = 0.03
"""Segments get at least this share of the leg's mean segment time."""


@dataclass(frozen=True)
class FlightLimits:
    """What the motion may reach: norms over the three axes.

    Attributes:
        speed_m_s: largest speed.
        acceleration_m_s2: largest acceleration.
        jerk_m_s3: largest jerk; None for no limit.
    """

    speed_m_s: float
    acceleration_m_s2: float
    jerk_m_s3: float | None = None

    def stretch(self, peaks: NDArray[np.float64]) -> NDArray[np.float64]:
        """Factor on all times that brings peaks of speed, acceleration and jerk to their limits.

        Args:
            peaks: shape (..., 3).

        Returns:
            Shape (...): the largest of the three factors.
        """
        jerk = math.inf if self.jerk_m_s3 is None else self.jerk_m_s3
        limits = np.array([self.speed_m_s, self.acceleration_m_s2, jerk]) * (1 - LIMIT_MARGIN)
        factor: NDArray[np.float64] = ((peaks / limits) ** (1.0 / np.array([1.0, 2.0, 3.0]))).max(axis=-1)
        return factor


@dataclass(frozen=True, eq=False)
class TimedLeg:
    """A leg's curve.

    Attributes:
        control: control points of the pieces, scene ENU m, shape (n, 8, 3).
        durations_s: of the pieces, shape (n,).
    """

    control: NDArray[np.float64]
    durations_s: NDArray[np.float64]


def peaks(control: NDArray[np.float64], durations_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """True largest speed (m/s), acceleration (m/s^2) and jerk (m/s^3) over a curve, shape (3,).

    The extrema of `|p^(k)|^2` inside a piece are at the real roots of its derivative; only pieces whose Bernstein bound
    exceeds what samples show anywhere are looked into.

    Args:
        control: shape (n, 8, 3).
        durations_s: shape (n,).
    """
    return np.array([_peak(control, durations_s, order) for order in (1, 2, 3)])


def segment_peaks(control: NDArray[np.float64], durations_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Sampled largest speed, acceleration and jerk of each piece, shape (n, 3); a little under the true ones."""
    power = np.linspace(0.0, 1.0, 13)[:, None] ** np.arange(8)
    columns = []
    for order in (1, 2, 3):
        monomial = monomial_from_control(derivative(control, order))
        value = np.einsum("mk,skd->smd", power[:, : monomial.shape[1]], monomial)
        columns.append(np.linalg.norm(value, axis=2).max(axis=1) / durations_s**order)
    return np.stack(columns, axis=1)


def _peak(control: NDArray[np.float64], durations_s: NDArray[np.float64], order: int) -> float:
    pieces = derivative(control, order) / durations_s[:, None, None] ** order
    square = squared_norm(pieces)
    best = float(np.maximum(square[:, 0], square[:, -1]).max())
    middle = np.linalg.norm(monomial_from_control(pieces).transpose(0, 2, 1) @ 0.5 ** np.arange(8 - order), axis=1)
    best = max(best, float(middle.max()) ** 2)
    for index in np.argsort(-square.max(axis=1)):
        if square[index].max() <= best:
            break
        monomial = np.polynomial.Polynomial(monomial_from_control(square[index][:, None])[:, 0])
        roots = monomial.deriv().roots()
        inside = roots.real[(np.abs(roots.imag) < 1e-6) & (roots.real > 0) & (roots.real < 1)]
        if len(inside):
            best = max(best, float(monomial(inside).max()))
    return math.sqrt(best)


def initial_times(leg: LegCorridor, limits: FlightLimits, window_s: float) -> NDArray[np.float64]:
    """Segment times (s, shape (n,)) from a profile of speed along the leg.

    Args:
        leg: the corridor.
        limits: kept by the profile on straights.
        window_s: the profile is averaged four times over a quarter of this.
    """
    speeds = _joint_speeds(leg, limits)
    lengths = leg.lengths_m
    joints = np.concatenate([[0.0], np.cumsum(lengths)])
    way = (1 - np.cos(np.linspace(0.0, np.pi, _PROFILE_SAMPLES))) / 2 * joints[-1]
    segment = np.clip(np.searchsorted(joints, way, side="right") - 1, 0, len(lengths) - 1)
    gain = 2 * limits.acceleration_m_s2
    speed = np.sqrt(
        np.minimum(
            speeds[segment] ** 2 + gain * np.maximum(way - joints[segment], 0),
            speeds[segment + 1] ** 2 + gain * np.maximum(joints[segment + 1] - way, 0),
        )
    ).clip(max=limits.speed_m_s)
    times = np.concatenate([[0.0], np.cumsum(2 * np.diff(way) / np.maximum(speed[1:] + speed[:-1], 1e-9))])
    grid = np.linspace(0.0, times[-1] + window_s, _PROFILE_SAMPLES)
    averaged = np.interp(grid, times, speed, right=0.0)
    width = max(1, round(window_s / 4 / grid[1]))
    for _ in range(4):
        total = np.concatenate([[0.0], np.cumsum(averaged)])
        index = np.arange(1, len(total))
        averaged = (total[index] - total[np.maximum(index - width, 0)]) / width
    flown = np.concatenate([[0.0], np.cumsum((averaged[1:] + averaged[:-1]) / 2)])
    at_joints = np.interp(joints, flown * joints[-1] / flown[-1], grid)
    at_joints[0], at_joints[-1] = 0.0, grid[-1]
    return np.asarray(np.maximum(np.diff(at_joints), _SHORTEST_SHARE * grid[-1] / len(lengths)))


def _joint_speeds(leg: LegCorridor, limits: FlightLimits) -> NDArray[np.float64]:
    """Speeds at the joints that corners and the acceleration limit allow, shape (n + 1,); at rest at both ends.

    A turn by the angle theta that may leave its corner by m can be flown on a radius `m / (1 / cos(theta / 2) - 1)`.
    """
    lengths = leg.lengths_m
    directions = np.diff(leg.joints_m, axis=0) / lengths[:, None]
    inner = leg.joints_m[1:-1]
    low = np.maximum(leg.boxes_m[:-1, 0], leg.boxes_m[1:, 0])
    high = np.minimum(leg.boxes_m[:-1, 1], leg.boxes_m[1:, 1])
    margin = np.minimum(inner - low, high - inner).min(axis=1)
    turn = np.arccos(np.clip((directions[1:] * directions[:-1]).sum(axis=1), -1.0, 1.0))
    half = np.cos(turn / 2)
    radius = margin * half / np.maximum(1 - half, 1e-9)
    corner = np.minimum(limits.speed_m_s, np.sqrt(limits.acceleration_m_s2 * radius))
    speeds = np.concatenate([[0.0], corner, [0.0]])
    gain = 2 * limits.acceleration_m_s2
    for k in range(1, len(speeds)):
        speeds[k] = min(speeds[k], math.sqrt(speeds[k - 1] ** 2 + gain * lengths[k - 1]))
    for k in range(len(speeds) - 2, -1, -1):
        speeds[k] = min(speeds[k], math.sqrt(speeds[k + 1] ** 2 + gain * lengths[k]))
    return speeds


def fit_limits(control: NDArray[np.float64], durations_s: NDArray[np.float64], limits: FlightLimits) -> TimedLeg:
    """The same curve with all times scaled so that its worst extremum is at its limit (less the margin)."""
    return TimedLeg(control, durations_s * float(limits.stretch(peaks(control, durations_s))))


def time_legs(
    legs: Sequence[LegCorridor], limits: FlightLimits, solvers: Sequence[QpSolver], progress: Progress
) -> list[TimedLeg]:
    """Minimum-snap curves through the corridors, from rest to rest, as quick as was found within the limits.

    Args:
        legs: corridors from stop to stop.
        limits: hold on the whole of every curve.
        solvers: for the quadratic programs, in order of trial.
        progress: reports the stage `trajectory`.

    Where no solver finds a curve, or none that is quicker, a leg is flown by straight moves.

    Raises:
        OperationCancelled: the progress said so.
    """
    ramp = limits.speed_m_s / limits.acceleration_m_s2
    least = 0.0 if limits.jerk_m_s3 is None else 2 * limits.acceleration_m_s2 / limits.jerk_m_s3
    windows = [max(share * ramp, least) for share in WINDOWS]
    best: dict[int, TimedLeg] = {}
    latest: dict[int, TimedLeg] = {}
    rounds = len(windows) + REBALANCINGS
    for turn in range(rounds):
        progress.report("trajectory", turn / rounds)
        if turn < len(windows):
            durations = {k: initial_times(leg, limits, windows[turn]) for k, leg in enumerate(legs)}
        else:
            durations = {k: _rebalanced(leg, limits) for k, leg in latest.items()}
        progress.report("trajectory", (turn + 0.2) / rounds)
        curves = solve_legs([legs[k] for k in durations], list(durations.values()), solvers)
        for (k, times), control in zip(durations.items(), curves, strict=True):
            if isinstance(control, SolverError):
                continue  # other times may do
            latest[k] = _roughly_fit(control, times, limits)
            best[k] = min(best.get(k, latest[k]), latest[k], key=_total)
        if turn == len(windows) - 1:
            latest = best.copy()
    return [_finished(leg, best.get(k), limits) for k, leg in enumerate(legs)]


def _finished(leg: LegCorridor, found: TimedLeg | None, limits: FlightLimits) -> TimedLeg:
    straight = straight_times(leg, limits.stretch)
    if found is None or straight.sum() < _total(found):
        return TimedLeg(*straight_moves(leg, straight))
    return fit_limits(found.control, found.durations_s, limits)


def _total(leg: TimedLeg) -> float:
    return float(leg.durations_s.sum())


def _roughly_fit(control: NDArray[np.float64], durations_s: NDArray[np.float64], limits: FlightLimits) -> TimedLeg:
    return TimedLeg(control, durations_s * limits.stretch(segment_peaks(control, durations_s)).max())


def _rebalanced(leg: TimedLeg, limits: FlightLimits) -> NDArray[np.float64]:
    """Segment times with less for those that have room."""
    use = limits.stretch(segment_peaks(leg.control, leg.durations_s))
    result: NDArray[np.float64] = leg.durations_s * np.sqrt(np.maximum(use / use.max(), 0.3))
    return result
