"""Viewpoints for the cells of a face: straight in front, and moved or tilted where that place will not do.

The tower paper's environment matrix: each cell has one viewpoint, which is free or blocked by a stay cable. Here a
blocked one is moved to another place that shows the whole cell, and given up with a reason when there is none.
"""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.errors import InfeasibleError
from gcs.core.plan import CellNote, FaceCoverage
from gcs.planning.views.cell_offsets import cell_offsets, cell_view_angles
from gcs.planning.views.face_grid import (
    face_cells,
    lifted_onto_surface,
    outward_normal,
    require_on_surface,
    sample_shares,
    surface_tolerance_m,
)
from gcs.planning.views.face_obstacles import FaceObstacles
from gcs.planning.views.viewpoint_pose import ViewpointPose, camera_axes

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from gcs.core.inspection import FaceTask
    from gcs.core.scenario import Scenario
    from gcs.core.structure import Structure
    from gcs.planning.scene.free_space import FreeSpace
    from gcs.planning.scene.point_distance import SceneDistance
    from gcs.planning.scene.visibility import SightLines
    from gcs.planning.views.cell_offsets import CellOffsets
    from gcs.planning.views.face_grid import FaceCell

SAMPLES_ALONG = 12
FEW = 5
"""Corners and middle come first among the samples of a cell; most places that do not see all fail at one of them."""

CHECKED = 0.2
"""Share of the work that is the check whether the cells lie on the structure."""

MOST_OFF = 0.5
"""Share of a face's cells that may lie off the structure: a deck runs into it, or there is an opening."""

OFF_SURFACE = "part of it lies on no surface of the structure"
OUT_OF_GIMBAL = "the gimbal cannot look at it straight on"
NO_OTHER = ("is within the gimbal's range", "is free", "can be reached", "sees all of it")
"""What no place of a cell is or does, by how well the best of them does."""

SEES_ALL = len(NO_OTHER)


class FaceSearch:
    """Looks for one viewpoint for every cell of a face.

    The wanted place is straight in front of the cell's middle, as near as the cell with the position error around it
    and the clearance allow. If it is not free, not connected with home, does not see the whole cell, or is not under
    the open sky, another place is taken that is and does, within the incidence limit at every corner of the cell and
    at no more than the GSD: the least tilted, and of those the nearest. Where no such place is under the open sky
    (below a deck), the same is done without it.

    Args:
        scenario: camera, vehicle, position error and seed.
        structure: what stands in the scene.
        clearance_m: smallest distance of a viewpoint from a surface.
        space: where the vehicle may be.
        sight: what hides the face.
        distance: exact distances.
        furthest_m: no viewpoint is further away.
    """

    def __init__(
        self,
        scenario: Scenario,
        structure: Structure,
        clearance_m: float,
        space: FreeSpace,
        sight: SightLines,
        distance: SceneDistance,
        furthest_m: float,
    ) -> None:
        self._scenario = scenario
        self._clearance = clearance_m
        self._space = space
        self._sight = sight
        self._distance = distance
        self._furthest = furthest_m
        self._obstacles = FaceObstacles(structure, clearance_m, space, sight)

    def find(self, face: FaceTask, tell: Callable[[float], None]) -> tuple[list[ViewpointPose], FaceCoverage]:
        """Viewpoints of a face.

        Args:
            face: the task.
            tell: told the done share; may raise to stop.

        Returns:
            The viewpoints, row by row, and what became of each cell.

        Raises:
            InputError: the face does not lie on the structure.
            InfeasibleError: not one cell can be seen whole, or the GSD asks for less than the clearance.
        """
        cells = face_cells(face)
        targets = self._targets(face, cells, tell)
        offsets: dict[tuple[float, float], CellOffsets] = {}
        poses: list[ViewpointPose] = []
        moved: list[CellNote] = []
        not_covered: list[CellNote] = []
        for number, (cell, target) in enumerate(zip(cells, targets, strict=True)):
            tell(CHECKED + (1 - CHECKED) * number / len(cells))
            if target is None:
                not_covered.append(CellNote(cell.name, OFF_SURFACE))
                continue
            size = (round(float(np.linalg.norm(cell.along_m)), 9), round(float(np.linalg.norm(cell.up_m)), 9))
            if size not in offsets:
                offsets[size] = cell_offsets(cell, face, self._scenario, self._clearance, self._furthest)
            around = offsets[size]
            places = cell.middle_m + around.offset_m
            chosen, best = self._choose(places, around, target)
            if chosen != 0:
                blocked = self._obstacles.reason(places[0], target) if around.in_gimbal[0] else OUT_OF_GIMBAL
                if chosen is None:
                    other = f"no other place within {face.max_incidence_deg:g} degrees of its normal {NO_OTHER[best]}"
                    not_covered.append(CellNote(cell.name, f"{blocked}, and {other}"))
                    continue
                moved.append(CellNote(cell.name, blocked))
            gsd = self._scenario.camera.gsd_at(float(around.length_m[chosen]))
            poses.append(_pose(cell, places[chosen], gsd))
        if not poses:
            raise InfeasibleError(_nothing_seen(not_covered), field=f"inspection.faces.{face.name}")
        return poses, FaceCoverage(face.name, len(cells), tuple(moved), tuple(not_covered))

    def _targets(
        self, face: FaceTask, cells: Sequence[FaceCell], tell: Callable[[float], None]
    ) -> list[NDArray[np.float64] | None]:
        """Samples of each cell, a little above the surface, each of shape (K, 3); None for a cell that lies off it."""
        shares = sample_shares(np.random.default_rng(self._scenario.planner.seed), SAMPLES_ALONG)
        normal, within = outward_normal(face), surface_tolerance_m(self._scenario)
        targets = []
        for number, cell in enumerate(cells):
            tell(CHECKED * number / len(cells))
            targets.append(lifted_onto_surface(cell.at(shares), normal, self._distance, within))
        off = [cell.at(shares) for cell, target in zip(cells, targets, strict=True) if target is None]
        if len(off) > MOST_OFF * len(cells):
            points, field = np.concatenate(off), f"inspection.faces.{face.name}"
            require_on_surface(points, self._distance, within, "the face", field)
        return targets

    def _choose(
        self, places: NDArray[np.float64], around: CellOffsets, target: NDArray[np.float64]
    ) -> tuple[int | None, int]:
        """Number of the place to take, None without one, and how well the best of those that were tried does."""
        open_sky = self._space.is_open_sky(places)
        best = 0
        for sky in (True, False):
            for tilt in np.unique(around.tilt_deg):
                which = np.flatnonzero((around.tilt_deg == tilt) & around.in_gimbal & (open_sky == sky))
                # the wanted place first, alone: mostly it will do
                for some in (which[:1], which[1:]) if tilt == 0 else (which,):
                    if not len(some):
                        continue
                    tried = self._tried(places[some], target)
                    best = max(best, int(tried.max()))
                    good = some[tried == SEES_ALL]
                    if len(good):
                        return int(good[np.argmin(around.length_m[good])]), best
        return None, best

    def _tried(self, places: NDArray[np.float64], target: NDArray[np.float64]) -> NDArray[np.int64]:
        """How well places within the gimbal's range do, shape (N,): 1, free 2, reachable 3, or SEES_ALL."""
        result = np.ones(len(places), dtype=np.int64)
        free = np.flatnonzero(self._space.is_free(places))
        result[free] = 2
        left = free[self._space.is_reachable(places[free])]
        result[left] = 3
        for part in (target[:FEW], target[FEW:]):
            origins, targets = np.repeat(places[left], len(part), axis=0), np.tile(part, (len(left), 1))
            sees = self._sight.clear(origins, targets).reshape(len(left), len(part)).all(axis=1)
            left = left[sees]
        result[left] = SEES_ALL
        return result


def _pose(cell: FaceCell, place_m: NDArray[np.float64], gsd_m: float) -> ViewpointPose:
    yaw, pitch = cell_view_angles(cell.middle_m - place_m, cell.up_m)
    direction, up = camera_axes(yaw, pitch)
    return ViewpointPose(cell.name, place_m, direction, up, gsd_m, yaw, pitch)


def _nothing_seen(not_covered: Sequence[CellNote]) -> str:
    counted = Counter(note.reason for note in not_covered).most_common(2)
    reasons = "; ".join(f"{reason} ({count} cells)" for reason, count in counted)
    return f"not one of its {len(not_covered)} cells can be photographed whole: {reasons}"
