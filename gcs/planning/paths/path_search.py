"""Short free paths between exact points: straight if it can be, else over the grid and then pulled tight.

Paths run in the wide space. A place that is only in the tight space, near a wall or beyond a narrow passage, is left on
the shortest way to the wide space, and that way is pulled together with the rest: about the tight places on it a path
may be in the tight space, elsewhere it may not.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.errors import InfeasibleError
from gcs.planning.paths.double_arc import cut_by_cable, double_arc
from gcs.planning.paths.string_pulling import path_length, pull_string
from gcs.planning.scene.grid_search import GridSearch

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import ArrayLike, NDArray

    from gcs.planning.scene.free_space import FreeSpace
    from gcs.planning.scene.room import RoomModel

COVER_PENALTY = 4.0
"""A metre under cover counts as this many in the open, when no path stays in the open."""

WEIGHT = 1.2
"""Of the search's estimate: pulled paths stay within 1 % of those of an optimal search, in a fraction of its time."""


def find_path(
    space: FreeSpace,
    start_m: ArrayLike,
    goal_m: ArrayLike,
    prefer_open_sky: bool = True,
    *,
    grid: GridSearch | None = None,
    poll: Callable[[], None] | None = None,
) -> NDArray[np.float64]:
    """A short free path between two points, with its ends exactly there.

    Looks for a straight line first, then on the grid among cells under the open sky, then among all free cells with
    time under cover made dear; the grid path is shortened by string pulling without more time under cover. Where stays
    cut the straight line, the double arc past them is taken if it is free, shorter, and no more under cover. From and
    to a place in the column over home the path goes vertically through the take-off point.

    Args:
        space: where the centre may be.
        start_m: first point, scene ENU, shape (3,).
        goal_m: last point, shape (3,).
        prefer_open_sky: whether a path under the open sky is worth a detour.
        grid: working arrays to use again.
        poll: called now and then in long searches; may raise.

    Returns:
        Corner points, shape (K, 3), K >= 2; every straight leg is proved free.

    Raises:
        InfeasibleError: no path joins the points.
    """
    start, goal = np.array(start_m, dtype=np.float64), np.array(goal_m, dtype=np.float64)
    before = [start] if space.in_home_column(start) else []
    after = [goal] if space.in_home_column(goal) else []
    for low in (*before, *after):
        if not space.segment_free(low, space.take_off_m, strict=True, model=space.wide_model):
            raise _not_connected(space, low)
    if before:
        start = space.take_off_m
    if after:
        goal = space.take_off_m
    grid = grid or GridSearch(space.free_mask.shape)
    middle = _path_in_the_air(space, start, goal, prefer_open_sky, grid, poll)
    return np.array([*before, *middle, *after])


def _path_in_the_air(
    space: FreeSpace,
    start: NDArray[np.float64],
    goal: NDArray[np.float64],
    prefer_open_sky: bool,
    grid: GridSearch,
    poll: Callable[[], None] | None,
) -> NDArray[np.float64]:
    straight = np.stack([start, goal])
    tight = straight[~space.is_wide(straight)]
    model = space.model_about(tight)
    open_enough = not prefer_open_sky or space.covered_length(straight) == 0.0
    if open_enough and space.segment_free(start, goal, strict=True, model=model):
        return straight
    out, back = _way_out(space, start, grid, poll), _way_out(space, goal, grid, poll)
    cells = _between(space, out, back, prefer_open_sky, grid, poll)
    if cells is None:
        raise _not_connected(space, goal)
    if len(out) > 1 or len(back) > 1 or len(tight):
        spots = space.centre_of(cells)
        model = space.model_about(_thinned(np.vstack([tight, spots[~space.is_wide(spots)]]), model.spot_radius / 2))
    corners = _without_unproved_diagonals(space, cells, model)
    path = np.concatenate([start[None], corners, goal[None]])
    pulled = pull_string(space, path, keep_open_sky=prefer_open_sky, model=model)
    arc = past_stays(space, start, goal, model, path_length(pulled))
    if arc is None or path_length(arc) >= path_length(pulled):
        return pulled
    more_covered = prefer_open_sky and space.covered_length(arc) > space.covered_length(pulled)
    return pulled if more_covered else arc


def past_stays(
    space: FreeSpace,
    start: NDArray[np.float64],
    goal: NDArray[np.float64],
    model: RoomModel,
    longest_m: float = math.inf,
) -> NDArray[np.float64] | None:
    """The double arc past the stays that cut a leg.

    Args:
        space: where the centre may be.
        start: first point, shape (3,).
        goal: last point, shape (3,).
        model: what limits the centre on the way.
        longest_m: longer ones are not looked for.

    Returns:
        Its chords, shape (K, 3), each proved free; None where no stay cuts the leg, or there is no arc that is free.
    """
    ends, radii, kept = model.cable_ends, model.cable_radii, model.clearance + model.extra
    if not len(ends) or not cut_by_cable(start, goal, ends, kept + radii).any():
        return None
    arc = double_arc(start, goal, ends, radii, kept, longest_m=longest_m)
    if isinstance(arc, str):
        return None
    chords = arc.polyline_m
    free = space.segments_free(chords[:-1], chords[1:], strict=True, model=model)
    return chords if free.all() else None


def _way_out(
    space: FreeSpace, point: NDArray[np.float64], grid: GridSearch, poll: Callable[[], None] | None
) -> NDArray[np.int64]:
    """Cells from beside a point to the nearest one of the wide space, shape (K, 3)."""
    for model in (space.wide_model, space.model):
        cell = space.linked_cell(point, space.wide_mask, model)
        if cell is not None:
            return cell[None]
    cell = space.linked_cell(point)
    found = None if cell is None else grid.nearest(space.reachable_mask, cell, space.wide_mask, poll)
    if found is None:
        raise _not_connected(space, point)
    return found[0]


def _between(
    space: FreeSpace,
    out: NDArray[np.int64],
    back: NDArray[np.int64],
    prefer_open_sky: bool,
    grid: GridSearch,
    poll: Callable[[], None] | None,
) -> NDArray[np.int64] | None:
    """Cells of a path, given the ways from its ends to the wide space: through that, or directly where it is nearer."""
    if len(out) + len(back) - 2 > np.abs(out[0] - back[0]).max():
        found = grid.search(space.reachable_mask, out[0], back[0], weight=WEIGHT, poll=poll)
        return None if found is None else found[0]
    first, last = out[-1], back[-1]
    if prefer_open_sky:
        regions = space.open_sky_regions
        if regions[tuple(first)] and regions[tuple(first)] == regions[tuple(last)]:
            found = grid.search(space.open_sky_mask, first, last, weight=WEIGHT, poll=poll)
        else:
            found = grid.search(space.wide_mask, first, last, space.cover_depth, COVER_PENALTY, WEIGHT, poll)
    else:
        found = grid.search(space.wide_mask, first, last, weight=WEIGHT, poll=poll)
    return None if found is None else np.concatenate([out[:-1], found[0], back[-2::-1]])


def _thinned(points: NDArray[np.float64], apart_m: float) -> NDArray[np.float64]:
    """Points (N, 3) of a path without those that are near to the one kept before."""
    kept: list[NDArray[np.float64]] = []
    for point in points:
        if not kept or np.linalg.norm(point - kept[-1]) >= apart_m:
            kept.append(point)
    return np.array(kept).reshape(-1, 3)


def _not_connected(space: FreeSpace, point: NDArray[np.float64]) -> InfeasibleError:
    where = ", ".join(f"{c:.1f}" for c in point)
    return InfeasibleError(
        f"no way leads from home to ({where}) m with {space.nearest_m:.2f} m about the vehicle's centre: "
        "ask for less clearance or leave the point out"
    )


def _without_unproved_diagonals(space: FreeSpace, cells: NDArray[np.int64], model: RoomModel) -> NDArray[np.float64]:
    """Centres of the cells; a diagonal step that is not free as a line goes by the faces, which always are."""
    centres = space.centre_of(cells)
    step = np.diff(cells, axis=0)
    diagonal = np.abs(step).sum(axis=1) > 1
    clear = np.ones(len(step), dtype=np.bool_)
    clear[diagonal] = space.segments_free(centres[:-1][diagonal], centres[1:][diagonal], strict=True, model=model)
    points = [centres[0]]
    for s, is_clear, end in zip(step, clear, centres[1:], strict=True):
        if not is_clear:
            for axis in np.flatnonzero(s)[:-1]:
                corner = points[-1].copy()
                corner[axis] += s[axis] * space.pitch_m
                points.append(corner)
        points.append(end)
    return np.array(points)
