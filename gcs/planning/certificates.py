"""Certificates: what must hold on the finished curve, held against its figures.

The same checks judge a plan before it is written (`certify`) and a plan that was read from its files (`recheck`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.errors import InfeasibleError
from gcs.core.plan import Certificates
from gcs.core.progress import SilentProgress
from gcs.planning.trajectories.curve_figures import CurveFigures, measure
from gcs.planning.trajectories.safe_corridor import corridor_reach
from gcs.planning.trajectories.trajectory_builder import BuiltTrajectory
from gcs.planning.views.image_sharpness import ImageSharpness, measure_sharpness
from gcs.planning.views.viewing_angles import YAW_RATE_RAD_S

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from gcs.core.plan import Plan, Viewpoint
    from gcs.core.progress import Progress
    from gcs.core.scenario import Scenario
    from gcs.core.surface_coverage import SurfaceCoverage
    from gcs.planning.scene.point_distance import SceneDistance

VIEWPOINT_MISS_M = 0.05
"""How far the curve may pass from a viewpoint."""

REST_SHARE = 1e-3
"""How much blur and skew may grow by what `rest_speed` allows."""

ANGLE_TOLERANCE_RAD = math.radians(0.5)
"""How far yaw and pitch may be from a viewpoint's at its exposure."""


class CertificateError(InfeasibleError):
    """Certificates of a finished trajectory do not hold."""

    title = "Certificates do not hold"


@dataclass(frozen=True)
class Check:
    """One certificate.

    Attributes:
        name: what is checked, as in `report.json` where it is there.
        ok: whether it holds.
        value: what was computed.
        limit: what it is held against.
        message: one line for people.
    """

    name: str
    ok: bool
    value: float
    limit: float
    message: str


def check_figures(figures: CurveFigures, scenario: Scenario) -> list[Check]:
    """Hold the figures against what the scenario asks.

    Only a corridor promises a distance from the path; its boxes are then where the curve had to stay. The boxes of the
    other variants hold the curve as it is, so that they say no more than where it is.
    """
    vehicle, gimbal = scenario.vehicle, scenario.camera.gimbal
    asked = scenario.safety.hull_clearance_m
    f = figures
    checks = [
        _at_least(
            "min_clearance_m",
            f.min_clearance_m,
            asked,
            "m",
            f"between hull and scene, at t = {f.clearance_time_s:.1f} s",
        ),
        _at_most("max_speed_m_s", f.max_speed_m_s, vehicle.max_speed_m_s, "m/s", "largest speed"),
        _at_most(
            "max_acceleration_m_s2",
            f.max_acceleration_m_s2,
            vehicle.max_acceleration_m_s2,
            "m/s^2",
            "largest acceleration",
        ),
        _at_most("corridor_violation_m", f.corridor_violation_m, 1e-6, "m", "outside the corridor"),
        _at_most("worst_viewpoint_miss_m", f.worst_viewpoint_miss_m, VIEWPOINT_MISS_M, "m", "past a viewpoint"),
        _at_most("continuity", f.largest_jump, 1e-4, "", "largest jump of position, velocity, acceleration or jerk"),
        _at_most("rest_speed", f.unrest_m_s, 1e-4, "m/s", "at the ends and where it stops for a picture"),
        _at_most("rest_acceleration", f.unrest_m_s2, 1e-3, "m/s^2", "at the ends and where it stops for a picture"),
        _at_most("hold", f.short_hold_s, 1e-6, "s", "short of a hold that is asked"),
        _at_most("visiting_order", float(f.disorder), 0.0, "", "exposures out of order"),
        _at_most("exposure_turn", f.exposure_turn_rad_s, 1e-4, "rad/s", "largest turn of yaw or gimbal at an exposure"),
        _at_most("yaw_rate", f.yaw_rate_rad_s, YAW_RATE_RAD_S, "rad/s", "largest yaw rate"),
        _at_most("gimbal_rate", f.gimbal_rate_rad_s, math.radians(gimbal.rate_deg_s), "rad/s", "largest gimbal rate"),
        _at_most("viewing_angles", f.angle_miss_rad, ANGLE_TOLERANCE_RAD, "rad", "off a viewpoint's direction"),
    ]
    if math.isfinite(f.interval_s):
        least = scenario.camera.min_interval_s
        checks.append(_at_least("picture_interval", f.interval_s, least, "s", "between two exposures"))
    if scenario.planner.trajectory == "corridor":
        reach = corridor_reach(scenario.safety.corridor_half_width_m)
        checks.append(_at_most("deviation", f.deviation_bound_m, reach, "m", "bound of the distance from the path"))
    if vehicle.max_jerk_m_s3 is not None:
        checks.append(_at_most("max_jerk_m_s3", f.max_jerk_m_s3, vehicle.max_jerk_m_s3, "m/s^3", "largest jerk"))
    if vehicle.max_tilt_deg is not None and f.max_tilt_rad is not None:
        limit = math.radians(vehicle.max_tilt_deg)
        checks.append(_at_most("max_tilt", f.max_tilt_rad, limit, "rad", "largest tilt, in still air"))
    if vehicle.max_thrust_ratio is not None and f.max_thrust_ratio is not None:
        limit = vehicle.max_thrust_ratio
        checks.append(_at_most("max_thrust_ratio", f.max_thrust_ratio, limit, "", "largest thrust over weight"))
    if scenario.fence is not None:
        checks.append(_at_least("fence", f.fence_room_m, 0.0, "m", "room to the fence"))
    return checks


def check_sharpness(sharpness: ImageSharpness, scenario: Scenario) -> list[Check]:
    """Hold focus, blur and skew of the pictures against the camera's limits, as far as the camera states them."""
    camera = scenario.camera
    drifting = f"with {scenario.vehicle.hover_speed_m_s:g} m/s of drift"
    unjudged = _at_most(
        "unjudged_blur", float(sharpness.unjudged), 0.0, "", "pictures in flight of unknown blur or skew"
    )
    checks = [unjudged] if sharpness.unjudged else []
    if sharpness.focus is not None:
        value, name = sharpness.focus
        checks.append(_at_least("focus", value, 0.0, "m", f"room to the nearest that can be sharp, at {name}"))
    if sharpness.blur is not None:
        value, name = sharpness.blur
        limit = camera.max_blur_px * (1 + REST_SHARE)
        checks.append(_at_most("max_blur_px", value, limit, "px", f"largest motion blur, at {name}, {drifting}"))
    if sharpness.skew is not None:
        value, name = sharpness.skew
        limit = camera.max_skew_px * (1 + REST_SHARE)
        checks.append(_at_most("max_skew_px", value, limit, "px", f"largest skew, at {name}, {drifting}"))
    return checks


def _at_most(name: str, value: float, limit: float, unit: str, what: str) -> Check:
    ok = value <= limit * (1 + 1e-9) + 1e-12
    return Check(name, ok, value, limit, f"{what}: {value:.6g} {unit}".rstrip() + f", limit {limit:.6g}")


def _at_least(name: str, value: float, limit: float, unit: str, what: str) -> Check:
    ok = value >= limit - 1e-9
    return Check(name, ok, value, limit, f"{what}: {value:.6g} {unit}, asked {limit:.6g}")


def certify(
    built: BuiltTrajectory,
    path_m: NDArray[np.float64],
    viewpoints: Sequence[Viewpoint],
    scenario: Scenario,
    distance: SceneDistance,
    progress: Progress,
    *,
    coverage: SurfaceCoverage | None,
    tour_cost: float,
    tour_lower_bound: float,
    energy_wh: float,
    open_sky: float,
    spots: dict[str, int] | None = None,
) -> Certificates:
    """Prove a finished trajectory.

    Args:
        built: the trajectory with its corridor and angles.
        path_m: the collision-free polyline, shape (K, 3).
        viewpoints: in visiting order, with their times.
        scenario: what was asked.
        distance: exact distance to the scene.
        progress: reports the stage `certificates`.
        coverage: carried into the result, as are the next five.
        tour_cost: in the metric's unit.
        tour_lower_bound: in the metric's unit.
        energy_wh: of the whole flight.
        open_sky: share of the flight time under the open sky.
        spots: how many of the named spots have each verdict.

    Raises:
        CertificateError: in one line, everything that does not hold, with its numbers.
    """
    figures = measure(built, path_m, viewpoints, scenario, distance, progress)
    sharpness = measure_sharpness(built.trajectory, viewpoints, scenario)
    checks = [*check_figures(figures, scenario), *check_sharpness(sharpness, scenario)]
    failed = [check for check in checks if not check.ok]
    if failed:
        raise CertificateError("; ".join(f"{check.name}: {check.message}" for check in failed))
    return Certificates(
        length_m=figures.length_m,
        path_length_m=figures.path_length_m,
        duration_s=figures.duration_s,
        mean_deviation_m=figures.mean_deviation_m,
        max_deviation_m=figures.max_deviation_m,
        min_clearance_m=figures.min_clearance_m,
        max_speed_m_s=figures.max_speed_m_s,
        max_acceleration_m_s2=figures.max_acceleration_m_s2,
        max_jerk_m_s3=figures.max_jerk_m_s3,
        corridor_violation_m=figures.corridor_violation_m,
        worst_viewpoint_miss_m=figures.worst_viewpoint_miss_m,
        viewpoints=len(viewpoints),
        coverage=None if coverage is None else coverage.share_seen,
        coverable=None if coverage is None else coverage.share_coverable,
        tour_cost=tour_cost,
        tour_lower_bound=tour_lower_bound,
        tour_metric=scenario.planner.metric,
        energy_wh=energy_wh,
        open_sky=open_sky,
        max_blur_px=sharpness.max_blur_px,
        max_skew_px=sharpness.max_skew_px,
        surface_m2=None if coverage is None else coverage.area_m2,
        coverage_samples=None if coverage is None else len(coverage.verdicts),
        not_covered_m2=None if coverage is None else coverage.not_covered_m2(),
        spots=spots,
    )


_SAME = {
    "length_m": 0.01,
    "path_length_m": 0.01,
    "duration_s": 0.001,
    "mean_deviation_m": 0.005,
    "max_deviation_m": 0.005,
    "min_clearance_m": 0.01,
    "max_speed_m_s": 0.001,
    "max_acceleration_m_s2": 0.001,
    "max_jerk_m_s3": 0.001,
    "worst_viewpoint_miss_m": 0.001,
    "max_blur_px": 0.01,
    "max_skew_px": 0.01,
}
"""How far a recorded figure may be from the one that is computed again."""


def recheck(plan: Plan, distance: SceneDistance, progress: Progress | None = None) -> list[Check]:
    """Check a plan that was read from its files: its trajectory against its scenario, and its figures against both.

    Args:
        plan: as read.
        distance: exact distance to the scene, built from the plan's own meshes and cables.
        progress: reports the stage `certificates`.

    Returns:
        Every check, whether it holds or not. What was seen of the surface is not among them.
    """
    built = BuiltTrajectory(
        trajectory=plan.trajectory,
        corridor_m=plan.corridor_m,
        corridor_planes=plan.corridor_planes,
        yaw=plan.yaw,
        gimbal_pitch=plan.gimbal_pitch,
        exposures_s=np.array([v.time_s for v in plan.viewpoints]),
        stops=np.array([v.stops for v in plan.viewpoints], dtype=np.bool_),
    )
    figures = measure(built, plan.path_m, plan.viewpoints, plan.scenario, distance, progress or SilentProgress())
    sharpness = measure_sharpness(plan.trajectory, plan.viewpoints, plan.scenario)
    checks = [*check_figures(figures, plan.scenario), *check_sharpness(sharpness, plan.scenario)]
    home = np.asarray(plan.scenario.home_m)
    ends = plan.trajectory.value([0.0, plan.trajectory.duration_s])
    checks.append(
        _at_most("home", float(np.linalg.norm(ends - home, axis=1).max()), 1e-3, "m", "start or end from home")
    )
    stops = np.array([home, *(v.position_m for v in plan.viewpoints), home])
    off = np.linalg.norm(plan.path_m[plan.path_stops] - stops, axis=1)
    checks.append(_at_most("path_stops", float(off.max()), 1e-3, "m", "a stop of the path from its viewpoint"))
    again = {**vars(figures), "max_blur_px": sharpness.max_blur_px, "max_skew_px": sharpness.max_skew_px}
    for name, tolerance in _SAME.items():
        recorded, computed = getattr(plan.certificates, name), again[name]
        if recorded is None and computed is None:
            continue
        recorded, computed = (math.inf if figure is None else figure for figure in (recorded, computed))
        checks.append(
            _at_most(
                f"recorded {name}",
                abs(recorded - computed),
                tolerance,
                "",
                f"recorded {recorded:.4f}, computed {computed:.4f}, difference",
            )
        )
    return checks
