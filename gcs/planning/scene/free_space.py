"""Where the vehicle's centre may be: clear of the structure and the ground, inside the fence, connected with home.

There are two levels. The *wide* space keeps the clearance and the corridor's reach: whatever is flown about a path in
it keeps the clearance. The *tight* space keeps the bare clearance: places close to a wall and passages that are only
that narrow belong to it, and corridors there are as narrow as they have to be. Every wide place is a tight one too.
"""

from __future__ import annotations

import itertools
import math
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.errors import InputError
from gcs.core.progress import SilentProgress
from gcs.planning.numerics.thread_pieces import in_pieces
from gcs.planning.scene.box_clearance import box_free, grown_box
from gcs.planning.scene.distance_field import HALF_DIAGONAL
from gcs.planning.scene.fence import FenceVolume, room_in_fence
from gcs.planning.scene.grid_search import cover_depth
from gcs.planning.scene.open_sky import OpenSky, covered_length
from gcs.planning.scene.point_distance import TriangleDistance
from gcs.planning.scene.room import (
    HOME_COLUMN_RADIUS_M,
    RoomModel,
    exact_distance,
    least_room,
    nearest_linked_cell,
    points_free,
    points_linked,
    refine_shell,
    segments_free,
)
from gcs.planning.scene.separating_planes import separating_planes
from gcs.planning.scene.widest_way import largest_clearance_m

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from gcs.core.progress import Progress
    from gcs.planning.scene.distance_field import DistanceField

LINK_REACH = 2
"""How many cells away the first grid cell of a path may lie from an exact end point."""

TOLERANCE_M = 0.04
"""Room that a free point has: how much nearer than a viewpoint the boxes about a path may come."""

SPOT_RADIUS_M = 1.0
"""A path may be in the tight space as far as this from a tight place that it goes through, and a little further where
there is more than the clearance."""

ROOM_ACCURACY_M = 0.002
"""How far below the true one the room along a segment may be said to be."""

LEAST_POINTS = 256
EVERYWHERE = FenceVolume(np.zeros((0, 2)), np.zeros(1, np.int64), 0, math.inf, 0.0)
NO_SPOTS = np.zeros((0, 3))


class FreeSpace:
    """The space in which the vehicle's centre keeps all its distances, on a grid and at exact points.

    A cell is free when its centre has half a pitch of room more than asked: then every straight step between face
    neighbours that are both free is proved. Points and segments are judged exactly (see `room`), not by
    their cells. The column over home (0.5 m about it) is exempt from the ground, as far down as home; it belongs to
    the space of points and segments, and to no cell.

    Viewpoints may lie anywhere in the tight space: ask `is_free` and `is_reachable`, and `nearest_m` for the smallest
    distance from a surface that one can have.

    Args:
        field: lower bound of the distance to the structure on the grid.
        clearance_m: what the centre keeps from surfaces, cable hulls and the ground.
        ground_m: height of the flat ground; None when there is none.
        home_m: where the vehicle takes off and lands, shape (3,).
        fence: what to stay in; None for no fence.
        progress: told about the stage `free_space`.
        reach_m: what the wide space keeps besides, from the fence too.
        climb_clearance_m: what the centre keeps from surfaces in a straight climb under the open sky; `clearance_m`
            when not given.
        surfaces: the distance to the field's triangles, if it is there already.

    Attributes:
        clearance_m: as given.
        reach_m: as given.
        climb_clearance_m: as given, or `clearance_m`.
        nearest_m: smallest distance from a surface that a free point can have.
        ground_m: as given.
        home_m: shape (3,).
        take_off_m: the point straight above home where the wide space's grid is first met, shape (3,); always above
            home, so that every flight starts and ends with a vertical leg.
        low_m: lowest corner of the grid, shape (3,).
        high_m: highest corner, shape (3,).
        pitch_m: edge of the cells.
        model: everything that limits the centre in the tight space, for kernels.
        wide_model: the same in the wide space.
        free_mask: cells of the tight space, shape (nx, ny, nz) bool.
        reachable_mask: those of them that are connected with home.
        wide_mask: cells of the wide space that are connected with home in it.
        sky_floor_m: per column of cells the lowest height from which a straight climb keeps the climb clearance
            to the structure for every point of the column's cross-section, shape (nx, ny); inf where there is none.
        open_sky_mask: cells of `wide_mask` whose centre lies above that, shape (nx, ny, nz) bool.

    Raises:
        InputError: home is below the ground, outside the fence or the grid, too near the structure, or enclosed.
    """

    def __init__(
        self,
        field: DistanceField,
        clearance_m: float,
        ground_m: float | None,
        home_m: ArrayLike,
        fence: FenceVolume | None = None,
        progress: Progress | None = None,
        *,
        reach_m: float = 0.0,
        climb_clearance_m: float | None = None,
        surfaces: TriangleDistance | None = None,
    ) -> None:
        progress = progress or SilentProgress()
        self.clearance_m = float(clearance_m)
        self.reach_m = float(reach_m)
        self.climb_clearance_m = self.clearance_m if climb_clearance_m is None else float(climb_clearance_m)
        self.ground_m = ground_m
        self.home_m = np.array(home_m, dtype=np.float64)
        self.low_m = field.origin_m
        self.high_m = field.high_m
        self.pitch_m = field.pitch_m
        surfaces = surfaces or TriangleDistance(field.structure.triangles_m)
        self.model = RoomModel(
            low=np.ascontiguousarray(self.low_m, dtype=np.float64),
            high=np.ascontiguousarray(self.high_m, dtype=np.float64),
            pitch=float(self.pitch_m),
            tolerance=min(TOLERANCE_M, self.pitch_m / 6),
            clearance=self.clearance_m,
            extra=0.0,
            spots=NO_SPOTS,
            spot_radius=max(SPOT_RADIUS_M, self.pitch_m),
            distance=field.distance_m.copy(),
            looseness=field.looseness_m + 1e-3,
            triangles=surfaces.triangles_m,
            tree=surfaces.tree,
            cable_ends=np.ascontiguousarray(field.structure.cable_ends_m),
            cable_radii=np.ascontiguousarray(field.structure.cable_radii_m),
            ground=-math.inf if ground_m is None else float(ground_m),
            home=self.home_m,
            fence=fence or EVERYWHERE,
        )
        self.wide_model = self.model._replace(extra=self.reach_m)
        self.nearest_m = self.clearance_m + self.model.tolerance
        self._offsets = _offsets_by_distance()
        self._check_home()
        progress.report("free_space", 0.0)
        self._refine(progress)
        self.free_mask, wide, self.sky_floor_m = self._masks()
        progress.report("free_space", 0.7)
        self.take_off_m, self.reachable_mask, self.wide_mask = self._connect_home(wide)
        self.open_sky_mask = self.wide_mask & (self._heights() >= self.sky_floor_m[:, :, None])
        if not self.open_sky_mask.any():
            raise InputError("home is enclosed by the structure: no way leads to the open sky", field="home_m")
        progress.report("free_space", 1.0)

    @property
    def sky(self) -> OpenSky:
        """The open sky, for kernels."""
        return OpenSky(self.model.low, self.model.pitch, self.sky_floor_m)

    @cached_property
    def open_sky_regions(self) -> NDArray[np.int32]:
        """Number of the connected part of `open_sky_mask` that a cell belongs to (0: none), shape (nx, ny, nz)."""
        from scipy import ndimage

        return np.asarray(ndimage.label(self.open_sky_mask)[0], dtype=np.int32)

    @cached_property
    def cover_depth(self) -> NDArray[np.float32]:
        """How far from the open sky the wide cells under cover lie, in pitches; see `cover_depth`."""
        return cover_depth(self.wide_mask, self.open_sky_mask)

    def covered_length(self, path_m: NDArray[np.float64]) -> float:
        """Length (m) of the part of a polyline (K, 3) that is not under the open sky."""
        return sum(covered_length(a, b, self.sky) for a, b in itertools.pairwise(_points(path_m)))

    def cell_of(self, points: ArrayLike) -> NDArray[np.int64]:
        """Cell indices of points, shape (N, 3) -> (N, 3); not checked against the grid's size."""
        p = np.asarray(points, dtype=np.float64).reshape(-1, 3)
        return np.floor((p - self.low_m) / self.pitch_m).astype(np.int64)

    def centre_of(self, cells: ArrayLike) -> NDArray[np.float64]:
        """Centres (m) of cells, shape (N, 3) -> (N, 3)."""
        return self.low_m + (np.asarray(cells, dtype=np.float64).reshape(-1, 3) + 0.5) * self.pitch_m

    def is_free(self, points: ArrayLike) -> NDArray[np.bool_]:
        """Whether the centre may be at points, exactly; shape (N, 3) -> (N,). Outside the grid it may not."""
        p = _points(points)
        free = np.zeros(len(p), dtype=np.bool_)
        in_pieces(lambda first, end: points_free(p, self.model, free, first, end), len(p), LEAST_POINTS)
        return free

    def is_reachable(self, points: ArrayLike) -> NDArray[np.bool_]:
        """Whether points are free and connected with home through free space; shape (N, 3) -> (N,)."""
        p = _points(points)
        linked = np.zeros(len(p), dtype=np.bool_)
        in_pieces(
            lambda first, end: points_linked(p, self.reachable_mask, self._offsets, self.model, linked, first, end),
            len(p),
            LEAST_POINTS,
        )
        aside = np.hypot(p[:, 0] - self.home_m[0], p[:, 1] - self.home_m[1])
        for n in np.flatnonzero(~linked & (aside <= HOME_COLUMN_RADIUS_M)):
            linked[n] = self.in_home_column(p[n]) and self.segment_free(p[n], self.take_off_m, strict=True)
        return linked

    def is_open_sky(self, points: ArrayLike) -> NDArray[np.bool_]:
        """Whether a straight climb from points keeps the climb clearance to the structure; shape (N, 3) -> (N,)."""
        p = _points(points)
        cell = self.cell_of(p)
        inside = ((cell >= 0) & (cell < self.free_mask.shape)).all(axis=1)
        result = np.zeros(len(p), dtype=np.bool_)
        result[inside] = p[inside, 2] >= self.sky_floor_m[cell[inside, 0], cell[inside, 1]]
        return result

    def segment_free(self, a: ArrayLike, b: ArrayLike, *, strict: bool = False, model: RoomModel | None = None) -> bool:
        """Whether every point of the straight segment between two points (3,) is free; proved, not sampled.

        Args:
            a: one end.
            b: the other.
            strict: whether its parts, and the way back, must also pass (not strictly); paths are made of such.
            model: of the space that is asked; the tight one by default.
        """
        return bool(self.segments_free(a, b, strict=strict, model=model)[0])

    def segments_free(
        self, a: ArrayLike, b: ArrayLike, *, strict: bool = False, model: RoomModel | None = None
    ) -> NDArray[np.bool_]:
        """`segment_free` for many segments, shapes (M, 3) -> (M,)."""
        model = model or self.model
        least = model.tolerance if strict else model.tolerance / 2
        return segments_free(_points(a), _points(b), least, model)

    def model_about(self, spots: ArrayLike) -> RoomModel:
        """The wide space, and the tight one about some places of it, shape (K, 3)."""
        return self.wide_model._replace(spots=_points(spots))

    def is_wide(self, points: ArrayLike) -> NDArray[np.bool_]:
        """Whether points are free in the wide space, shape (N, 3) -> (N,)."""
        p = _points(points)
        free = np.zeros(len(p), dtype=np.bool_)
        points_free(p, self.wide_model, free, 0, len(p))
        return free

    def linked_cell(
        self, point: ArrayLike, allowed: NDArray[np.bool_] | None = None, model: RoomModel | None = None
    ) -> NDArray[np.int64] | None:
        """The nearest cell whose centre a point (3,) is joined to by a free segment, shape (3,).

        Args:
            point: where to link from.
            allowed: cells to choose from, shape (nx, ny, nz); the reachable ones by default.
            model: of the space that the segment has to be in; the tight one by default.
        """
        cell = np.empty(3, dtype=np.int64)
        mask = self.reachable_mask if allowed is None else allowed
        found = nearest_linked_cell(_points(point)[0], mask, self._offsets, model or self.model, cell)
        return cell if found else None

    def box_free(self, low: ArrayLike, high: ArrayLike) -> bool:
        """Whether every point of a box with corners (3,) keeps the clearance; the column over home is not exempt."""
        return box_free(_points(low)[0], _points(high)[0], self.model)

    def grown_box(
        self, low: ArrayLike, high: ArrayLike, most_low: ArrayLike, most_high: ArrayLike
    ) -> NDArray[np.float64]:
        """A free box grown within a larger one as far as it stays free, all corners (3,); shape (2, 3)."""
        least = _points(low)[0], _points(high)[0]
        return np.stack(grown_box(*least, _points(most_low)[0], _points(most_high)[0], self.model))

    def least_room_m(self, a: ArrayLike, b: ArrayLike) -> float:
        """Lower bound of how far any point of the segment between two points (3,) can move and stay free."""
        return least_room(_points(a)[0], _points(b)[0], ROOM_ACCURACY_M, self.model)

    def cut_free(self, a: ArrayLike, b: ArrayLike, planes: ArrayLike, reach_m: float) -> NDArray[np.float64] | None:
        """The planes (m, 4) of a convex set about a segment and those that cut it free; None where none can.

        The column over home is not exempt; see `separating_planes`.
        """
        within = np.ascontiguousarray(planes, dtype=np.float64)
        found, free = separating_planes(_points(a)[0], _points(b)[0], within, reach_m, self.model)
        return found if free else None

    def largest_clearance_m(self, places: ArrayLike, *, fenced: bool = True) -> float:
        """Largest clearance at which one of places (N, 3) can be reached, see `widest_way`."""
        return largest_clearance_m(self, _points(places), fenced=fenced)

    def in_home_column(self, point: ArrayLike) -> bool:
        """Whether a point (3,) is over home and below the take-off point: it is left vertically."""
        p = np.asarray(point, dtype=np.float64)
        aside = float(np.hypot(p[0] - self.home_m[0], p[1] - self.home_m[1]))
        return bool(aside <= HOME_COLUMN_RADIUS_M and p[2] < self.take_off_m[2])

    def _check_home(self) -> None:
        home = self.home_m
        if not ((home >= self.low_m) & (home < self.high_m)).all():
            raise InputError("home lies outside the planning volume", field="home_m")
        if self.ground_m is not None and home[2] < self.ground_m - 1e-6:
            raise InputError(f"home is {self.ground_m - home[2]:.2f} m below the ground: raise it", field="home_m")
        fence = self.model.fence
        if room_in_fence(home, fence)[0] < self.reach_m + self.model.tolerance:
            raise InputError(
                f"home is outside the fence, or nearer to its edge than the {fence.margin_m + self.reach_m:.2f} m that "
                "the vehicle's size, its position errors and the corridor take",
                field="home_m",
            )
        kept = self.clearance_m + self.reach_m
        distance = exact_distance(home, kept + 1.0, self.model)
        if distance < kept + self.model.tolerance:
            raise InputError(
                f"home is inside the structure or too near it: {distance:.2f} m from the nearest surface, and "
                f"{kept:.2f} m are kept",
                field="home_m",
            )

    def _refine(self, progress: Progress) -> None:
        tight = self.clearance_m + self._needed_m
        thresholds = np.unique([tight, tight + self.reach_m, self._whole_m])
        in_pieces(
            lambda first, end: refine_shell(thresholds, self.model, first, end),
            self.model.distance.shape[0],
            poll=lambda share: progress.report("free_space", 0.5 * share),
        )
        progress.report("free_space", 0.5)

    @property
    def _needed_m(self) -> float:
        """Room that a free cell's centre has: two face neighbours with it prove all between them."""
        return self.pitch_m / 2 + self.model.tolerance

    @property
    def _whole_m(self) -> float:
        """Distance of a centre with which its whole cube keeps the climb clearance."""
        return self.climb_clearance_m + HALF_DIAGONAL * self.pitch_m

    def _heights(self) -> NDArray[np.float64]:
        layers = np.arange(self.model.distance.shape[2])
        return np.asarray(self.low_m[2] + (layers + 0.5) * self.pitch_m)

    def _masks(self) -> tuple[NDArray[np.bool_], NDArray[np.bool_], NDArray[np.float64]]:
        """Cells that are free in the tight and in the wide space, and the floor of the open sky."""
        free = self.free_cells(self.clearance_m)
        wide = self.free_cells(self.clearance_m, self.reach_m) if self.reach_m > 0 else free

        whole = self.model.distance >= np.float32(self._whole_m)
        covered_from_top = np.argmin(whole[:, :, ::-1], axis=2)
        layers = whole.shape[2]
        clear_cells = np.where(whole.all(axis=2), layers, covered_from_top)
        floor = self.low_m[2] + (layers - clear_cells) * self.pitch_m
        return free, wide, np.where(clear_cells > 0, floor, math.inf)

    @cached_property
    def _room_aside_m(self) -> NDArray[np.float64]:
        """Room to the fence's polygons of each column of cells, shape (nx, ny)."""
        nx, ny, _ = self.model.distance.shape
        columns = np.stack(np.meshgrid(np.arange(nx), np.arange(ny), indexing="ij"), axis=-1).reshape(-1, 2)
        centres = self.centre_of(np.column_stack([columns, np.zeros(len(columns))]))
        centres[:, 2] = -math.inf  # so that the height limit does not count
        return room_in_fence(centres, self.model.fence).reshape(nx, ny)

    def free_cells(self, clearance_m: float, reach_m: float = 0.0, *, fenced: bool = True) -> NDArray[np.bool_]:
        """Cells that would be free with some clearance, connected with home or not, shape (nx, ny, nz).

        Args:
            clearance_m: what the centre keeps from surfaces and the ground.
            reach_m: what it keeps besides, from the fence too.
            fenced: whether the fence is kept.
        """
        needed, heights = self._needed_m + reach_m, self._heights()
        low = -math.inf if self.ground_m is None else self.ground_m + clearance_m + needed
        free = (self.model.distance >= np.float32(clearance_m + needed)) & (heights >= low)
        if fenced:
            free &= (self._room_aside_m >= needed)[:, :, None]
            free &= heights <= self.model.fence.max_height_m - self.model.fence.margin_m - needed
        return free

    def _connect_home(
        self, wide: NDArray[np.bool_]
    ) -> tuple[NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_]]:
        """Climb over home until a free cell is met; then flood the free cells of both levels from there."""
        from scipy import ndimage

        point = self.home_m.copy()
        ground = self.home_m[2] if self.ground_m is None else self.ground_m
        point[2] = max(point[2] + self.pitch_m, ground + self.clearance_m + self.reach_m + self._needed_m)
        while point[2] < self.high_m[2] and self.segment_free(self.home_m, point, strict=True, model=self.wide_model):
            cell = self.linked_cell(point, wide, self.wide_model)
            if cell is not None:
                labels, _ = ndimage.label(wide)
                connected = labels == labels[tuple(cell)]
                if wide is self.free_mask:
                    return point, connected, connected
                labels, _ = ndimage.label(self.free_mask)
                return point, labels == labels[tuple(cell)], connected
            point[2] += self.pitch_m / 4
        raise InputError(
            f"no free way up from home: the column over it is blocked within {point[2] - self.home_m[2]:.1f} m",
            field="home_m",
        )


def _points(points: ArrayLike) -> NDArray[np.float64]:
    return np.ascontiguousarray(np.asarray(points, dtype=np.float64).reshape(-1, 3))


def _offsets_by_distance() -> NDArray[np.int64]:
    span = range(-LINK_REACH, LINK_REACH + 1)
    offsets = np.array(list(itertools.product(span, span, span)), dtype=np.int64)
    return offsets[np.argsort((offsets**2).sum(axis=1), kind="stable")]
