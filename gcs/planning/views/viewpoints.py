"""From what is to be inspected to viewpoints: the front door of viewpoint planning."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.errors import InfeasibleError, InputError
from gcs.planning.scene.free_space import TOLERANCE_M
from gcs.planning.scene.visibility import SightLines
from gcs.planning.views.cell_offsets import furthest_cell_place_m
from gcs.planning.views.face_grid import face_cells, require_on_surface, surface_tolerance_m
from gcs.planning.views.picture_limits import nearest_place
from gcs.planning.views.surface_candidates import STAGE
from gcs.planning.views.viewpoints_faces import FaceSearch
from gcs.planning.views.viewpoints_points import FARTHER, find_point_viewpoints, stand_off_m
from gcs.planning.views.viewpoints_spots import find_spot_viewpoints
from gcs.planning.views.viewpoints_surface import find_surface_viewpoints

if TYPE_CHECKING:
    from gcs.core.inspection import FaceTask, NamedPoint
    from gcs.core.plan import FaceCoverage
    from gcs.core.progress import Progress
    from gcs.core.scenario import Scenario
    from gcs.core.structure import Structure
    from gcs.planning.scene.free_space import FreeSpace
    from gcs.planning.scene.point_distance import SceneDistance
    from gcs.planning.views.cover_problem import CoverProblem
    from gcs.planning.views.viewpoint_pose import ViewpointPose

MOST_STAND_OFF_M = 40.0
"""No viewpoint is further away, however coarse the GSD: the space that is searched has to end somewhere."""

KEPT_MORE_M = TOLERANCE_M + 1e-3
"""The space's own tolerance: places that are nearer than this on top of the clearance do not count as free."""


@dataclass(frozen=True, eq=False)
class FoundViewpoints:
    """What the search for viewpoints found.

    Attributes:
        poses: points in the scenario's order, then the faces' cells row by row, then the surface's viewpoints in the
            order they were chosen, then those of spots that these leave out.
        cover: the cover that the surface's viewpoints answer, `cover.chosen` in the order of the poses; None when no
            surface was asked for.
        faces: what became of the cells of each face, in the scenario's order.
        others: for some of the poses, by their number, others that may be taken instead. None with a surface: what it
            still needs depends on what these poses show of it.
    """

    poses: list[ViewpointPose]
    cover: CoverProblem | None
    faces: tuple[FaceCoverage, ...] = ()
    others: dict[int, list[ViewpointPose]] = field(default_factory=dict)


def points_to_inspect(scenario: Scenario, structure: Structure) -> tuple[NamedPoint, ...]:
    """The named points: the scenario's, or the sample's own when it asks for nothing else."""
    return structure.named_points if scenario.inspection is None else scenario.inspection.points


def faces_to_inspect(scenario: Scenario) -> tuple[FaceTask, ...]:
    """The faces that the scenario asks for."""
    return () if scenario.inspection is None else scenario.inspection.faces


def stand_off_reach(scenario: Scenario, structure: Structure, clearance_m: float) -> float:
    """How far (m) from the structure viewpoints may lie, at most 40 m.

    Args:
        scenario: what is asked.
        structure: gives the sample's points.
        clearance_m: what the centre keeps, corridor reach included.

    Raises:
        InfeasibleError: a point's or a face's GSD asks for less than the clearance.
    """
    camera, kept = scenario.camera, clearance_m + KEPT_MORE_M
    nearest = nearest_place(scenario, kept)
    points = points_to_inspect(scenario, structure)
    reach = [stand_off_m(p, camera, nearest, MOST_STAND_OFF_M) * (1.0 if p.gsd_mm else FARTHER[-1]) for p in points]
    for face in faces_to_inspect(scenario):
        reach.append(furthest_cell_place_m(face_cells(face)[0], face, scenario, kept, MOST_STAND_OFF_M))
    if scenario.inspection is not None and scenario.inspection.surface is not None:
        reach.append(camera.distance_for_gsd(scenario.inspection.surface.gsd_mm / 1000))
    return min(max(reach, default=0.0), MOST_STAND_OFF_M)


def find_viewpoints(
    scenario: Scenario, structure: Structure, space: FreeSpace, distance: SceneDistance, progress: Progress
) -> FoundViewpoints:
    """Find a viewpoint for every named point and every cell of a face, and some that together see the surface.

    Every one is free, connected with home, within the gimbal's range, and has clear sight of what it is for.

    Args:
        scenario: what is to be inspected, with which camera.
        structure: what stands in the scene.
        space: where the vehicle's centre may be.
        distance: exact distances, which every viewpoint is checked against once more.
        progress: told about the stage `viewpoints`.

    Raises:
        InputError: nothing is to be inspected, or a point or a face does not lie on the structure.
        InfeasibleError: a point, a face or the surface cannot be photographed as asked; says which and why.
    """
    points, faces = points_to_inspect(scenario, structure), faces_to_inspect(scenario)
    surface = scenario.inspection.surface if scenario.inspection else None
    if not points and not faces and surface is None:
        raise InputError("nothing is to be inspected: name points or a surface, or faces", field="inspection")
    sight = SightLines(structure)
    clearance = space.clearance_m + KEPT_MORE_M
    share = (0.1 if surface else 1.0) / max(len(points) + len(faces), 1)
    nearest = nearest_place(scenario, clearance)
    poses: list[ViewpointPose] = []
    others: dict[int, list[ViewpointPose]] = {}
    for done, point in enumerate(points, start=1):
        _require_on_surface(point, scenario, distance)
        best, *rest = find_point_viewpoints(point, scenario.camera, nearest, space, sight, MOST_STAND_OFF_M)
        if rest and surface is None:
            others[len(poses)] = rest
        poses.append(best)
        progress.report(STAGE, share * done)
    seen_faces: list[FaceCoverage] = []
    if faces:
        search = FaceSearch(scenario, structure, clearance, space, sight, distance, MOST_STAND_OFF_M)
        for done, face in enumerate(faces, start=len(points)):
            views, seen = search.find(face, partial(_tell, progress, share, done))
            poses += views
            seen_faces.append(seen)
    cover = None
    if surface is not None:
        reach = min(scenario.camera.distance_for_gsd(surface.gsd_mm / 1000), MOST_STAND_OFF_M)
        found, cover = find_surface_viewpoints(scenario, surface, structure, space, sight, reach, poses, progress)
        poses += found
        if surface.spots:
            poses += find_spot_viewpoints(
                scenario, structure, surface, poses, space, distance, sight, nearest.distance_m, reach, progress
            )
    _require_clearance([*poses, *itertools.chain(*others.values())], scenario.centre_clearance_m, distance)
    progress.report(STAGE, 1.0)
    return FoundViewpoints(poses, cover, tuple(seen_faces), others)


def _tell(progress: Progress, share: float, done: int, part: float) -> None:
    progress.report(STAGE, share * (done + part))


def _require_on_surface(point: NamedPoint, scenario: Scenario, distance: SceneDistance) -> None:
    place, within = np.array([point.position_m]), surface_tolerance_m(scenario)
    require_on_surface(place, distance, within, "this point", f"inspection.points.{point.name}")


def _require_clearance(poses: list[ViewpointPose], clearance_m: float, distance: SceneDistance) -> None:
    found = distance.distance([p.position_m for p in poses], limit=clearance_m)
    for pose, d in zip(poses, found, strict=True):
        if d < clearance_m:
            raise InfeasibleError(f"viewpoint {pose.name} is {d:.2f} m from a surface; {clearance_m:.2f} m are kept")
