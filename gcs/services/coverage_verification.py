"""The part of `gcs verify` that looks at the surface: what the viewpoints see of it, sampled anew."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.progress import SilentProgress
from gcs.core.surface_coverage import Verdict
from gcs.planning.certificates import Check
from gcs.planning.scene.fence import fence_volume
from gcs.planning.views.coverage import SAMPLES, certify_coverage
from gcs.planning.views.viewpoint_pose import gimbal_pitch_range_rad
from gcs.planning.views.viewpoints_spots import count_spots

if TYPE_CHECKING:
    from gcs.core.plan import Plan
    from gcs.core.structure import Structure
    from gcs.core.surface_coverage import SurfaceCoverage
    from gcs.planning.scene.point_distance import SceneDistance

OTHER_SEED = 20_011
"""The surface is sampled anew: with another seed than any planner option has."""

TOLERANCE = 0.01
"""Of shares: what other samples and other tries may make of the same viewpoints."""

AREA_TOLERANCE = 1e-6
PITCH_TOLERANCE_RAD = 1e-6


def recheck_coverage(
    plan: Plan, structure: Structure, distance: SceneDistance, *, samples: int = SAMPLES
) -> list[Check]:
    """Hold what a plan says of the surface against new samples; nothing when it asks for no surface.

    Args:
        plan: as read.
        structure: as read.
        distance: exact distances.
        samples: points that are looked at, two sides each.
    """
    scenario, told = plan.scenario, plan.certificates
    if scenario.inspection is None or scenario.inspection.surface is None:
        return []
    if plan.coverage is None or told.coverage is None or told.coverable is None:
        return [Check("coverage", False, 0.0, 1.0, "coverage: the plan does not say what is seen of the surface")]
    fence = fence_volume(scenario.fence, scenario.vehicle, scenario.safety)
    found = certify_coverage(
        scenario, structure, plan.viewpoints, fence, distance, SilentProgress(), seed=OTHER_SEED, samples=samples
    )
    if found is None:
        raise AssertionError("a surface was asked for")
    share, able = found.share_seen, found.share_coverable
    text = f"coverage: {share:.2%} of what is coverable, reported {told.coverage:.2%}"
    more = f"coverable: {able:.2%} of all sides, reported {told.coverable:.2%}"
    return [
        Check("coverage", share >= told.coverage - TOLERANCE, share, told.coverage, text),
        Check("coverable", abs(able - told.coverable) <= TOLERANCE, able, told.coverable, more),
        _reasons(plan.coverage, found),
        _areas(plan.coverage, told.not_covered_m2 or {}),
        _bound(told.viewpoints_lower_bound, told.viewpoints),
        *_spots(plan, structure, distance),
    ]


def _spots(plan: Plan, structure: Structure, distance: SceneDistance) -> list[Check]:
    scenario = plan.scenario
    fence = fence_volume(scenario.fence, scenario.vehicle, scenario.safety)
    found = count_spots(scenario, structure, plan.viewpoints, fence, distance, SilentProgress())
    if found is None:
        return []
    told = plan.certificates.spots or {}
    text = ", ".join(f"{Verdict[label.upper()].words}: {count}" for label, count in sorted(found.items()))
    return [Check("spots", found == told, found.get("seen", 0), told.get("seen", 0), f"spots: {text}")]


def check_gimbal(plan: Plan) -> Check:
    """Every viewpoint's direction lies within the camera's pitch range."""
    gimbal = plan.scenario.camera.gimbal
    low, high = gimbal_pitch_range_rad(gimbal.pitch_min_deg, gimbal.pitch_max_deg)
    direction = np.array([v.direction for v in plan.viewpoints]).reshape(-1, 3)
    pitch = np.arctan2(direction[:, 2], np.hypot(direction[:, 0], direction[:, 1]))
    outside = np.maximum(low - pitch, pitch - high)
    worst = float(outside.max(initial=-math.pi))
    where = f", at {plan.viewpoints[int(outside.argmax())].name}" if len(outside) else ""
    text = f"outside the camera's pitch range: {max(math.degrees(worst), 0.0):.3f} degrees at most{where}"
    return Check("gimbal_range", worst <= PITCH_TOLERANCE_RAD, worst, 0.0, text)


def _reasons(told: SurfaceCoverage, found: SurfaceCoverage) -> Check:
    before, again = told.shares(), found.shares()
    off = {v: abs(before.get(v, 0.0) - again.get(v, 0.0)) for v in Verdict}
    worst = max(off, key=lambda v: off[v])
    text = (
        f"why sides are not seen: `{worst.label}` differs most, {again.get(worst, 0.0):.2%} of all sides, "
        f"reported {before.get(worst, 0.0):.2%}"
    )
    return Check("coverage_reasons", off[worst] <= TOLERANCE, off[worst], TOLERANCE, text)


def _areas(coverage: SurfaceCoverage, told: dict[str, float]) -> Check:
    areas = coverage.not_covered_m2()
    off = max((abs(areas.get(k, 0.0) - told.get(k, 0.0)) for k in areas.keys() | told.keys()), default=0.0)
    limit = AREA_TOLERANCE * coverage.area_m2
    return Check("not_covered_m2", off <= limit, off, limit, f"areas by reason: off by {off:.3g} m2 from the samples'")


def _bound(bound: float | None, viewpoints: int) -> Check:
    value = math.inf if bound is None else bound
    text = f"lower bound of the number of viewpoints: {value:.2f}, and there are {viewpoints}"
    return Check("viewpoints_lower_bound", value <= viewpoints + 1e-6, value, float(viewpoints), text)
