"""Views that together show a surface: found on some of its sides, judged on all of them, and refined.

The sides that are hard to see decide how many views it takes, so most of those that the views are chosen on (the
targets) are of that kind. A choice is then judged on all sampled sides; those that it misses become targets too, and
the choice is mended and refined.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from gcs.planning.cover_problem import CoverProblem
from gcs.planning.cover_refinement import refine_cover
from gcs.planning.set_cover import greedy_cover, without_needless
from gcs.planning.surface_candidates import STAGE, CandidateViews, nothing, with_more_targets

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from gcs.core.progress import Progress
    from gcs.planning.free_space import FreeSpace
    from gcs.planning.seeable_sides import SeeableSides
    from gcs.planning.surface_candidates import Targets, ViewSearch

COVERED_SHARE = 0.9965
"""Of the sampled sides that can be seen. The rest are slits that each cost a view of their own."""

WEIGHT_BY_TIMES = np.array([1, 2, 4, 8, 8])
"""For how many sides a target stands, by how many of the first tries saw it: those that are easily seen have neighbours
that the same views show."""

PILOT_PLACES, PILOT_SHARE = 200, 0.15
"""A first small search, on this share of the targets, says about how many views it takes."""

PLACES_PER_VIEW, FEWEST_PLACES, MOST_PLACES = 8, 300, 4000
AIMS = 10
"""Pictures from every place."""

ROUNDS = 2
"""How often a choice is judged on all sides, mended, and refined with more candidates."""

MOVES = 3
"""Places that are tried about each chosen one in a round."""

MOVE_AIMS = 6
MOVE_SHARE = 0.15
"""How far they lie from it, in focus distances (standard deviation)."""

AIMED_PLACES = 4
"""Places that are tried for a target that no candidate shows."""

FIRST_WORK, MORE_WORK = 2e8, 1e8
"""Updates of a gain in each search for a smaller cover: at first, and in a round."""

UNDER_COVER = 0.9
NEAREST = 0.9
"""Factors on what a view adds: for one that is not under the open sky, and (falling linearly) for the nearest one.
They decide between views that are about equally good."""

NOT_AIMED_AT = 1e-3
"""Weight, where cameras are aimed, of targets that need no more views."""


class SurfaceCover:
    """Searches for views that show all sides but a few.

    Args:
        sides: those that can be seen from somewhere.
        seeable: how easily each of them is seen, and from where.
        search: looks from places.
        space: where the vehicle may be.
        middle_m: what coordinates are counted from.
        furthest_m: largest distance of a view from what it shows.
        rng: the source of randomness.
        progress: told about the stage `viewpoints`.

    Attributes:
        views: all candidates so far.
    """

    def __init__(
        self,
        sides: Targets,
        seeable: SeeableSides,
        search: ViewSearch,
        space: FreeSpace,
        middle_m: NDArray[np.float64],
        furthest_m: float,
        rng: np.random.Generator,
        progress: Progress,
    ) -> None:
        self._sides = sides
        self._seeable = seeable
        self._search = search
        self._space = space
        self._middle = middle_m
        self._furthest = furthest_m
        self._rng = rng
        self._progress = progress
        self._spare = int((1 - COVERED_SHARE) * len(sides))
        self._begun, self._ended = 0.0, 0.0
        self._which = np.zeros(0, dtype=np.int64)
        self._weights = np.zeros(0, dtype=np.int64)
        self._targets = sides[self._which]
        self._preference = np.zeros(0)
        self.views = nothing()

    def solve(self) -> CoverProblem:
        """Find candidates and choose among them.

        Returns:
            The cover of the targets; its candidates are `views`.
        """
        which, weights = self._representatives()
        self._stage(0.3, 0.35)
        pilot = np.sort(self._rng.choice(len(which), math.ceil(PILOT_SHARE * len(which)), replace=False))
        self._begin(which[pilot], weights[pilot])
        self._look(self._places(PILOT_PLACES), AIMS // 2)
        views = len(self._completed(np.zeros(0, dtype=np.int64), self._spare * PILOT_SHARE))

        self._stage(0.35, 0.6)
        self._begin(which, weights)
        self._look(self._places(int(np.clip(PLACES_PER_VIEW * views, FEWEST_PLACES, MOST_PLACES))), AIMS)
        self._show_the_rest()
        self._stage(0.6, 0.9)
        chosen = self._refined(self._completed(np.zeros(0, dtype=np.int64)), FIRST_WORK)
        for _ in range(ROUNDS):
            self._look_about(chosen)
            self._add_targets(self._missed(chosen))
            chosen = self._refined(self._completed(chosen), MORE_WORK)
        self._stage(0.9, 1.0)
        self._add_targets(self._missed(chosen))
        return self._problem(self._needed(self._completed(chosen)))

    def _representatives(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Sides to choose views on, evenly from each class of times seen, and how many sides each stands for."""
        which, weights = [], []
        for times, weight in enumerate(WEIGHT_BY_TIMES):
            of_class = np.flatnonzero(self._seeable.times == times)
            some = of_class[int(self._rng.integers(weight)) :: weight]
            which.append(some)
            weights.append(np.full(len(some), weight))
        order = np.argsort(np.concatenate(which), kind="stable")
        return np.concatenate(which)[order], np.concatenate(weights)[order]

    def _begin(self, which: NDArray[np.int64], weights: NDArray[np.int64]) -> None:
        self._which, self._weights, self._targets = which, weights, self._sides[which]
        self._preference = np.zeros(0)
        self.views = nothing()

    def _places(self, count: int) -> NDArray[np.float32]:
        """Places that see something, preferably what few see."""
        times = self._seeable.times[self._seeable.seen]
        share = 1.0 / (times + 1.0)
        count = min(count, len(share))
        some = self._rng.choice(len(share), size=count, replace=False, p=share / share.sum())
        return self._reachable(self._seeable.places[some])

    def _reachable(self, places: NDArray[np.float32]) -> NDArray[np.float32]:
        return places[self._space.is_reachable(places.astype(np.float64) + self._middle)]

    def _look(self, places: NDArray[np.float32], aims: int, weights: NDArray[np.float32] | None = None) -> None:
        """Take the pictures from places into the candidates."""
        if weights is None:
            weights = self._weights.astype(np.float32)
        found = self._search.look_from(places, self._targets, weights, aims, self._rng, self._tell)
        open_sky = self._space.is_open_sky(found.places.astype(np.float64) + self._middle)
        distance = NEAREST + (1 - NEAREST) * np.minimum(found.focus_m / self._furthest, 1.0)
        self._preference = np.concatenate([self._preference, np.where(open_sky, 1.0, UNDER_COVER) * distance])
        self.views = CandidateViews.joined([self.views, found])

    def _look_about(self, chosen: NDArray[np.int64]) -> None:
        """Take in pictures from near the chosen ones, aimed at what only few of them show."""
        times = self._times(chosen)
        weights = (self._weights / np.maximum(times, 0.5) ** 2).astype(np.float32)
        places = np.repeat(self.views.places[chosen], MOVES, axis=0)
        spread = MOVE_SHARE * np.repeat(self.views.focus_m[chosen], MOVES)
        places += (self._rng.normal(size=places.shape) * spread[:, None]).astype(np.float32)
        self._look(self._reachable(places), MOVE_AIMS, weights)

    def _show_the_rest(self) -> None:
        """Find candidates for targets that none shows.

        Some show them if the camera is where it should be, which then will do; for the others new ones are aimed.
        """
        left = self._shown_by_none()
        if not len(left):
            return
        self._sides.tolerant[self._which[left]] = False
        self._targets = self._sides[self._which]
        starts, members = self._search.shown(self.views, self._targets[left], self._tell)
        self.views = with_more_targets(self.views, starts, left[members].astype(np.int32), 0)
        left = self._shown_by_none()
        if not len(left):
            return
        weights = np.full(len(self._targets), NOT_AIMED_AT, dtype=np.float32)
        weights[left] = 1.0
        numbers = np.flatnonzero(np.isin(self._seeable.seen, self._which[left]))
        some = numbers[_first_of_each(self._seeable.seen[numbers], AIMED_PLACES)]
        self._look(self._reachable(self._seeable.places[some]), 1, weights)

    def _shown_by_none(self) -> NDArray[np.int64]:
        return np.flatnonzero(np.bincount(self.views.members, minlength=len(self._which)) == 0)

    def _missed(self, chosen: NDArray[np.int64]) -> NDArray[np.int64]:
        """Sides that the chosen views do not show and that are no targets yet."""
        _, members = self._search.shown(self.views[chosen], self._sides, self._tell)
        left = np.ones(len(self._sides), dtype=np.bool_)
        left[members] = False
        left[self._which] = False
        return np.flatnonzero(left)

    def _add_targets(self, which: NDArray[np.int64]) -> None:
        """Make sides targets that stand for themselves alone."""
        if not len(which):
            return
        more = self._sides[which]
        starts, members = self._search.shown(self.views, more, self._tell)
        self.views = with_more_targets(self.views, starts, members, len(self._which))
        self._which = np.concatenate([self._which, which])
        self._weights = np.concatenate([self._weights, np.ones(len(which), dtype=np.int64)])
        self._targets = self._sides[self._which]
        self._show_the_rest()

    def _times(self, chosen: NDArray[np.int64]) -> NDArray[np.int64]:
        """By how many of some candidates each target is shown."""
        return np.bincount(self.views[chosen].members, minlength=len(self._targets))

    def _wanted(self, spare: float | None = None) -> int:
        return max(int(self._weights.sum()) - int(self._spare if spare is None else spare), 0)

    def _completed(self, chosen: NDArray[np.int64], spare: float | None = None) -> NDArray[np.int64]:
        return greedy_cover(
            self.views.starts,
            self.views.members,
            self._weights,
            self._wanted(spare),
            preference=self._preference,
            first=chosen,
            poll=self._poll,
        )

    def _covered_weight(self, chosen: NDArray[np.int64]) -> int:
        return int(self._weights[self._times(chosen) > 0].sum())

    def _refined(self, chosen: NDArray[np.int64], work: float) -> NDArray[np.int64]:
        views, wanted = self.views, min(self._wanted(), self._covered_weight(chosen))
        chosen = without_needless(views.starts, views.members, self._weights, chosen, wanted)
        return refine_cover(
            views.starts,
            views.members,
            self._weights,
            chosen,
            wanted,
            work,
            self._rng,
            preference=self._preference,
            poll=self._poll,
        )

    def _needed(self, chosen: NDArray[np.int64]) -> NDArray[np.int64]:
        """Without those that are not needed for what is wanted of all sides."""
        starts, members = self._search.shown(self.views[chosen], self._sides, self._tell)
        each = np.ones(len(self._sides), dtype=np.int64)
        return chosen[without_needless(starts, members, each, np.arange(len(chosen)), len(each) - self._spare)]

    def _problem(self, chosen: NDArray[np.int64]) -> CoverProblem:
        """The cover of the targets, each counted once.

        Whatever misses no more than `spare` of all sides misses no more of those that are targets.
        """
        targets = len(self._which)
        wanted = targets - min(self._spare, targets)
        shown = int((self._times(chosen) > 0).sum())
        covered = np.zeros(targets, dtype=np.bool_)
        return CoverProblem(self.views.starts, self.views.members, targets, covered, min(wanted, shown), chosen)

    def _stage(self, begun: float, ended: float) -> None:
        self._begun, self._ended = begun, ended
        self._poll()

    def _tell(self, share: float) -> None:
        self._progress.report(STAGE, self._begun + share * (self._ended - self._begun))

    def _poll(self) -> None:
        self._tell(0.0)


def _first_of_each(values: NDArray[np.int64], most: int) -> NDArray[np.int64]:
    """Places in an array of the first few of each value."""
    order = np.argsort(values, kind="stable")
    ordered = values[order]
    return order[np.arange(len(order)) - np.searchsorted(ordered, ordered) < most]
