"""Candidate views of a surface: free places in front of it, what can be seen from each, and where to aim."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gcs.planning.camera_footprint import footprint_area, furthest_in_image
from gcs.planning.coverage import random_places
from gcs.planning.viewpoint_pose import camera_angles, camera_axes, gimbal_pitch_range_rad

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from gcs.core.camera import Camera
    from gcs.core.inspection import SurfaceTask
    from gcs.core.progress import Progress
    from gcs.planning.free_space import FreeSpace
    from gcs.planning.surface_samples import SurfaceSamples
    from gcs.planning.visibility import SightLines

AIMS = 10
"""Directions that are tried at every place."""

FEWEST_PLACES, MOST_PLACES = 1000, 2000
PLACES_PER_PICTURE = 3.0
"""Places tried for every picture that the surface would take if it were flat and seen square on."""

BATCH = 32
EXTRA_ROUNDS = 10
STAGE = "viewpoints"


@dataclass(frozen=True, eq=False)
class CandidateView:
    """A picture that could be taken.

    Attributes:
        position_m: shape (3,).
        direction: unit view direction, shape (3,).
        members: numbers of the targets that count as covered by it, shape (M,).
        depth_m: mean depth of those along the axis.
        open_sky: whether a straight climb from there is clear.
    """

    position_m: NDArray[np.float64]
    direction: NDArray[np.float64]
    members: NDArray[np.int64]
    depth_m: float
    open_sky: bool


class CandidateSearch:
    """Looks for candidate views of a set of targets.

    Args:
        targets: sides of the surface.
        task: GSD, overlap and incidence.
        camera: the camera and its gimbal.
        furthest_m: largest distance of a place from its target, at most what the GSD allows.
        space: where the vehicle may be.
        sight: what hides the surface.
        rng: the source of randomness.
    """

    def __init__(
        self,
        targets: SurfaceSamples,
        task: SurfaceTask,
        camera: Camera,
        furthest_m: float,
        space: FreeSpace,
        sight: SightLines,
        rng: np.random.Generator,
    ) -> None:
        self._targets = targets
        self._lifted = targets.lifted_m
        self._task = task
        self._camera = camera
        self._furthest = furthest_m
        self._depth_limit = camera.distance_for_gsd(task.gsd_mm / 1000)
        self._space = space
        self._sight = sight
        self._rng = rng
        self._least_cosine = math.cos(math.radians(task.max_incidence_deg))
        self._corner_distance = furthest_in_image(camera, self._depth_limit)
        self._pitch = gimbal_pitch_range_rad(camera.gimbal.pitch_min_deg, camera.gimbal.pitch_max_deg)

    def find(self, area_m2: float, progress: Progress) -> list[CandidateView]:
        """Candidates, first spread over the surface, then where something is not yet in sight.

        Args:
            area_m2: of the surface, one side.
            progress: told about the stage `viewpoints`, from 0.3 to 0.9 of it.
        """
        core = (1 - self._task.overlap) ** 2 * footprint_area(self._camera, self._furthest)
        wanted = int(np.clip(PLACES_PER_PICTURE * 2 * area_m2 / core, FEWEST_PLACES, MOST_PLACES))
        candidates: list[CandidateView] = []
        seen = np.zeros(len(self._targets), dtype=np.bool_)
        some = self._rng.choice(len(seen), size=min(wanted, len(seen)), replace=False)
        places, _ = self._free_places(some, in_sight=False, near=False)
        for first in range(0, len(places), BATCH):
            self._look_from(places[first : first + BATCH], seen, candidates)
            progress.report(STAGE, 0.3 + 0.4 * first / len(places))
        for round_ in range(EXTRA_ROUNDS):
            self._look_again(seen, candidates, progress, round_)
        return candidates

    def _free_places(
        self, which: NDArray[np.int64], *, in_sight: bool, near: bool
    ) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Free places in front of targets, with `in_sight` only those that see them, and the targets' numbers."""
        targets = self._targets[which]
        places = random_places(targets, self._task, self._space.clearance_m, self._furthest, self._rng, near=near)
        ok = np.ones(len(places), dtype=np.bool_)
        if in_sight:
            _, pitch = camera_angles(targets.points_m - places)
            ok &= (pitch >= self._pitch[0]) & (pitch <= self._pitch[1])
            ok[ok] = self._sight.clear(places[ok], targets.lifted_m[ok])
        ok[ok] = self._space.is_reachable(places[ok])
        return places[ok], which[ok]

    def _look_again(
        self, seen: NDArray[np.bool_], candidates: list[CandidateView], progress: Progress, round_: int
    ) -> None:
        """Places that see what nothing has seen yet; not for what an earlier one of them has seen by the way."""
        places, which = self._free_places(np.flatnonzero(~seen), in_sight=True, near=round_ % 2 == 0)
        while len(places):
            progress.report(STAGE, 0.7 + 0.2 * round_ / EXTRA_ROUNDS)
            self._look_from(places[:BATCH], seen, candidates)
            left = np.flatnonzero(~seen[which[BATCH:]]) + BATCH
            places, which = places[left], which[left]

    def _look_from(self, places: NDArray[np.float64], seen: NDArray[np.bool_], candidates: list[CandidateView]) -> None:
        open_sky = self._space.is_open_sky(places)
        for place, sky in zip(places, open_sky, strict=True):
            visible = self._visible_from(place)
            aimed = self._aimed(place, visible, open_sky=bool(sky))
            candidates += aimed
            for candidate in aimed:
                seen[candidate.members] = True

    def _visible_from(self, place: NDArray[np.float64]) -> NDArray[np.int64]:
        """Targets that a camera at a place could show, whatever way it looks."""
        to_camera = place - self._targets.points_m
        squared = np.einsum("ij,ij->i", to_camera, to_camera)
        along = np.einsum("ij,ij->i", to_camera, self._targets.normals)
        facing = (along > 0) & (along * along >= self._least_cosine**2 * squared)
        which = np.flatnonzero(facing & (squared <= self._corner_distance**2))
        return which[self._sight.clear(place, self._lifted[which])]

    def _aimed(self, place: NDArray[np.float64], visible: NDArray[np.int64], *, open_sky: bool) -> list[CandidateView]:
        if not len(visible):
            return []
        ray = self._targets.points_m[visible] - place
        unit = ray / np.linalg.norm(ray, axis=1)[:, None]
        aims = unit[self._rng.choice(len(visible), size=min(AIMS - 1, len(visible)), replace=False)]
        aims = np.vstack([unit.mean(axis=0), aims])
        # one step of mean shift moves an aim from the edge of what is there towards its middle
        inside, _, _ = self._in_core(ray, aims)
        sums = inside.astype(np.float64) @ unit
        moved = np.where((sums**2).sum(axis=1)[:, None] > 0, sums, aims)
        inside, direction, depth = self._in_core(ray, np.vstack([moved, aims]))
        kept: dict[bytes, CandidateView] = {}
        for k in np.flatnonzero(inside.any(axis=1)):
            members = np.compress(inside[k], visible)
            kept.setdefault(
                members.tobytes(),
                CandidateView(place, direction[k], members, float(depth[k][inside[k]].mean()), open_sky),
            )
        return list(kept.values())

    def _in_core(
        self, ray: NDArray[np.float64], aims: NDArray[np.float64]
    ) -> tuple[NDArray[np.bool_], NDArray[np.float64], NDArray[np.float64]]:
        """Which rays (V, 3) lie in the middle of pictures along aims (A, 3), near enough.

        The middle is the image less `overlap` of its width and height: where the middles of neighbouring pictures
        meet, the pictures overlap by that share.

        Returns:
            Shape (A, V); the view directions within the gimbal's range, shape (A, 3); and the depths, shape (A, V).
        """
        yaw, pitch = camera_angles(aims)
        direction, up = camera_axes(yaw, np.clip(pitch, *self._pitch))
        right = np.cross(direction, up)
        depth = direction @ ray.T
        core = 1 - self._task.overlap
        inside = (depth > 0) & (depth <= self._depth_limit)
        inside &= np.abs(right @ ray.T) <= core * self._camera.half_width_tangent * depth
        inside &= np.abs(up @ ray.T) <= core * self._camera.half_height_tangent * depth
        return np.asarray(inside), direction, depth
