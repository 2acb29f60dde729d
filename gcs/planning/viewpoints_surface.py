"""Viewpoints for a surface: sampled sides, candidate views, and a greedy cover of what can be seen."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.errors import InfeasibleError
from gcs.planning.camera_footprint import footprint_area
from gcs.planning.cover_problem import CoverProblem, joined_members
from gcs.planning.coverage import seen_targets
from gcs.planning.set_cover import greedy_cover
from gcs.planning.surface_candidates import STAGE, CandidateSearch
from gcs.planning.surface_samples import sample_surface, surface_area
from gcs.planning.viewpoint_pose import pose_towards

if TYPE_CHECKING:
    from collections.abc import Sequence

    from gcs.core.inspection import SurfaceTask
    from gcs.core.progress import Progress
    from gcs.core.scenario import Scenario
    from gcs.core.structure import Structure
    from gcs.planning.free_space import FreeSpace
    from gcs.planning.viewpoint_pose import ViewpointPose
    from gcs.planning.visibility import SightLines

COVERED_SHARE = 0.982
"""Of the sampled sides that any candidate sees. The rest are slits that each cost a view of their own."""

SAMPLES_PER_PICTURE = 60
FEWEST_SAMPLES, MOST_SAMPLES = 16000, 30000
DENSEST_PER_PICTURE = 4000
"""No more samples than this for every picture's worth of surface, however small the surface is."""

LEAST_SAMPLES = 300

UNDER_COVER = 0.9
NEAREST = 0.9
"""Factors on what a view adds: for one that is not under the open sky, and (falling linearly) for the nearest one.
They decide between views that are about equally good."""


def find_surface_viewpoints(
    scenario: Scenario,
    task: SurfaceTask,
    structure: Structure,
    space: FreeSpace,
    sight: SightLines,
    furthest_m: float,
    earlier: Sequence[ViewpointPose],
    progress: Progress,
) -> tuple[list[ViewpointPose], CoverProblem]:
    """Choose views that together see the surface.

    Args:
        scenario: camera and seed.
        task: what is asked.
        structure: what is looked at.
        space: where the vehicle may be.
        sight: what hides the surface.
        furthest_m: largest distance of a viewpoint from what it looks at.
        earlier: views that are taken anyway; what they see need not be seen again.
        progress: told about the stage `viewpoints`.

    Returns:
        The views in the order they were chosen, and the cover that they answer.

    Raises:
        InfeasibleError: the GSD asks for less than the clearance, or nothing can be seen.
    """
    camera = scenario.camera
    needed = camera.distance_for_gsd(task.gsd_mm / 1000)
    if needed < space.clearance_m:
        best = 1000 * camera.gsd_at(space.clearance_m)
        raise InfeasibleError(
            f"a GSD of {task.gsd_mm:g} mm asks for {needed:.2f} m, but the vehicle keeps {space.clearance_m:.2f} m "
            f"(hull, error budget and corridor): the best it can have is {best:.2f} mm",
            field="inspection.surface.gsd_mm",
        )
    rng = np.random.default_rng(scenario.planner.seed)
    area = surface_area(structure, task.regions)
    core = (1 - task.overlap) ** 2 * footprint_area(camera, furthest_m)
    samples = np.clip(SAMPLES_PER_PICTURE * area / core, FEWEST_SAMPLES, MOST_SAMPLES)
    samples = max(min(int(samples), int(DENSEST_PER_PICTURE * area / core)), LEAST_SAMPLES)
    targets = sample_surface(structure, samples, rng, task.regions)
    covered = seen_targets(camera, task, earlier, targets, sight, progress, stage=STAGE)
    search = CandidateSearch(targets, task, camera, furthest_m, space, sight, rng)
    candidates = search.find(area, progress)
    if not candidates:
        raise InfeasibleError(
            "no free place sees any of the surface at the asked GSD and incidence: allow a coarser GSD, more incidence "
            "or a smaller clearance",
            field="inspection.surface",
        )
    depth = np.array([c.depth_m for c in candidates])
    open_sky = np.array([c.open_sky for c in candidates])
    preference = np.where(open_sky, 1.0, UNDER_COVER)
    preference *= NEAREST + (1 - NEAREST) * np.minimum(depth / needed, 1.0)
    sets = [c.members for c in candidates]
    chosen = greedy_cover(
        sets,
        len(targets),
        preference=preference,
        covered=covered,
        share=COVERED_SHARE,
        poll=lambda: progress.report(STAGE, 0.95),
    )
    starts, members = joined_members(sets)
    possible = covered.copy()
    possible[members] = True
    wanted = math.ceil(COVERED_SHARE * int(possible.sum()) - 1e-9)
    problem = CoverProblem(starts, members, len(targets), covered, wanted, np.array(chosen, dtype=np.int64))
    poses = [
        pose_towards(f"S{n + 1:04d}", candidates[k].position_m, candidates[k].direction, camera.gsd_at(depth[k]))
        for n, k in enumerate(chosen)
    ]
    return poses, problem
