"""Least-snap curves through the corners of a leg, with nothing between them that holds the curve to the leg.

`plain` goes through the path's corners as they are, `corrected` through two points in the place of each (gantry-crane
paper), `geometric` through four (yard paper). The times are those of least snap, stretched until the vehicle's limits
hold. How far such a curve swings out is not bounded beforehand: certificates judge it afterwards.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from gcs.core.errors import InfeasibleError, InputError
from gcs.planning.numerics.bernstein import control_from_monomial
from gcs.planning.trajectories.corner_cutting import cut_corners
from gcs.planning.trajectories.geometric_corner import four_turn_corners
from gcs.planning.trajectories.optimal_times import times_at_limits
from gcs.planning.trajectories.unconstrained_minimum_snap import Spline

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from gcs.core.progress import Progress
    from gcs.planning.scene.free_space import FreeSpace
    from gcs.planning.trajectories.flight_limits import FlightLimits

WaypointVariant = Literal["plain", "corrected", "geometric"]

LONGEST_S = 86_400.0
"""Limits that make a leg last longer than this cannot be meant."""

VERTICAL_M = 1e-6
"""A straight is a vertical column when it moves aside by less."""


@dataclass(frozen=True)
class LegEnds:
    """Which ends of a leg stand on the ground at home, where take-off and landing are vertical."""

    column_at_start: bool = False
    column_at_end: bool = False


def waypoint_curves(
    variant: WaypointVariant,
    legs_m: Sequence[NDArray[np.float64]],
    ends: Sequence[LegEnds],
    limits: FlightLimits,
    max_deviation_m: float,
    progress: Progress,
    space: FreeSpace | None = None,
    passed: Sequence[NDArray[np.bool_]] | None = None,
) -> list[Spline]:
    """The curve of every leg, from rest to rest.

    The vertical columns over home are moves of their own, at rest at the top: a curve through that corner would swing
    aside next to the ground.

    Args:
        variant: which points the curve goes through.
        legs_m: polylines (K, 3), K >= 2; their ends are visited exactly.
        ends: of each leg.
        limits: hold on the true extrema.
        max_deviation_m: how far the points of `corrected` and `geometric` may pass a corner.
        progress: reports the stage `trajectory`.
        space: the straights between the new points keep its clearance. Without it the legs keep `max_deviation_m`
            besides.
        passed: which points of each leg have to be visited exactly without a stop, shape (K,) each; none but the ends
            when not given.

    Raises:
        InputError: a leg has fewer than two points, a repeated point or a number that is not finite, or a limit is not
            positive; it names the stops or the limit.
        InfeasibleError: the limits cannot be met in less than `LONGEST_S`.
        OperationCancelled: the progress said so.
    """
    limits.check()
    curves = []
    marks = passed or [np.zeros(len(leg), dtype=np.bool_) for leg in legs_m]
    for number, (leg, end, visited) in enumerate(zip(legs_m, ends, marks, strict=True)):
        share = _LegProgress(progress, number, len(legs_m))
        try:
            points = [waypoints(variant, leg[p], visited[p], max_deviation_m, space) for p in _parts(leg, end)]
            curves.append(_joined([_at_limits(part, limits, share) for part in points]))
        except (InputError, InfeasibleError) as error:
            raise type(error)(f"between stops {number} and {number + 1}: {error.message}", field=error.field) from error
    progress.report("trajectory", 1.0)
    return curves


def waypoints(
    variant: WaypointVariant,
    leg_m: NDArray[np.float64],
    passed: NDArray[np.bool_],
    max_deviation_m: float,
    space: FreeSpace | None = None,
) -> NDArray[np.float64]:
    """The points that a leg's curve goes through, shape (M, 3); the ends are those of the leg.

    Args:
        variant: which.
        leg_m: polyline (K, 3).
        passed: which of its points are never cut away, shape (K,); the ends never are.
        max_deviation_m: how far the new points may pass a corner.
        space: as of `waypoint_curves`.

    Raises:
        InputError: as of `cut_corners`.
    """
    if variant == "plain":
        return leg_m
    replace = cut_corners if variant == "corrected" else four_turn_corners
    free = _anywhere if space is None else space.segment_free
    return replace(leg_m, passed, max_deviation_m, free).points_m


def _anywhere(_a: NDArray[np.float64], _b: NDArray[np.float64]) -> bool:
    return True


def hull_boxes(coefficients: NDArray[np.float64]) -> NDArray[np.float64]:
    """The boxes that hold the control points, and so the curve, of each piece.

    Args:
        coefficients: of `u**k` on [0, 1], shape (n, 8, 3).

    Returns:
        Low and high corners, shape (n, 2, 3).
    """
    control = control_from_monomial(coefficients)
    return np.stack([control.min(axis=1), control.max(axis=1)], axis=1)


@dataclass(frozen=True)
class _LegProgress:
    """Tells how far all legs are when one of several is worked on."""

    whole: Progress
    number: int
    count: int

    def report(self, stage: str, fraction: float) -> None:
        self.whole.report(stage, (self.number + fraction) / self.count)


def _parts(leg_m: NDArray[np.float64], ends: LegEnds) -> list[slice]:
    """The leg's points cut at the tops of its columns over home."""
    last = len(leg_m) - 1
    if np.ndim(leg_m) != 2 or last < 2:
        return [slice(None)]  # too short to be cut, or refused by what takes it
    cuts = {0, last}
    if ends.column_at_start and _is_vertical(leg_m[0], leg_m[1]):
        cuts.add(1)
    if ends.column_at_end and _is_vertical(leg_m[last - 1], leg_m[last]):
        cuts.add(last - 1)
    return [slice(a, b + 1) for a, b in itertools.pairwise(sorted(cuts))]


def _is_vertical(a: NDArray[np.float64], b: NDArray[np.float64]) -> bool:
    return bool(np.hypot(*(b - a)[:2]) < VERTICAL_M)


def _at_limits(points_m: NDArray[np.float64], limits: FlightLimits, progress: Progress) -> Spline:
    spline = times_at_limits(points_m, limits, progress)
    duration = float(spline.durations_s.sum())
    if not duration <= LONGEST_S:
        raise InfeasibleError(
            f"under the vehicle's limits this way takes {duration:.3g} s, and no vehicle flies for a day: raise them"
        )
    return spline


def _joined(parts: Sequence[Spline]) -> Spline:
    return Spline(np.concatenate([p.coefficients for p in parts]), np.concatenate([p.durations_s for p in parts]))
