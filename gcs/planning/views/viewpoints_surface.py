"""Viewpoints for a surface: sampled sides, what of them can be seen, and a cover of that by few views."""

from __future__ import annotations

import math
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.errors import InfeasibleError
from gcs.planning.views.cover_problem import CoverProblem
from gcs.planning.views.picture_kernels import PictureLimits
from gcs.planning.views.picture_limits import distance_for, nearest_place, nearest_sharp_m
from gcs.planning.views.seeable_sides import SeeableSides, find_seeable, joined
from gcs.planning.views.surface_candidates import STAGE, CandidateViews, Targets, ViewSearch, nothing
from gcs.planning.views.surface_cover import SurfaceCover
from gcs.planning.views.surface_samples import in_spatial_order, sample_surface
from gcs.planning.views.viewpoint_pose import gimbal_pitch_range_rad, pose_towards

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from gcs.core.inspection import SurfaceTask
    from gcs.core.progress import Progress
    from gcs.core.scenario import Scenario
    from gcs.core.structure import Structure
    from gcs.planning.scene.free_space import FreeSpace
    from gcs.planning.scene.visibility import SightLines
    from gcs.planning.views.viewpoint_pose import ViewpointPose

SAMPLES, MOST_SAMPLES = 100_000, 400_000
"""Points of the surface; both sides of each are looked at."""

LEAST_ROOM = 1.03
"""Factor on the distance of the nearest free places: a surface is not seen from one place only."""

SIDES_PER_VIEW = 500
"""There are more points when fewer seeable sides than this come to a view: what lies between would be missed."""

LEAST_MORE = 0.2
"""Share of the points that is worth adding."""

STRICTER = 1e-5
"""Added to the cosine of the incidence: pictures are judged in single precision here, and in double afterwards."""


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

    A view counts for a side if its picture shows it unoccluded, from that side, within the incidence limit, sharp, and
    at no more than the GSD. It also has to lie in the middle of the picture: the image less `overlap` of its width and
    height. Where the middles of neighbouring pictures meet, the pictures overlap by that share. The position and
    tracking errors are allowed for: with the camera that far off to a side the picture still shows the side (half of
    the image is left at least), and with it that far back the GSD still holds (as far as the clearance leaves room
    for). What could not be shown so by any candidate is shown without that allowance.

    Args:
        scenario: camera, error budget and seed.
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
    nearest = nearest_place(scenario, LEAST_ROOM * space.nearest_m)
    furthest = distance_for(camera, task.gsd_mm, nearest, furthest_m, "inspection.surface.gsd_mm")
    limits = _limits(scenario, task, furthest, nearest.distance_m)
    rng = np.random.default_rng(scenario.planner.seed)
    search = ViewSearch(limits, sight)
    nearest_m, furthest_place_m = 1.01 * scenario.centre_clearance_m, 0.99 * furthest
    views = _views_of(earlier, scenario, sight.middle_m)
    whole = ViewSearch(limits._replace(core=1.0, error=0.0, depth_error=0.0), sight)

    def sampled(points: int, begun: float, ended: float) -> tuple[Targets, SeeableSides, int]:
        """Sides that are seeable but not by the earlier views, how they are seen, and how many are by earlier ones."""
        sides = Targets.of(in_spatial_order(sample_surface(structure, points, rng, task.regions)), sight.middle_m)
        tell = partial(_tell, progress, begun, ended)
        left = np.ones(len(sides), dtype=np.bool_)
        left[whole.shown(views, sides, tell)[1]] = False
        sides = sides[np.flatnonzero(left)]
        seeable = find_seeable(sides, nearest_m, furthest_place_m, limits, space, sight, rng, tell)
        return sides[seeable.which], seeable, int(np.count_nonzero(~left))

    targets, seeable, seen = sampled(SAMPLES, 0.1, 0.3)
    if not len(targets):
        if seen:
            return [], CoverProblem.empty()
        raise InfeasibleError(
            "no free place sees any of the surface at the asked GSD and incidence: allow a coarser GSD, more incidence "
            "or a smaller clearance",
            field="inspection.surface",
        )
    cover = SurfaceCover(targets, seeable, search, space, sight.middle_m, furthest, rng, progress)
    about = cover.views_about()
    more = min(SIDES_PER_VIEW * about / len(targets), MOST_SAMPLES / SAMPLES) - 1
    if more > LEAST_MORE:
        extra, also_seeable, _ = sampled(math.ceil(more * SAMPLES), 0.35, 0.5)
        both = joined(seeable, also_seeable)
        cover = SurfaceCover(
            Targets.joined(targets, extra), both, search, space, sight.middle_m, furthest, rng, progress
        )
    problem = cover.solve(about)
    chosen = cover.views[problem.chosen]
    poses = [
        pose_towards(f"S{n + 1:04d}", place.astype(np.float64) + sight.middle_m, axes[6:9], camera.gsd_at(focus))
        for n, (place, axes, focus) in enumerate(zip(chosen.places, chosen.axes, chosen.focus_m, strict=True))
    ]
    return poses, problem


def _tell(progress: Progress, begun: float, ended: float, share: float) -> None:
    progress.report(STAGE, begun + share * (ended - begun))


def _limits(scenario: Scenario, task: SurfaceTask, furthest_m: float, nearest_m: float) -> PictureLimits:
    camera, safety = scenario.camera, scenario.safety
    error = safety.position_m + safety.tracking_m
    pitch_low, pitch_high = gimbal_pitch_range_rad(camera.gimbal.pitch_min_deg, camera.gimbal.pitch_max_deg)
    return PictureLimits(
        half_width=camera.half_width_tangent,
        half_height=camera.half_height_tangent,
        core=1 - task.overlap,
        nearest=nearest_sharp_m(camera, scenario.vehicle, safety.position_m),
        furthest=furthest_m,
        error=error,
        depth_error=min(error, (furthest_m - nearest_m) / 2),
        focal=camera.focal_length_mm / 1000,
        hyperfocal=camera.hyperfocal_m,
        nearest_focus=camera.nearest_focus_m,
        least_cosine=math.cos(math.radians(task.max_incidence_deg)) + STRICTER,
        pitch_low=pitch_low,
        pitch_high=pitch_high,
    )


def _views_of(poses: Sequence[ViewpointPose], scenario: Scenario, middle_m: NDArray[np.float64]) -> CandidateViews:
    """Poses as candidates that show nothing yet."""
    if not poses:
        return nothing()
    return CandidateViews(
        (np.array([p.position_m for p in poses]) - middle_m).astype(np.float32),
        np.array([np.concatenate([np.cross(p.direction, p.up), p.up, p.direction]) for p in poses]),
        np.array([scenario.camera.distance_for_gsd(p.gsd_m) for p in poses]),
        np.zeros(len(poses) + 1, dtype=np.int64),
        np.zeros(0, dtype=np.int32),
    )
