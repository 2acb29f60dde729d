"""A finished plan as columns for drawing."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from gcs.api.schemas.base import Box
from gcs.api.schemas.plans import CoverageSamples, PlanDetail, PlanReport, TrajectorySamples, ViewpointInfo
from gcs.api.views import cable_line, geo_position, point3
from gcs.core.surface_coverage import Verdict

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from gcs.core.plan import Plan
    from gcs.core.surface_coverage import SurfaceCoverage
    from gcs.storage.records import PlanRecord

SAMPLE_STEP_S = 0.2
MAX_TRAJECTORY_SAMPLES = 6000
MAX_COVERAGE_SAMPLES = 20000


def plan_detail(record: PlanRecord, plan: Plan) -> PlanDetail:
    """Everything the dashboard draws of a ready plan.

    Args:
        record: of the database, with its hash and report.
        plan: as read from its files.
    """
    scenario = plan.scenario
    return PlanDetail(
        id=record.id,
        name=record.name,
        plan_hash=record.plan_hash or "",
        anchor=geo_position(scenario.anchor.point),
        home_m=scenario.home_m,
        ground_m=scenario.ground_m,
        scenario=scenario.model_dump(mode="json", exclude_none=True),
        cables=[cable_line(c) for c in plan.cables],
        viewpoints=[
            ViewpointInfo(
                id=v.id,
                name=v.name,
                position_m=point3(v.position_m),
                direction=point3(v.direction),
                up=point3(v.up),
                gsd_mm=v.gsd_m * 1000,
                time_s=v.time_s,
                yaw_deg=math.degrees(v.yaw_rad),
                gimbal_pitch_deg=math.degrees(v.gimbal_pitch_rad),
            )
            for v in plan.viewpoints
        ],
        path_m=_points(plan.path_m),
        trajectory=_trajectory(plan),
        corridor=[Box(low_m=point3(box[0]), high_m=point3(box[1])) for box in plan.corridor_m],
        coverage=None if plan.coverage is None else _coverage(plan.coverage),
        report=PlanReport.model_validate(record.report),
    )


def _points(array: NDArray[np.float64]) -> list[tuple[float, float, float]]:
    return [(x, y, z) for x, y, z in np.round(array, 4).tolist()]


def _trajectory(plan: Plan) -> TrajectorySamples:
    duration = plan.trajectory.duration_s
    count = int(np.clip(math.ceil(duration / SAMPLE_STEP_S) + 1, 2, MAX_TRAJECTORY_SAMPLES))
    t = np.linspace(0.0, duration, count)
    speed = np.linalg.norm(plan.trajectory.value(t, 1), axis=-1)
    return TrajectorySamples(
        t_s=np.round(t, 4).tolist(),
        position_m=_points(plan.trajectory.value(t)),
        speed_m_s=np.round(speed, 4).tolist(),
        yaw_deg=np.round(np.degrees(plan.yaw.value(t)), 3).tolist(),
        gimbal_pitch_deg=np.round(np.degrees(plan.gimbal_pitch.value(t)), 3).tolist(),
    )


def _coverage(coverage: SurfaceCoverage) -> CoverageSamples:
    total = len(coverage.points_m)
    chosen = np.unique(np.linspace(0, max(total - 1, 0), min(total, MAX_COVERAGE_SAMPLES)).astype(np.int64))
    return CoverageSamples(
        points_m=_points(coverage.points_m[chosen]),
        normals=_points(coverage.normals[chosen]),
        seen=coverage.seen[chosen].tolist(),
        coverable=coverage.coverable[chosen].tolist(),
        verdicts=[Verdict(v).label for v in coverage.verdicts[chosen].tolist()],
        samples=total,
    )
