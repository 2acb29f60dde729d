"""The certificate of coverage: which sides of the surface the finished viewpoints see, of those that could be seen.

It shares only definitions with the search for viewpoints (what a picture shows, where a random place lies): it has its
own samples, looks at the whole pictures as they will be taken, and asks for every side that is not seen whether any
place could have seen it.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Protocol

import numpy as np

from gcs.core.plan import SurfaceCoverage
from gcs.planning.camera_footprint import faces_camera, sharp_in_image
from gcs.planning.outer_space import OuterSpace
from gcs.planning.surface_samples import sample_surface
from gcs.planning.viewpoint_pose import gimbal_pitch_range_rad
from gcs.planning.visibility import SightLines

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from gcs.core.camera import Camera
    from gcs.core.inspection import SurfaceTask
    from gcs.core.progress import Progress
    from gcs.core.scenario import Scenario
    from gcs.core.structure import Structure
    from gcs.planning.fence import FenceVolume
    from gcs.planning.point_distance import SceneDistance
    from gcs.planning.surface_samples import SurfaceSamples

STAGE = "coverage"
SAMPLES = 20000
TRIES = 32
"""Places that are tried for every side before it counts as one that nobody can see."""

SEED_OFFSET = 0x5EED
"""Keeps the certificate's samples apart from those that the viewpoints were chosen with."""

MOST_MARGIN_M = 25.0


class View(Protocol):
    """What a picture needs; both poses and planned viewpoints have it."""

    @property
    def position_m(self) -> NDArray[np.float64]:
        """Camera position, shape (3,)."""
        ...

    @property
    def direction(self) -> NDArray[np.float64]:
        """Unit view direction, shape (3,)."""
        ...

    @property
    def up(self) -> NDArray[np.float64]:
        """Unit upward direction of the image, shape (3,)."""
        ...

    @property
    def gsd_m(self) -> float:
        """Ground sampling distance (m a pixel) where it is focused."""
        ...


def certify_coverage(
    scenario: Scenario,
    structure: Structure,
    viewpoints: Sequence[View],
    fence: FenceVolume,
    distance: SceneDistance,
    progress: Progress,
    *,
    seed: int | None = None,
) -> SurfaceCoverage | None:
    """Find out what viewpoints cover of the surface.

    A target is one side of a sampled point. It is seen if a picture shows it unoccluded, from its side, within the
    incidence limit and at no more than the GSD (by its depth along the camera's axis). It is coverable if it is seen,
    or if a place at the clearance, connected with the outside, inside the fence, from which the gimbal can look at
    it, no further than the GSD allows, sees it so.

    Args:
        scenario: the surface task, the camera and the clearance.
        structure: what is looked at, and what hides it.
        viewpoints: the pictures.
        fence: what viewpoints have to stay in.
        distance: exact distances.
        progress: told about the stage `coverage`.
        seed: of the samples; by default one that goes with the planner's.

    Returns:
        None when no surface was asked for.
    """
    task = scenario.inspection.surface if scenario.inspection else None
    if task is None:
        return None
    rng = np.random.default_rng([scenario.planner.seed, SEED_OFFSET] if seed is None else seed)
    targets = sample_surface(structure, SAMPLES, rng, task.regions)
    sight = SightLines(structure)
    seen = seen_targets(scenario.camera, task, viewpoints, targets, sight, progress)
    coverable = seen.copy()
    reach = scenario.camera.distance_for_gsd(task.gsd_mm / 1000)
    clearance = scenario.centre_clearance_m
    if reach > clearance:
        margin = min(reach, MOST_MARGIN_M) + clearance + 2.0
        outer = OuterSpace(
            distance, clearance, structure.bounds_m, margin, fence, poll=lambda: progress.report(STAGE, 0.35)
        )
        for round_ in range(TRIES):
            todo = np.flatnonzero(~coverable)
            if not len(todo):
                break
            spread = 0.0 if round_ == 0 else 1.0
            places = random_places(targets[todo], task, clearance, reach, rng, spread=spread, near=round_ % 2 == 0)
            coverable[todo] = can_see(places, targets[todo], scenario.camera, outer, sight)
            progress.report(STAGE, 0.4 + 0.6 * (round_ + 1) / TRIES)
    progress.report(STAGE, 1.0)
    return SurfaceCoverage(targets.points_m, targets.normals, seen, coverable)


def seen_targets(
    camera: Camera,
    task: SurfaceTask,
    viewpoints: Sequence[View],
    targets: SurfaceSamples,
    sight: SightLines,
    progress: Progress,
    *,
    stage: str = STAGE,
) -> NDArray[np.bool_]:
    """Which targets at least one picture shows as asked, shape (N,)."""
    reach = camera.distance_for_gsd(task.gsd_mm / 1000)
    incidence = math.radians(task.max_incidence_deg)
    seen = np.zeros(len(targets), dtype=np.bool_)
    lifted = targets.lifted_m
    for done, view in enumerate(viewpoints):
        left = np.flatnonzero(~seen)
        focus = camera.distance_for_gsd(view.gsd_m)
        pose = view.position_m, view.direction, view.up
        left = left[sharp_in_image(camera, *pose, targets.points_m[left], reach, focus)]
        left = left[faces_camera(view.position_m, targets.points_m[left], targets.normals[left], incidence)]
        seen[left[sight.clear(view.position_m, lifted[left])]] = True
        if done % 8 == 0:
            progress.report(stage, 0.3 * done / len(viewpoints))
    return seen


def random_places(
    targets: SurfaceSamples,
    task: SurfaceTask,
    nearest_m: float,
    furthest_m: float,
    rng: np.random.Generator,
    *,
    spread: float = 1.0,
    near: bool = False,
) -> NDArray[np.float64]:
    """A random place in front of every target, within the incidence limit and between two distances.

    Args:
        targets: N sides of the surface.
        task: gives the incidence limit.
        nearest_m: smallest distance.
        furthest_m: largest distance.
        rng: the source of randomness.
        spread: share of the incidence limit that is used; 0 means straight along the normals.
        near: favour the small distances.

    Returns:
        Shape (N, 3).
    """
    n = len(targets)
    tilt = spread * 0.97 * math.radians(task.max_incidence_deg) * np.sqrt(rng.random(n))
    azimuth = 2 * np.pi * rng.random(n)
    normal = targets.normals
    reference = np.where(np.abs(normal[:, 2:]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
    side = np.cross(normal, reference)
    side /= np.linalg.norm(side, axis=1)[:, None]
    across = np.cos(azimuth)[:, None] * side + np.sin(azimuth)[:, None] * np.cross(normal, side)
    direction = np.cos(tilt)[:, None] * normal + np.sin(tilt)[:, None] * across
    share = rng.random(n) ** (2.0 if near else 0.5)
    length = 1.01 * nearest_m + (0.99 * furthest_m - 1.01 * nearest_m) * share
    return np.asarray(targets.points_m + np.clip(length, None, furthest_m)[:, None] * direction)


def can_see(
    places_m: NDArray[np.float64], targets: SurfaceSamples, camera: Camera, outer: OuterSpace, sight: SightLines
) -> NDArray[np.bool_]:
    """Whether a camera could be at each place and look at its target from there, shape (N,)."""
    gimbal = camera.gimbal
    lowest, highest = gimbal_pitch_range_rad(gimbal.pitch_min_deg, gimbal.pitch_max_deg)
    ray = targets.points_m - places_m
    pitch = np.arctan2(ray[:, 2], np.hypot(ray[:, 0], ray[:, 1]))
    ok = (pitch >= lowest) & (pitch <= highest)
    ok[ok] = outer.holds(places_m[ok])
    ok[ok] = sight.clear(places_m[ok], targets.lifted_m[ok])
    return np.asarray(ok)
