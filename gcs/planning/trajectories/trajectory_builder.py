"""From the tour's legs to the trajectory: corridors, minimum-snap curves between stops, dwells at the stops."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.trajectory import DEGREE, AngleProfile, PiecewisePolynomial
from gcs.planning.numerics.bernstein import monomial_from_control
from gcs.planning.numerics.qp_solver import default_solvers
from gcs.planning.trajectories.safe_corridor import build_corridor, stop_box
from gcs.planning.trajectories.time_allocation import FlightLimits, time_legs
from gcs.planning.views.viewing_angles import schedule_views

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from gcs.core.progress import Progress
    from gcs.core.scenario import Scenario
    from gcs.planning.numerics.qp_solver import QpSolver
    from gcs.planning.scene.free_space import FreeSpace


@dataclass(frozen=True, eq=False)
class BuiltTrajectory:
    """What is flown, with what is needed to prove it.

    Attributes:
        trajectory: at rest at both ends and during the dwell at every viewpoint.
        corridor_m: low and high corner of each segment's box, shape (S, 2, 3).
        yaw: vehicle yaw from east, counter-clockwise.
        gimbal_pitch: camera pitch, 0 level, negative down.
        exposures_s: when each viewpoint's picture is taken, shape (V,).
    """

    trajectory: PiecewisePolynomial
    corridor_m: NDArray[np.float64]
    yaw: AngleProfile
    gimbal_pitch: AngleProfile
    exposures_s: NDArray[np.float64]


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


def build_trajectory(
    legs_m: Sequence[NDArray[np.float64]],
    yaw_rad: NDArray[np.float64],
    gimbal_pitch_rad: NDArray[np.float64],
    scenario: Scenario,
    progress: Progress,
    solvers: Sequence[QpSolver] | None = None,
    space: FreeSpace | None = None,
) -> BuiltTrajectory:
    """Make the trajectory of a tour.

    Args:
        legs_m: polylines (K, 3) from home to the first viewpoint, ..., from the last one to home; the first starts and
            the last ends with the vertical column over home.
        yaw_rad: vehicle yaw at each viewpoint in visiting order, shape (V,), V = len(legs_m) - 1.
        gimbal_pitch_rad: camera pitch at each viewpoint, shape (V,).
        scenario: limits of the vehicle, corridor, gimbal and camera.
        progress: reports the stage `trajectory`.
        solvers: for the quadratic programs, in order of trial; PIQP, Clarabel, OSQP when not given.
        space: where the legs are free; without it they keep the corridor's reach everywhere.

    Raises:
        OperationCancelled: the progress said so.
    """
    vehicle, camera = scenario.vehicle, scenario.camera
    limits = FlightLimits(vehicle.max_speed_m_s, vehicle.max_acceleration_m_s2, vehicle.max_jerk_m_s3)
    half_width = scenario.safety.corridor_half_width_m
    last = len(legs_m) - 1
    longest = longest_segment_m(limits, half_width)
    corridors = {
        index: build_corridor(
            leg, half_width, longest, column_at_start=index == 0, column_at_end=index == last, space=space
        )
        for index, leg in enumerate(legs_m)
        if _has_length(leg)
    }
    timed = time_legs(list(corridors.values()), limits, solvers or default_solvers(), progress)
    flown = dict(zip(corridors, timed, strict=True))
    schedule = schedule_views(
        np.array([flown[index].durations_s.sum() if index in flown else 0.0 for index in range(len(legs_m))]),
        yaw_rad,
        gimbal_pitch_rad,
        gimbal_rate_rad_s=math.radians(camera.gimbal.rate_deg_s),
        min_interval_s=camera.min_interval_s,
    )
    coefficients, durations, boxes = [], [], []
    for index, leg in enumerate(legs_m):
        if index in flown:
            coefficients.append(monomial_from_control(flown[index].control))
            durations.append(flown[index].durations_s)
            boxes.append(corridors[index].boxes_m)
        if index < last:
            rest = np.zeros((1, DEGREE + 1, 3))
            rest[0, 0] = leg[-1]
            coefficients.append(rest)
            durations.append(schedule.dwells_s[index : index + 1])
            boxes.append(stop_box(leg[-1], half_width, space)[None])
    progress.report("trajectory", 1.0)
    return BuiltTrajectory(
        trajectory=PiecewisePolynomial(np.concatenate(coefficients), np.concatenate(durations)),
        corridor_m=np.concatenate(boxes),
        yaw=schedule.yaw,
        gimbal_pitch=schedule.gimbal_pitch,
        exposures_s=schedule.exposures_s,
    )
