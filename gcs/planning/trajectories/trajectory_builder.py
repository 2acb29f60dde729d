"""From the tour's legs to the trajectory: minimum-snap curves between stops, dwells at the stops.

Every variant makes of each leg a timed curve from rest to rest and a box for each of its pieces. In a corridor the
boxes are where the curve had to stay; without one they hold the control points of the curve as it came out. In a
corridor, legs can also be flown as one, through the viewpoints between them (`fly_through`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from gcs.core.trajectory import DEGREE, AngleProfile, PiecewisePolynomial
from gcs.planning.numerics.bernstein import monomial_from_control
from gcs.planning.numerics.qp_solver import default_solvers
from gcs.planning.trajectories.box_corridor import stop_box
from gcs.planning.trajectories.convex_set import box_planes
from gcs.planning.trajectories.flight_limits import FlightLimits, limits_of
from gcs.planning.trajectories.fly_through import Views, fly_through
from gcs.planning.trajectories.safe_corridor import build_corridor
from gcs.planning.trajectories.time_allocation import time_legs
from gcs.planning.trajectories.waypoint_curves import LegEnds, hull_boxes, waypoint_curves
from gcs.planning.views.viewing_angles import ViewingRates, schedule_views

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from gcs.core.progress import Progress
    from gcs.core.scenario import Scenario
    from gcs.planning.numerics.chain_qp import ChainSolver
    from gcs.planning.numerics.qp_solver import QpSolver
    from gcs.planning.scene.free_space import FreeSpace
    from gcs.planning.trajectories.safe_corridor import LegCorridor
    from gcs.planning.trajectories.time_allocation import TimedLeg


@dataclass(frozen=True, eq=False)
class BuiltTrajectory:
    """What is flown, with what is needed to prove it.

    Attributes:
        trajectory: at rest at both ends and during the dwell at every viewpoint that it stops at.
        corridor_m: low and high corner of each segment's box, shape (S, 2, 3); where the curve had to stay, or
            without a corridor (`planner.trajectory`) what holds its control points.
        yaw: vehicle yaw from east, counter-clockwise.
        gimbal_pitch: camera pitch, 0 level, negative down.
        exposures_s: when each viewpoint's picture is taken, shape (V,).
        stops: whether it stops for it, shape (V,).
        corridor_planes: of each segment's convex set (`convex_set`), within its box; empty where boxes are the sets.
    """

    trajectory: PiecewisePolynomial
    corridor_m: NDArray[np.float64]
    yaw: AngleProfile
    gimbal_pitch: AngleProfile
    exposures_s: NDArray[np.float64]
    stops: NDArray[np.bool_]
    corridor_planes: tuple[NDArray[np.float64], ...] = ()


class LegCurve(NamedTuple):
    """A leg's curve.

    Attributes:
        coefficients: of its pieces on normalised time (`PiecewisePolynomial`), shape (n, 8, 3).
        durations_s: of the pieces, shape (n,).
        boxes_m: low and high corner of a box about each piece, shape (n, 2, 3).
        planes: of the set about each piece, where that is not the box.
    """

    coefficients: NDArray[np.float64]
    durations_s: NDArray[np.float64]
    boxes_m: NDArray[np.float64]
    planes: tuple[NDArray[np.float64], ...] = ()


def longest_segment_m(limits: FlightLimits, half_width_m: float) -> float:
    """Longest straight that one polynomial flies (m): half the way from rest to full speed.

    It is also bounded by the corridor's width on both sides: segments of very different lengths make a stiff problem,
    and a slow vehicle needs no more of them than a quick one.
    """
    wanted = limits.speed_m_s**2 / (4 * limits.acceleration_m_s2)
    return min(max(wanted, half_width_m), 10 * half_width_m)


def estimated_leg_time_s(length_m: NDArray[np.float64], limits: FlightLimits) -> NDArray[np.float64]:
    """Time (s) of straight legs from rest to rest with the acceleration and speed limits alone, for tours.

    It is a lower bound on the time of the trajectory's legs.

    Args:
        length_m: lengths, any shape.
        limits: speed and acceleration.
    """
    ramp = limits.speed_m_s**2 / limits.acceleration_m_s2
    short = 2 * np.sqrt(length_m / limits.acceleration_m_s2)
    long = length_m / limits.speed_m_s + limits.speed_m_s / limits.acceleration_m_s2
    return np.where(length_m < ramp, short, long)


def _has_length(leg_m: NDArray[np.float64]) -> bool:
    """Whether a leg goes anywhere: pictures in two directions may be taken from one place."""
    return bool(np.abs(leg_m - leg_m[0]).max() > 1e-9)


def leg_curves(
    legs_m: Sequence[NDArray[np.float64]],
    scenario: Scenario,
    progress: Progress,
    solvers: Sequence[QpSolver] | None = None,
    space: FreeSpace | None = None,
) -> list[LegCurve | None]:
    """Make the curves of a tour's legs as `planner.trajectory` says.

    Args:
        legs_m: as of `build_trajectory`.
        scenario: limits of the vehicle, variant and corridor.
        progress: reports the stage `trajectory`.
        solvers: as of `build_trajectory`.
        space: as of `build_trajectory`.

    Returns:
        A curve for each leg; None where the leg has no length.

    Raises:
        InputError: as of `build_trajectory`.
        InfeasibleError: as of `build_trajectory`.
        OperationCancelled: the progress said so.
    """
    vehicle, variant = scenario.vehicle, scenario.planner.trajectory
    limits = limits_of(vehicle)
    if variant == "corridor":
        corridors = _leg_corridors(legs_m, scenario, space)
        return _in_corridors(_stopping(corridors, limits, solvers or default_solvers(), progress), corridors)
    half_width = scenario.safety.corridor_half_width_m
    last = len(legs_m) - 1
    flown = [index for index, leg in enumerate(legs_m) if _has_length(leg)]
    legs, ends = [legs_m[index] for index in flown], [LegEnds(index == 0, index == last) for index in flown]
    splines = waypoint_curves(variant, legs, ends, limits, half_width, progress, space)
    curves = [LegCurve(s.coefficients, s.durations_s, hull_boxes(s.coefficients)) for s in splines]
    found = dict(zip(flown, curves, strict=True))
    return [found.get(index) for index in range(len(legs_m))]


def _leg_corridors(
    legs_m: Sequence[NDArray[np.float64]], scenario: Scenario, space: FreeSpace | None
) -> list[LegCorridor | None]:
    """The corridor of each leg; None where it has no length."""
    half_width, last = scenario.safety.corridor_half_width_m, len(legs_m) - 1
    longest, kind = longest_segment_m(limits_of(scenario.vehicle), half_width), scenario.planner.corridor
    return [
        build_corridor(leg, half_width, longest, **vars(LegEnds(index == 0, index == last)), space=space, kind=kind)
        if _has_length(leg)
        else None
        for index, leg in enumerate(legs_m)
    ]


def _stopping(
    corridors: Sequence[LegCorridor | None],
    limits: FlightLimits,
    solvers: Sequence[QpSolver | ChainSolver],
    progress: Progress,
) -> list[TimedLeg | None]:
    """The legs from rest to rest."""
    timed = iter(time_legs([corridor for corridor in corridors if corridor is not None], limits, solvers, progress))
    return [None if corridor is None else next(timed) for corridor in corridors]


def _in_corridors(legs: Sequence[TimedLeg | None], corridors: Sequence[LegCorridor | None]) -> list[LegCurve | None]:
    return [
        None
        if leg is None or corridor is None
        else LegCurve(monomial_from_control(leg.control), leg.durations_s, corridor.boxes_m, corridor.planes)
        for leg, corridor in zip(legs, corridors, strict=True)
    ]


def build_trajectory(
    legs_m: Sequence[NDArray[np.float64]],
    yaw_rad: NDArray[np.float64],
    gimbal_pitch_rad: NDArray[np.float64],
    scenario: Scenario,
    progress: Progress,
    solvers: Sequence[QpSolver] | None = None,
    space: FreeSpace | None = None,
    *,
    passing_speeds_m_s: NDArray[np.float64] | None = None,
    holds_s: NDArray[np.float64] | None = None,
) -> BuiltTrajectory:
    """Make the trajectory of a tour.

    Args:
        legs_m: polylines (K, 3) from home to the first viewpoint, ..., from the last one to home; the first starts and
            the last ends with the vertical column over home.
        yaw_rad: vehicle yaw at each viewpoint in visiting order, shape (V,), V = len(legs_m) - 1.
        gimbal_pitch_rad: camera pitch at each viewpoint, shape (V,).
        scenario: limits of the vehicle, variant of the trajectory, corridor, gimbal and camera.
        progress: reports the stage `trajectory`.
        solvers: for the quadratic programs, in order of trial; PIQP, Clarabel, OSQP when not given.
        space: where the legs are free; without it they keep the corridor's reach everywhere.
        passing_speeds_m_s: how fast each picture may be taken in flight, shape (V,); 0 where the vehicle has to stop,
            as it does everywhere when not given. Only in a corridor something is flown through.
        holds_s: how long the vehicle is asked to stand at each viewpoint at least, shape (V,); 0 where it is not.

    Raises:
        InputError: a leg cannot be used; names the stops.
        InfeasibleError: a curve without a corridor cannot meet the limits in a day.
        OperationCancelled: the progress said so.
    """
    camera = scenario.camera
    half_width = scenario.safety.corridor_half_width_m
    last = len(legs_m) - 1
    rates = ViewingRates(math.radians(camera.gimbal.rate_deg_s), min_interval_s=camera.min_interval_s)
    holds = np.zeros(last) if holds_s is None else holds_s
    stops = np.ones(last, dtype=np.bool_)
    if passing_speeds_m_s is None or not passing_speeds_m_s.any() or scenario.planner.trajectory != "corridor":
        curves = leg_curves(legs_m, scenario, progress, solvers, space)
    else:
        corridors, limits = _leg_corridors(legs_m, scenario, space), limits_of(scenario.vehicle)
        chosen = solvers or default_solvers()
        stopping = _stopping(corridors, limits, chosen, progress)
        views = Views(yaw_rad, gimbal_pitch_rad, passing_speeds_m_s, holds)
        flown, stops = fly_through(corridors, stopping, views, rates, limits, chosen, progress)
        curves = _in_corridors(flown, corridors)
    schedule = schedule_views(
        np.array([0.0 if curve is None else curve.durations_s.sum() for curve in curves]),
        yaw_rad,
        gimbal_pitch_rad,
        rates,
        stops=stops,
        holds_s=holds,
    )
    coefficients, durations, boxes = [], [], []
    planes: list[NDArray[np.float64]] = []
    for index, (leg, curve) in enumerate(zip(legs_m, curves, strict=True)):
        if curve is not None:
            coefficients.append(curve.coefficients)
            durations.append(curve.durations_s)
            boxes.append(curve.boxes_m)
            planes += curve.planes
        if index < last and stops[index]:
            rest = np.zeros((1, DEGREE + 1, 3))
            rest[0, 0] = leg[-1]
            coefficients.append(rest)
            durations.append(schedule.dwells_s[index : index + 1])
            boxes.append(stop_box(leg[-1], half_width, space)[None])
            planes.append(box_planes(boxes[-1][0]))
    progress.report("trajectory", 1.0)
    return BuiltTrajectory(
        trajectory=PiecewisePolynomial(np.concatenate(coefficients), np.concatenate(durations)),
        corridor_m=np.concatenate(boxes),
        yaw=schedule.yaw,
        gimbal_pitch=schedule.gimbal_pitch,
        exposures_s=schedule.exposures_s,
        stops=stops,
        corridor_planes=() if scenario.planner.corridor == "boxes" else tuple(planes),
    )
