"""Figures of a finished curve, computed from its polynomials and the scene alone.

Nothing here knows how the curve was made. Clearance, speed, acceleration, jerk and `deviation_bound_m` are bounds over
the whole curve, not samples of it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from gcs.planning.numerics.bernstein import control_from_monomial
from gcs.planning.numerics.curve_bounds import Extremum, largest_norm, least, lipschitz_bounds
from gcs.planning.numerics.curve_samples import sampled
from gcs.planning.scene.fence import fence_volume, room_in_fence
from gcs.planning.scene.room import HOME_COLUMN_RADIUS_M
from gcs.planning.trajectories.convex_set import outside_m
from gcs.planning.trajectories.deviation import PolylineDistance
from gcs.planning.trajectories.flight_limits import largest_thrust_ratio, largest_tilt_rad
from gcs.planning.views.viewpoint_pose import camera_axes

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from gcs.core.plan import Viewpoint
    from gcs.core.progress import Progress
    from gcs.core.scenario import Scenario
    from gcs.core.trajectory import AngleProfile, PiecewisePolynomial
    from gcs.planning.scene.point_distance import SceneDistance
    from gcs.planning.trajectories.trajectory_builder import BuiltTrajectory

CLEARANCE_TOLERANCE_M = 0.005
"""How far the clearance's bound may be under the true one."""

DEVIATION_TOLERANCE_M = 0.001
"""How far the largest deviation's bound may be over the true one."""

WRITTEN_STEP_S = 0.02
"""Step of the positions that are written out and that `max_deviation_m` speaks of."""


class _Deviation(NamedTuple):
    length_m: float
    mean_m: float
    largest_written_m: float
    bound_m: float


@dataclass(frozen=True)
class CurveFigures:
    """Figures of a curve in SI units; see `gcs.core.plan.Certificates` for those of the same name.

    Attributes:
        max_deviation_m: largest distance from the nearest point of the path at the 50 Hz of the written trajectory.
        deviation_bound_m: bound of the same over the whole curve; higher where the nearest leg changes between samples.
        clearance_time_s: where the hull comes nearest.
        max_tilt_rad: largest angle of the thrust from the vertical, when the vehicle's is limited.
        max_thrust_ratio: largest thrust over weight, when the vehicle's is limited.
        largest_jump: largest jump of position, velocity, acceleration or jerk at a joint (SI units).
        unrest_m_s: largest speed at the start, at the end and at the exposures of viewpoints that it stops at.
        unrest_m_s2: largest acceleration there.
        fence_room_m: how far the vehicle could move before it came too near to the fence; infinite without one.
        disorder: number of viewpoints whose exposure is not after the one before.
        interval_s: least time between two exposures; infinite when there are fewer.
        short_hold_s: by how much the longest rest about an exposure falls short of the hold that was asked; 0 or less
            when none does.
        exposure_turn_rad_s: largest rate of yaw or gimbal at an exposure.
        yaw_rate_rad_s: largest yaw rate.
        gimbal_rate_rad_s: largest gimbal pitch rate.
        angle_miss_rad: largest difference of yaw, pitch, view direction or image-up direction from a viewpoint's at its
            exposure.
    """

    length_m: float
    path_length_m: float
    duration_s: float
    mean_deviation_m: float
    max_deviation_m: float
    deviation_bound_m: float
    min_clearance_m: float
    clearance_time_s: float
    max_speed_m_s: float
    max_acceleration_m_s2: float
    max_jerk_m_s3: float
    max_tilt_rad: float | None
    max_thrust_ratio: float | None
    corridor_violation_m: float
    worst_viewpoint_miss_m: float
    largest_jump: float
    unrest_m_s: float
    unrest_m_s2: float
    fence_room_m: float
    disorder: int
    interval_s: float
    short_hold_s: float
    exposure_turn_rad_s: float
    yaw_rate_rad_s: float
    gimbal_rate_rad_s: float
    angle_miss_rad: float


def measure(
    built: BuiltTrajectory,
    path_m: NDArray[np.float64],
    viewpoints: Sequence[Viewpoint],
    scenario: Scenario,
    distance: SceneDistance,
    progress: Progress,
) -> CurveFigures:
    """Compute every figure of a finished trajectory.

    Args:
        built: the trajectory with its corridor and angles.
        path_m: the collision-free polyline, shape (K, 3).
        viewpoints: in visiting order, with their times.
        scenario: for home, radius and fence.
        distance: exact distance to the scene.
        progress: reports the stage `certificates`.
    """
    trajectory = built.trajectory
    durations = trajectory.durations_s
    control = control_from_monomial(trajectory.coefficients)
    progress.report("certificates", 0.0)
    clearance = _clearance(control, durations, scenario, distance, progress)
    progress.report("certificates", 0.5)
    deviation = _deviation(trajectory, control, path_m, progress)
    progress.report("certificates", 0.8)
    times = np.array([v.time_s for v in viewpoints])
    stops = np.array([v.stops for v in viewpoints], dtype=np.bool_)
    rests = np.concatenate([[0.0], times[stops], [trajectory.duration_s]])
    order = np.concatenate([[0.0], times, [trajectory.duration_s]])
    turning = np.abs([built.yaw.rate(times), built.gimbal_pitch.rate(times)])
    positions = np.array([v.position_m for v in viewpoints]).reshape(-1, 3)
    low, high = built.corridor_m[:, :1], built.corridor_m[:, 1:]
    beyond_planes = outside_m(control, built.corridor_planes) if built.corridor_planes else 0.0
    return CurveFigures(
        length_m=deviation.length_m,
        path_length_m=float(np.linalg.norm(np.diff(path_m, axis=0), axis=1).sum()),
        duration_s=trajectory.duration_s,
        mean_deviation_m=deviation.mean_m,
        max_deviation_m=deviation.largest_written_m,
        deviation_bound_m=deviation.bound_m,
        min_clearance_m=clearance.value - scenario.vehicle.radius_m,
        clearance_time_s=clearance.time_s,
        max_speed_m_s=largest_norm(control, durations, 1).value,
        max_acceleration_m_s2=largest_norm(control, durations, 2).value,
        max_jerk_m_s3=largest_norm(control, durations, 3).value,
        max_tilt_rad=None if scenario.vehicle.max_tilt_deg is None else largest_tilt_rad(control, durations),
        max_thrust_ratio=None
        if scenario.vehicle.max_thrust_ratio is None
        else largest_thrust_ratio(control, durations),
        corridor_violation_m=float(np.maximum(low - control, control - high).max(initial=beyond_planes)),
        worst_viewpoint_miss_m=_largest(np.linalg.norm(trajectory.value(times) - positions, axis=1)),
        largest_jump=_largest_jump(trajectory),
        unrest_m_s=_largest(np.linalg.norm(trajectory.value(rests, 1), axis=1)),
        unrest_m_s2=_largest(np.linalg.norm(trajectory.value(rests, 2), axis=1)),
        fence_room_m=_fence_room(control, durations, scenario, progress),
        disorder=int((np.diff(order) <= 0).sum()),
        interval_s=float(np.diff(np.sort(times)).min(initial=math.inf)),
        short_hold_s=_short_hold_s(trajectory, viewpoints),
        exposure_turn_rad_s=_largest(turning),
        yaw_rate_rad_s=_largest_rate(built.yaw),
        gimbal_rate_rad_s=_largest_rate(built.gimbal_pitch),
        angle_miss_rad=_angle_miss(built, viewpoints, times),
    )


def _largest(values: NDArray[np.float64]) -> float:
    return float(values.max(initial=0.0))


def _clearance(
    control: NDArray[np.float64],
    durations_s: NDArray[np.float64],
    scenario: Scenario,
    distance: SceneDistance,
    progress: Progress,
) -> Extremum:
    """Least distance of the centre from surfaces and cables, and from the ground outside the column over home."""
    surfaces = lipschitz_bounds(lambda points: distance.distance(points, ground=False))
    nearest = least(control, durations_s, surfaces, CLEARANCE_TOLERANCE_M, progress)
    ground_m = distance.ground_m
    if ground_m is None:
        return nearest
    home = np.asarray(scenario.home_m)[:2]

    def heights(parts: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        away = np.linalg.norm(parts[:, :, :2] - home, axis=2)
        outside = away > HOME_COLUMN_RADIUS_M
        height = parts[:, :, 2] - ground_m
        # The first and the last control point lie on the curve; all of a part's hull inside the column is exempt.
        ends = np.where(outside[:, [0, -1]], height[:, [0, -1]], math.inf).min(axis=1)
        return np.where(outside.any(axis=1), height.min(axis=1), math.inf), ends

    ground = least(control, durations_s, heights, CLEARANCE_TOLERANCE_M, progress)
    return min(nearest, ground, key=lambda extremum: extremum.value)


def _fence_room(
    control: NDArray[np.float64], durations_s: NDArray[np.float64], scenario: Scenario, progress: Progress
) -> float:
    if scenario.fence is None:
        return math.inf
    volume = fence_volume(scenario.fence, scenario.vehicle, scenario.safety)
    bounds = lipschitz_bounds(lambda points: room_in_fence(points, volume))
    return least(control, durations_s, bounds, CLEARANCE_TOLERANCE_M, progress).value


def _deviation(
    trajectory: PiecewisePolynomial, control: NDArray[np.float64], path_m: NDArray[np.float64], progress: Progress
) -> _Deviation:
    """Length of the curve, and its distance from the nearest point of the path."""
    path = PolylineDistance(path_m)
    count = max(2, math.ceil(2 * trajectory.duration_s / WRITTEN_STEP_S))
    step = trajectory.duration_s / count
    times = (np.arange(count, dtype=np.float64) + 0.5) * step
    curve = trajectory.coefficients, trajectory.durations_s
    speed = np.linalg.norm(sampled(*curve, times, 1), axis=1)
    away = path.distance(sampled(*curve, times, 0))
    written = np.append(np.arange(0.0, trajectory.duration_s, WRITTEN_STEP_S), trajectory.duration_s)
    bound = least(
        control,
        trajectory.durations_s,
        lipschitz_bounds(path.distance, sign=-1.0),
        DEVIATION_TOLERANCE_M,
        progress,
    )
    return _Deviation(
        length_m=float(speed.sum() * step),
        mean_m=float((away * speed).sum() / max(speed.sum(), 1e-12)),
        largest_written_m=_largest(path.distance(sampled(*curve, written, 0))),
        bound_m=-bound.value,
    )


def _largest_jump(trajectory: PiecewisePolynomial) -> float:
    """Largest jump of any of position to jerk between the end of a piece and the start of the next."""
    worst = 0.0
    powers = np.arange(trajectory.coefficients.shape[1])
    for order in range(4):
        factor = np.array([math.perm(int(k), order) for k in powers], dtype=np.float64)
        scale = trajectory.durations_s[:, None] ** order
        end = np.einsum("k,skd->sd", factor, trajectory.coefficients) / scale
        start = factor[order] * trajectory.coefficients[:, order] / scale
        worst = max(worst, _largest(np.linalg.norm(start[1:] - end[:-1], axis=1)))
    return worst


def _short_hold_s(trajectory: PiecewisePolynomial, viewpoints: Sequence[Viewpoint]) -> float:
    """See `CurveFigures`; a rest is one piece that does not move."""
    short = 0.0
    for view in viewpoints:
        if view.hold_s > 0:
            piece = int(np.searchsorted(trajectory.starts_s, view.time_s, side="right")) - 1
            rests = not trajectory.coefficients[piece, 1:].any()
            short = max(short, view.hold_s - (trajectory.durations_s[piece] if rests else 0.0))
    return float(short)


def _largest_rate(profile: AngleProfile) -> float:
    """A smooth step is quickest in its middle, at 1.5 times its mean rate."""
    return float(1.5 * np.abs(np.diff(profile.angles_rad) / np.diff(profile.times_s)).max(initial=0.0))


def _angle_miss(built: BuiltTrajectory, viewpoints: Sequence[Viewpoint], times: NDArray[np.float64]) -> float:
    if not len(viewpoints):
        return 0.0
    yaw, pitch = built.yaw.value(times), built.gimbal_pitch.value(times)
    yaw_miss = yaw - np.array([v.yaw_rad for v in viewpoints])
    pitch_miss = pitch - np.array([v.gimbal_pitch_rad for v in viewpoints])
    view, up = camera_axes(yaw, pitch)
    return max(
        _largest(np.abs((yaw_miss + np.pi) % (2 * np.pi) - np.pi)),
        _largest(np.abs(pitch_miss)),
        _largest(_angle_between(view, np.array([v.direction for v in viewpoints]))),
        _largest(_angle_between(up, np.array([v.up for v in viewpoints]))),
    )


def _angle_between(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Angles (rad) between unit vectors, shapes (N, 3) -> (N,)."""
    return np.asarray(2 * np.arcsin(np.minimum(np.linalg.norm(a - b, axis=1) / 2, 1.0)))
