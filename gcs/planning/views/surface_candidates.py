"""Candidate views of a surface: what can be seen from free places, and where to aim from there."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from gcs.planning.numerics.compiled import compiled
from gcs.planning.numerics.worker_threads import in_threads
from gcs.planning.scene.visibility import Rays
from gcs.planning.views.picture_kernels import (
    PictureLimits,
    ShortInts,
    aim_pictures,
    facing_targets,
    kept,
    pictured_targets,
    rays_to,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from gcs.planning.scene.visibility import SightLines
    from gcs.planning.views.surface_samples import SurfaceSamples

PLACES_AT_A_TIME = 16
PICTURES_AT_A_TIME = 64

STAGE = "viewpoints"

Ints = np.ndarray[tuple[int, ...], np.dtype[np.int64]]


@dataclass(frozen=True, eq=False)
class Targets:
    """Sides of surface points, as kernels take them.

    Attributes:
        points: about the structure's middle, shape (T, 3), float32.
        normals: the sides, unit, shape (T, 3), float32.
        tolerant: whether each has to be shown with the position error allowed for, shape (T,).
    """

    points: NDArray[np.float32]
    normals: NDArray[np.float32]
    tolerant: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.points)

    def __getitem__(self, which: NDArray[np.int64]) -> Targets:
        return Targets(self.points[which], self.normals[which], self.tolerant[which])

    @staticmethod
    def of(sides: SurfaceSamples, middle_m: NDArray[np.float64]) -> Targets:
        """Sides of surface points, the position error allowed for."""
        points = (sides.points_m - middle_m).astype(np.float32)
        return Targets(points, sides.normals.astype(np.float32), np.ones(len(sides), dtype=np.bool_))

    @staticmethod
    def joined(first: Targets, second: Targets) -> Targets:
        """Two sets of targets as one."""
        return Targets(
            np.concatenate([first.points, second.points]),
            np.concatenate([first.normals, second.normals]),
            np.concatenate([first.tolerant, second.tolerant]),
        )


@dataclass(frozen=True, eq=False)
class CandidateViews:
    """Pictures that could be taken, and which targets each shows.

    Attributes:
        places: about the structure's middle, shape (C, 3), float32.
        axes: right, up and view direction of the camera, shape (C, 9).
        focus_m: depth that is focused on: the mean of what is shown, shape (C,).
        starts: where each view's targets begin in `members`, shape (C + 1,).
        members: numbers of the targets, view after view.
    """

    places: NDArray[np.float32]
    axes: NDArray[np.float64]
    focus_m: NDArray[np.float64]
    starts: NDArray[np.int64]
    members: NDArray[np.int32]

    def __len__(self) -> int:
        return len(self.places)

    def __getitem__(self, which: NDArray[np.int64]) -> CandidateViews:
        starts, members = _chosen_lists(self.starts, self.members, which)
        return CandidateViews(self.places[which], self.axes[which], self.focus_m[which], starts, members)

    @staticmethod
    def joined(parts: list[CandidateViews]) -> CandidateViews:
        """Several sets of candidates as one."""
        sizes = np.concatenate([np.diff(p.starts) for p in parts])
        return CandidateViews(
            np.concatenate([p.places for p in parts]),
            np.concatenate([p.axes for p in parts]),
            np.concatenate([p.focus_m for p in parts]),
            np.concatenate([[0], np.cumsum(sizes)]),
            np.concatenate([p.members for p in parts]),
        )


class ViewSearch:
    """Looks from places.

    Args:
        limits: what pictures show well enough.
        sight: what hides targets.
    """

    def __init__(self, limits: PictureLimits, sight: SightLines) -> None:
        self._limits = limits
        self._sight = sight
        corner = np.sqrt(1 + limits.half_width**2 + limits.half_height**2)
        self._corner_distance = float(limits.furthest * corner)

    def look_from(
        self,
        places: NDArray[np.float32],
        targets: Targets,
        weights: NDArray[np.float32],
        aims: int,
        rng: np.random.Generator,
        poll: Callable[[float], None],
    ) -> CandidateViews:
        """Pictures from every place.

        Args:
            places: about the structure's middle, shape (P, 3), float32.
            targets: what may be shown.
            weights: how much each of them counts where a camera is aimed, shape (T,), positive.
            aims: pictures from each place, at most.
            rng: the source of randomness.
            poll: told the share that is done; may raise.
        """
        draws = rng.random((len(places), aims), dtype=np.float32)
        work = partial(self._look, places, targets, weights, draws)
        parts = in_threads(work, range(0, len(places), PLACES_AT_A_TIME), poll)
        return CandidateViews.joined(parts) if parts else nothing()

    def shown(self, views: CandidateViews, targets: Targets, poll: Callable[[float], None]) -> tuple[Ints, ShortInts]:
        """Which targets given pictures show: where each picture's begin, shape (C + 1,), and their numbers."""
        if not len(views):
            return np.zeros(1, dtype=np.int64), np.empty(0, dtype=np.int32)
        work = partial(self._show, views, targets)
        parts = in_threads(work, range(0, len(views), PICTURES_AT_A_TIME), poll)
        sizes = np.concatenate([np.diff(starts) for starts, _ in parts])
        return np.concatenate([[0], np.cumsum(sizes)]), np.concatenate([members for _, members in parts])

    def _look(
        self,
        places: NDArray[np.float32],
        targets: Targets,
        weights: NDArray[np.float32],
        draws: NDArray[np.float32],
        first: int,
    ) -> CandidateViews:
        part = slice(first, first + PLACES_AT_A_TIME)
        here, limits = places[part], self._limits
        starts, which = facing_targets(
            here, targets.points, targets.normals, self._corner_distance, limits.least_cosine
        )
        starts, visible = self._unhidden(here, starts, which, targets)
        ends, members, of_place, axes, focus = aim_pictures(
            here, starts, visible, targets.points, targets.tolerant, weights, draws[part], limits
        )
        return CandidateViews(here[of_place], axes, focus, ends, members)

    def _show(self, views: CandidateViews, targets: Targets, first: int) -> tuple[Ints, ShortInts]:
        part = slice(first, first + PICTURES_AT_A_TIME)
        here = views.places[part]
        starts, which = pictured_targets(
            here, views.axes[part], views.focus_m[part], targets.points, targets.normals, targets.tolerant, self._limits
        )
        return self._unhidden(here, starts, which, targets)

    def _unhidden(
        self, places: NDArray[np.float32], starts: Ints, which: ShortInts, targets: Targets
    ) -> tuple[Ints, ShortInts]:
        rays = rays_to(places, starts, which, targets.points, targets.normals)
        return kept(starts, which, self._sight.clear_rays(Rays(*rays)))


def nothing() -> CandidateViews:
    """No candidates."""
    none = np.zeros(0)
    return CandidateViews(
        np.zeros((0, 3), dtype=np.float32), np.zeros((0, 9)), none, np.zeros(1, np.int64), np.zeros(0, np.int32)
    )


def with_more_targets(views: CandidateViews, starts: Ints, members: ShortInts, first: int) -> CandidateViews:
    """Candidates that show more targets.

    Args:
        views: what they showed before.
        starts: where the additional targets of each begin in `members`.
        members: numbers of the additional targets, counted from `first`.
        first: number of the first additional target.
    """
    both = _merged_lists(views.starts, views.members, starts, members, first)
    return replace(views, starts=views.starts + starts, members=both)


@compiled
def _merged_lists(
    starts: Ints, members: ShortInts, more_starts: Ints, more_members: ShortInts, first: int
) -> ShortInts:
    result = np.empty(members.shape[0] + more_members.shape[0], np.int32)
    at = 0
    for c in range(starts.shape[0] - 1):
        for e in range(starts[c], starts[c + 1]):
            result[at] = members[e]
            at += 1
        for e in range(more_starts[c], more_starts[c + 1]):
            result[at] = more_members[e] + first
            at += 1
    return result


@compiled
def _chosen_lists(starts: Ints, members: ShortInts, which: Ints) -> tuple[Ints, ShortInts]:
    new_starts = np.zeros(which.shape[0] + 1, np.int64)
    for k in range(which.shape[0]):
        new_starts[k + 1] = new_starts[k] + starts[which[k] + 1] - starts[which[k]]
    result = np.empty(new_starts[-1], np.int32)
    for k in range(which.shape[0]):
        result[new_starts[k] : new_starts[k + 1]] = members[starts[which[k]] : starts[which[k] + 1]]
    return new_starts, result
