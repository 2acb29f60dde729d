"""Ways on a map of the plane, and their corners as points that a curve is to pass."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.errors import InfeasibleError, InputError
from gcs.planning.local.binary_map import BinaryMap
from gcs.planning.local.tangent_path import shortest_path

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from gcs.planning.local.search_budget import SearchBudget

OPENED_CELLS = 3
"""The margin begins so many cells further from the ends of a way than it is wide."""

REFINEMENTS = 5
"""How often points are added where a curve is not free."""


def way_on_map(
    start_m: NDArray[np.float64], goal_m: NDArray[np.float64], area: BinaryMap, margin_m: float, budget: SearchBudget
) -> NDArray[np.float64] | None:
    """The shortest way from a place (2,) to another that keeps a margin but near its ends, shape (K, 2).

    Args:
        start_m: shape (2,).
        goal_m: shape (2,).
        area: what is blocked.
        margin_m: the margin.
        budget: for the search.

    Returns:
        None when there is no way, or none was found within the budget.
    """
    opened = _opened(area, (start_m, goal_m), margin_m)
    try:
        return shortest_path(start_m, goal_m, area=opened, budget=budget).points_m
    except (InputError, InfeasibleError):
        return None


def at_heights(way_m: NDArray[np.float64], start_m: float, end_m: float) -> NDArray[np.float64]:
    """The way's corners (K, 3) with heights that change evenly along it; no two are one place."""
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(way_m, axis=0), axis=1))])
    kept = np.concatenate([[True], np.diff(along) > 1e-6])
    kept[-1] = True
    heights = start_m + (end_m - start_m) * along / max(float(along[-1]), 1e-9)
    return np.asarray(np.column_stack([way_m, heights])[kept])


def with_middles(points: NDArray[np.float64], bad: NDArray[np.bool_]) -> NDArray[np.float64]:
    """The points with one more in the middle of each bad segment."""
    segments = np.flatnonzero(bad)
    return np.asarray(np.insert(points, segments + 1, (points[segments] + points[segments + 1]) / 2, axis=0))


def _opened(area: BinaryMap, ends_m: Sequence[NDArray[np.float64]], margin_m: float) -> BinaryMap:
    """The map with the margin, but without it about both ends: a vehicle may stand at the very edge of free space."""
    blocked = area.grown(margin_m).blocked.copy()
    reach = math.ceil(margin_m / area.cell_m) + OPENED_CELLS
    for end in ends_m:
        cell = np.floor(area.cells(end)).astype(np.int64)
        window = tuple(slice(max(k - reach, 0), max(k + reach + 1, 0)) for k in cell)
        blocked[window] = area.blocked[window]
    return BinaryMap(blocked, area.origin_m, area.cell_m)
