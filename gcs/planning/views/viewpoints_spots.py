"""Viewpoints for the spots that the surface's pictures leave out, and what becomes of every spot."""

from __future__ import annotations

import collections
import math
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.surface_coverage import Verdict
from gcs.planning.views.coverage import STAGE, judge_targets
from gcs.planning.views.coverage_reasons import STEEPEST_SHARE, Sides
from gcs.planning.views.pictured_sides import Shown, pictured_sides
from gcs.planning.views.viewpoint_pose import camera_angles, gimbal_pitch_range_rad, pose_towards

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from gcs.core.inspection import Spot, SurfaceTask
    from gcs.core.progress import Progress
    from gcs.core.scenario import Scenario
    from gcs.core.structure import Structure
    from gcs.planning.scene.fence import FenceVolume
    from gcs.planning.scene.free_space import FreeSpace
    from gcs.planning.scene.point_distance import SceneDistance
    from gcs.planning.scene.visibility import SightLines
    from gcs.planning.views.pictured_sides import View
    from gcs.planning.views.viewpoint_pose import ViewpointPose

SPOT_LIFT_M = 0.01
"""Spots are looked at this far above their surface: they may lie that deep in it."""

TRIES = 20_000
"""Places that are tried for a spot."""

SEED = 4049


def judge_spots(
    scenario: Scenario,
    structure: Structure,
    task: SurfaceTask,
    views: Sequence[View],
    fence: FenceVolume,
    distance: SceneDistance,
    progress: Progress,
) -> NDArray[np.uint8]:
    """Say of every spot whether viewpoints show it as the surface task asks, and if not, why not.

    Args:
        scenario: with that surface task.
        structure: what hides spots.
        task: names the spots.
        views: the pictures.
        fence: what viewpoints have to stay in.
        distance: exact distances.
        progress: told about the stage `coverage`.

    Returns:
        Values of `Verdict`, in the order of the spots.
    """
    places, normals, _ = _sides(task)
    rng = np.random.default_rng(SEED)
    return judge_targets(
        scenario,
        structure,
        views,
        places,
        normals,
        fence,
        distance,
        progress,
        rng=rng,
        lift_m=SPOT_LIFT_M,
    )


def find_spot_viewpoints(
    scenario: Scenario,
    structure: Structure,
    task: SurfaceTask,
    poses: Sequence[ViewpointPose],
    space: FreeSpace,
    distance: SceneDistance,
    sight: SightLines,
    nearest_m: float,
    furthest_m: float,
    progress: Progress,
) -> list[ViewpointPose]:
    """A viewpoint for each spot that could be seen and is not: those of the surface leave out a little.

    The position error is allowed for in the GSD where that leaves a place. More places are tried than for a verdict.

    Args:
        scenario: with that surface task.
        structure: what hides spots.
        task: names the spots.
        poses: the viewpoints that there are.
        space: where the vehicle may be.
        distance: exact distances.
        sight: what hides spots.
        nearest_m: smallest distance from a spot.
        furthest_m: no place is further away.
        progress: told about the stage `coverage`.

    Returns:
        The added viewpoints. A spot for which there is no such place stays left out; `judge_spots` tells.
    """
    rng = np.random.default_rng(scenario.planner.seed)
    lengths = (furthest_m - scenario.safety.position_m, furthest_m)
    shown, sides = Shown.as_asked(task, scenario), _sides(task)
    added: list[ViewpointPose] = []
    tried = np.zeros(len(task.spots), dtype=np.bool_)
    while True:
        verdicts = judge_spots(scenario, structure, task, [*poses, *added], space.model.fence, distance, progress)
        left = ~np.isin(verdicts, (Verdict.SEEN, Verdict.OCCLUDED)) & ~tried
        if not left.any():
            return added
        for number, spot in enumerate(task.spots):
            if not left[number]:
                continue
            tried[number] = True
            found = (_viewpoint(spot, task, scenario, space, sight, nearest_m, far, rng) for far in lengths)
            pose = next((pose for pose in found if pose is not None), None)
            if pose is not None:
                added.append(pose)
                left &= ~pictured_sides(*sides, [pose], shown, sight, progress, STAGE)


def _sides(task: SurfaceTask) -> Sides:
    places = np.array([s.position_m for s in task.spots], dtype=np.float64).reshape(-1, 3)
    normals = np.array([s.normal for s in task.spots], dtype=np.float64).reshape(-1, 3)
    return Sides(places, normals, places + SPOT_LIFT_M * normals)


def _viewpoint(
    spot: Spot,
    task: SurfaceTask,
    scenario: Scenario,
    space: FreeSpace,
    sight: SightLines,
    nearest_m: float,
    furthest_m: float,
    rng: np.random.Generator,
) -> ViewpointPose | None:
    """The least tilted of many random places that keep every limit; None when none of them does."""
    camera, gimbal = scenario.camera, scenario.camera.gimbal
    normal = np.asarray(spot.normal)
    target = np.asarray(spot.position_m) + SPOT_LIFT_M * normal
    places = target + _outwards(normal, math.radians(task.max_incidence_deg), nearest_m, furthest_m, rng)
    lowest, highest = gimbal_pitch_range_rad(gimbal.pitch_min_deg, gimbal.pitch_max_deg)
    _, pitch = camera_angles(target - places)
    places = places[(pitch >= lowest) & (pitch <= highest)]
    places = places[space.is_free(places)]
    places = places[space.is_reachable(places)]
    places = places[sight.clear(places, np.broadcast_to(target, places.shape))]
    if not len(places):
        return None
    tilt = -((places - target) @ normal) / np.linalg.norm(places - target, axis=1)
    best = places[np.lexsort((tilt, ~space.is_open_sky(places)))[0]]
    return pose_towards(spot.name, best, target - best, camera.gsd_at(float(np.linalg.norm(target - best))))


def _outwards(
    normal: NDArray[np.float64], steepest: float, shortest: float, longest: float, rng: np.random.Generator
) -> NDArray[np.float64]:
    """Random vectors of some lengths, evenly in a cone about a unit normal, shape (TRIES, 3)."""
    cosine = rng.uniform(math.cos(STEEPEST_SHARE * steepest), 1.0, TRIES)
    azimuth = rng.uniform(0.0, 2 * math.pi, TRIES)
    across = np.linalg.svd(normal[None])[2][1:]
    circle = np.stack([np.cos(azimuth), np.sin(azimuth)], axis=1) @ across
    directions = cosine[:, None] * normal + np.sqrt(1 - cosine**2)[:, None] * circle
    lengths = rng.uniform(shortest, max(longest, shortest), TRIES)
    return np.asarray(lengths[:, None] * directions)


def count_spots(
    scenario: Scenario,
    structure: Structure,
    views: Sequence[View],
    fence: FenceVolume,
    distance: SceneDistance,
    progress: Progress,
) -> dict[str, int] | None:
    """How many spots there are of each verdict of `judge_spots`, by its label; None when the scenario names none."""
    task = scenario.inspection.surface if scenario.inspection else None
    if task is None or not task.spots:
        return None
    verdicts = judge_spots(scenario, structure, task, views, fence, distance, progress)
    return dict(collections.Counter(Verdict(v).label for v in verdicts.tolist()))
