"""What is reported of a departure from the plan, and how it is gathered while it lasts."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from gcs.core.replanning import ReplanReason
    from gcs.planning.local.surroundings import SeenDisc

PATH_ERROR_M = 0.05
"""The reported path is no further from the flown one at the places where it was looked at ..."""

MOST_POINTS = 48
"""... as long as it has no more points than this."""


@dataclass(frozen=True, eq=False)
class LocalReplan:
    """One departure from the plan, from leaving it to joining it again.

    Attributes:
        reason: the gravest there was.
        left_clock_s: when the plan was left, on the navigator's clock.
        rejoined_clock_s: when it was joined again; None when it was given up.
        path_m: what was flown in between, scene ENU, shape (K, 3).
        obstacle: what was evaded first; None when nothing was seen (a pause).
        skipped: viewpoints that were left out.
        plan_time_s: time on the trajectory at which it was left.
        moved: viewpoints photographed from elsewhere, and from where.
    """

    reason: ReplanReason
    left_clock_s: float
    rejoined_clock_s: float | None
    path_m: NDArray[np.float64]
    obstacle: SeenDisc | None
    skipped: tuple[int, ...]
    plan_time_s: float
    moved: tuple[tuple[int, NDArray[np.float64]], ...] = ()


@dataclass
class Departure:
    """A departure that still lasts.

    Attributes:
        reason: the gravest so far.
        left_clock_s: when the plan was left.
        plan_time_s: time on the trajectory at which it was left.
        obstacle: what was evaded first.
        skipped: viewpoints left out so far.
        moved: viewpoints photographed from elsewhere so far, and from where.
        places_m: where the vehicle was.
    """

    reason: ReplanReason
    left_clock_s: float
    plan_time_s: float
    obstacle: SeenDisc | None = None
    skipped: list[int] = field(default_factory=list)
    moved: list[tuple[int, NDArray[np.float64]]] = field(default_factory=list)
    places_m: list[NDArray[np.float64]] = field(default_factory=list)

    def grows(self, reason: ReplanReason) -> None:
        """Note one reason more."""
        self.reason = max(self.reason, reason)  # they rise in gravity

    def passes(self, place_m: NDArray[np.float64]) -> None:
        """Note where the vehicle is; standing still adds nothing."""
        if not self.places_m or np.linalg.norm(place_m - self.places_m[-1]) > PATH_ERROR_M:
            self.places_m.append(place_m)

    def report(self, rejoined_clock_s: float | None) -> LocalReplan:
        """What is told when it is over."""
        return LocalReplan(
            self.reason,
            self.left_clock_s,
            rejoined_clock_s,
            simplified(np.array(self.places_m)),
            self.obstacle,
            tuple(self.skipped),
            self.plan_time_s,
            tuple(self.moved),
        )


def simplified(path_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """A path with the fewer points: the furthest from what is kept is added, over and over (Douglas and Peucker 1973).

    Args:
        path_m: shape (N, 3), N >= 1.

    Returns:
        Shape (K, 3): the ends and what `PATH_ERROR_M` needs, at most `MOST_POINTS`.
    """
    kept = [0, len(path_m) - 1] if len(path_m) > 1 else [0]
    while len(kept) < MOST_POINTS:
        worst, place = PATH_ERROR_M, -1
        for a, b in itertools.pairwise(kept):
            off = _distances(path_m[a + 1 : b], path_m[a], path_m[b])
            if len(off) and off.max() > worst:
                worst, place = float(off.max()), a + 1 + int(off.argmax())
        if place < 0:
            break
        kept = sorted([*kept, place])
    return np.asarray(path_m[kept])


def _distances(
    points: NDArray[np.float64], start: NDArray[np.float64], end: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Of points (N, 3) from a straight between two."""
    move = end - start
    along = np.clip((points - start) @ move / max(float(move @ move), 1e-12), 0.0, 1.0)
    return np.asarray(np.linalg.norm(points - start - along[:, None] * move, axis=1))
