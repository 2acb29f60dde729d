"""Views that together show a surface: found on some of its sides, judged on all of them, and refined.

The sides that are hard to see decide how many views it takes, so most of those that the views are chosen on (the
targets) are of that kind. A choice is then judged on all sampled sides; those that it misses become targets too, and
the choice is mended and refined.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree

from gcs.planning.views.cover_problem import CoverProblem
from gcs.planning.views.cover_refinement import refine_cover
from gcs.planning.views.set_cover import greedy_cover, set_weights, without_needless
from gcs.planning.views.surface_candidates import STAGE, CandidateViews, nothing, with_more_targets

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from gcs.core.progress import Progress
    from gcs.planning.scene.free_space import FreeSpace
    from gcs.planning.views.seeable_sides import SeeableSides
    from gcs.planning.views.surface_candidates import Targets, ViewSearch

COVERED_SHARE = 0.9973
"""Of the sampled sides that can be seen. The rest are slits that each cost a view of their own."""

WEIGHT_BY_TIMES = np.array([1, 2, 4, 8, 8])
"""For how many sides a target stands, by how many of the first tries saw it: those that are easily seen have neighbours
that the same views show."""

PILOT_PLACES, PILOT_SHARE = 150, 0.1
"""A first small search, on this share of the targets, says about how many views it takes."""

SEARCH_SHARE = 0.3
"""Share of the targets that candidates are looked for with."""

PLACES_PER_VIEW, FEWEST_PLACES, MOST_PLACES = 20, 400, 6000
AIMS = 8
"""Pictures from every place."""

LAYERS = 5
"""Candidates that are kept: those of so many covers, each of what the earlier ones left."""

MOVES, MOVE_AIMS = 2, 4
"""Places that are tried about each chosen one, and pictures from each."""

MOVE_SHARE = 0.1
"""How far they lie from it, in focus distances (standard deviation)."""

AS_GOOD = 0.9
"""A moved view is kept when it shows this much, at least, of what only the view that it came from shows."""

AIMED_PLACES = 4
"""Places that are tried for a target that no candidate shows."""

FIRST_WORK, MOVE_WORK, LAST_WORK = 1.5e7, 2.5e7, 1.2e8
"""Updates of a gain in each search for a smaller cover: at first, with the moved views, and on all sides."""

WORK_VIEWS = 100
"""Covers of fewer views than this take as much less work."""

UNDER_COVER = 0.95
NEAREST = 0.95
"""Factors on what a view adds: for one that is not under the open sky, and (falling linearly) for the nearest one.
They decide which candidates are kept, and between views that add the same."""

NONE = np.zeros(0, dtype=np.int64)

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
        self._all, self._all_weights = self._representatives()
        self._mixed = rng.permutation(len(self._all))
        self._begun, self._ended = 0.0, 0.0
        self._which = np.zeros(0, dtype=np.int64)
        self._weights = np.zeros(0, dtype=np.int64)
        self._targets = sides[self._which]
        self._preference = np.zeros(0)
        self.views = nothing()

    def views_about(self) -> int:
        """About how many views it takes, by a small search."""
        self._stage(0.3, 0.35)
        few = np.sort(self._mixed[: math.ceil(PILOT_SHARE * len(self._mixed))])
        self._begin(few)
        self._look(self._places(PILOT_PLACES), AIMS)
        return len(self._completed(NONE, PILOT_SHARE * self._spare))

    def solve(self, views: int) -> CoverProblem:
        """Find candidates and choose among them.

        Args:
            views: about how many it will take.

        Returns:
            The cover of the targets; its candidates are `views`.
        """
        self._stage(0.35, 0.6)
        some = math.ceil(SEARCH_SHARE * len(self._mixed))
        self._begin(np.sort(self._mixed[:some]))
        self._look(self._places(int(np.clip(PLACES_PER_VIEW * views, FEWEST_PLACES, MOST_PLACES))), AIMS)
        self._keep(self._layers(SEARCH_SHARE * self._spare))
        others = np.sort(self._mixed[some:])
        self._add_targets(self._all[others], self._all_weights[others])
        self._show_the_rest()
        self._stage(0.6, 0.8)
        chosen = self._refined(self._completed(NONE), FIRST_WORK)
        self._stage(0.8, 0.9)
        self._look_about(chosen)
        chosen = self._refined(self._completed(chosen), MOVE_WORK)
        self._stage(0.9, 1.0)
        self._take_all_sides()
        return self._problem(self._refined(self._completed(chosen), LAST_WORK))

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

    def _begin(self, numbers: NDArray[np.int64]) -> None:
        """Take some of the representatives as targets, and no candidates."""
        self._which, self._weights = self._all[numbers], self._all_weights[numbers]
        self._targets = self._sides[self._which]
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

    def _layers(self, spare: float) -> NDArray[np.int64]:
        """Candidates of several covers, each of what the earlier ones left."""
        left = np.arange(len(self.views))
        layers: list[NDArray[np.int64]] = []
        for _ in range(LAYERS):
            views = self.views[left]
            layer = greedy_cover(
                views.starts,
                views.members,
                self._weights,
                self._wanted(spare),
                preference=self._preference[left],
                poll=self._poll,
            )
            layers.append(left[layer])
            left = np.delete(left, layer)
        return np.sort(np.concatenate(layers))

    def _keep(self, which: NDArray[np.int64]) -> None:
        self.views, self._preference = self.views[which], self._preference[which]

    def _look_about(self, chosen: NDArray[np.int64]) -> None:
        """Take in pictures from near the chosen ones that can stand for them, or nearly."""
        before, times = len(self.views), self._times(chosen)
        weights = (self._weights / np.maximum(times, 0.5) ** 2).astype(np.float32)
        places = np.repeat(self.views.places[chosen], MOVES, axis=0)
        spread = MOVE_SHARE * np.repeat(self.views.focus_m[chosen], MOVES)
        places += (self._rng.normal(size=places.shape) * spread[:, None]).astype(np.float32)
        self._look(self._reachable(places), MOVE_AIMS, weights)
        alone = self._weights * (times == 1)
        least = AS_GOOD * set_weights(*self._lists(chosen), alone)
        _, parent = cKDTree(self.views.places[chosen]).query(self.views.places[before:])
        more = set_weights(*self._lists(np.arange(before, len(self.views))), self._weights * (times <= 1))
        good = before + np.flatnonzero(more >= least[parent])
        self._keep(np.concatenate([np.arange(before), good]))

    def _lists(self, which: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
        views = self.views[which]
        return views.starts, views.members

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

    def _take_all_sides(self) -> None:
        """Make every side a target that stands for itself alone."""
        left = np.ones(len(self._sides), dtype=np.bool_)
        left[self._which] = False
        others = np.flatnonzero(left)
        self._add_targets(others, np.ones(len(others), dtype=np.int64))
        self._weights = np.ones(len(self._which), dtype=np.int64)
        self._show_the_rest()

    def _add_targets(self, which: NDArray[np.int64], weights: NDArray[np.int64]) -> None:
        """Make more sides targets, of some weight each."""
        more = self._sides[which]
        starts, members = self._search.shown(self.views, more, self._tell)
        self.views = with_more_targets(self.views, starts, members, len(self._which))
        self._which = np.concatenate([self._which, which])
        self._weights = np.concatenate([self._weights, weights])
        self._targets = self._sides[self._which]

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
            work * min(1.0, len(chosen) / WORK_VIEWS),
            self._rng,
            preference=self._preference,
            poll=self._poll,
        )

    def _problem(self, chosen: NDArray[np.int64]) -> CoverProblem:
        """The cover of all sides."""
        sides = len(self._which)
        nothing_else = np.zeros(sides, dtype=np.bool_)
        wanted = min(self._wanted(), self._covered_weight(chosen))
        return CoverProblem(self.views.starts, self.views.members, sides, nothing_else, wanted, chosen)

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
