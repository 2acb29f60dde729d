"""The certificate of coverage: which sides of the surface the finished viewpoints see, and why not the others.

It shares only definitions with the search for viewpoints: it has its own samples, looks at the whole pictures as they
will be taken, and asks for every side that is not seen whether any place could have seen it, and what is in the way.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.surface_coverage import SurfaceCoverage, Verdict
from gcs.planning.scene.outer_space import build_outer_space
from gcs.planning.scene.visibility import SightLines
from gcs.planning.views.coverage_places import PlaceLimits
from gcs.planning.views.coverage_reasons import Sides, Surroundings, judge_unseen
from gcs.planning.views.picture_kernels import LIFT_M
from gcs.planning.views.picture_limits import nearest_sharp_m
from gcs.planning.views.pictured_sides import Shown, pictured_sides
from gcs.planning.views.surface_samples import sample_surface, surface_area
from gcs.planning.views.viewpoint_pose import gimbal_pitch_range_rad

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from gcs.core.progress import Progress
    from gcs.core.scenario import Scenario
    from gcs.core.structure import Structure
    from gcs.planning.scene.fence import FenceVolume
    from gcs.planning.scene.point_distance import SceneDistance
    from gcs.planning.views.pictured_sides import View

STAGE = "coverage"
SAMPLES = 100_000
"""Points of the surface; both sides of each are judged."""

SEED_OFFSET = 0x5EED
"""Keeps the certificate's samples apart from those that the viewpoints were chosen with."""

MOST_MARGIN_M = 25.0


def certify_coverage(
    scenario: Scenario,
    structure: Structure,
    viewpoints: Sequence[View],
    fence: FenceVolume,
    distance: SceneDistance,
    progress: Progress,
    *,
    seed: int | None = None,
    samples: int = SAMPLES,
) -> SurfaceCoverage | None:
    """Find out what viewpoints cover of the surface, and why they do not cover the rest.

    A target is one side of a sampled point. It is seen if a picture shows it unoccluded, sharp, from its side, within
    the incidence limit and at no more than the GSD (by its depth along the camera's axis). It is coverable if it is
    seen, or if a place at the clearance, connected with the outside, inside the fence, from which the gimbal can look
    at it, no further than the GSD allows, sees it so. The others have the reason of `coverage_reasons`.

    Args:
        scenario: the surface task, the camera and the clearance.
        structure: what is looked at, and what hides it.
        viewpoints: the pictures.
        fence: what viewpoints have to stay in.
        distance: exact distances.
        progress: told about the stage `coverage`.
        seed: of the samples; by default one that goes with the planner's.
        samples: how many points are judged, two sides each.

    Returns:
        None when no surface was asked for.

    Raises:
        InputError: there is no surface in the regions.
    """
    task = scenario.inspection.surface if scenario.inspection else None
    if task is None:
        return None
    rng = np.random.default_rng([scenario.planner.seed, SEED_OFFSET] if seed is None else seed)
    targets = sample_surface(structure, samples, rng, task.regions)
    verdicts = judge_targets(
        scenario, structure, viewpoints, targets.points_m, targets.normals, fence, distance, progress, rng=rng
    )
    area = 2 * surface_area(structure, task.regions)
    return SurfaceCoverage(targets.points_m, targets.normals, verdicts, area)


def judge_targets(
    scenario: Scenario,
    structure: Structure,
    viewpoints: Sequence[View],
    points_m: NDArray[np.float64],
    normals: NDArray[np.float64],
    fence: FenceVolume,
    distance: SceneDistance,
    progress: Progress,
    *,
    rng: np.random.Generator,
    lift_m: float = LIFT_M,
) -> NDArray[np.uint8]:
    """Say of points of the surface whether viewpoints show them as the surface task asks, and if not, why not.

    Args:
        scenario: with a surface task.
        structure: what hides the points.
        viewpoints: the pictures.
        points_m: scene ENU, shape (N, 3).
        normals: the side of each, unit, shape (N, 3).
        fence: what viewpoints have to stay in.
        distance: exact distances.
        progress: told about the stage `coverage`.
        rng: the source of randomness for places that are tried.
        lift_m: points are looked at this far above their side, so that their own surface does not hide them; more for
            points that lie on the surface only roughly.

    Returns:
        Values of `Verdict`, shape (N,).

    Raises:
        ValueError: the scenario has no surface task.
    """
    task = scenario.inspection.surface if scenario.inspection else None
    if task is None:
        raise ValueError("the scenario asks for no surface")
    sight = SightLines(structure)
    shown = Shown.as_asked(task, scenario)
    reach = shown.furthest_m
    sides = Sides(points_m, normals, points_m + lift_m * normals)
    seen = pictured_sides(*sides, viewpoints, shown, sight, progress, STAGE)
    clearance = scenario.centre_clearance_m
    ground = -math.inf if distance.ground_m is None else float(distance.ground_m)
    gimbal = scenario.camera.gimbal
    pitch = gimbal_pitch_range_rad(gimbal.pitch_min_deg, gimbal.pitch_max_deg)
    nearest = nearest_sharp_m(scenario.camera, scenario.vehicle, 0.0)
    limits = PlaceLimits(clearance, nearest, reach, shown.steepest_rad, *pitch, ground)
    margin = min(reach, MOST_MARGIN_M) + clearance + 2.0
    outer = build_outer_space(
        distance, clearance, structure.bounds_m, margin, poll=lambda: progress.report(STAGE, 0.35)
    )
    verdicts = np.full(len(points_m), Verdict.SEEN, dtype=np.uint8)
    left = ~seen
    verdicts[left] = judge_unseen(
        Sides(*(part[left] for part in sides)),
        Surroundings(limits, outer, fence, distance, sight),
        rng,
        lambda share: progress.report(STAGE, 0.4 + 0.6 * share),
    )
    progress.report(STAGE, 1.0)
    return verdicts
