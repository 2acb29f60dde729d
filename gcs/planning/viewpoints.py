"""From what is to be inspected to viewpoints: the front door of viewpoint planning."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gcs.core.errors import InfeasibleError, InputError
from gcs.planning.surface_candidates import STAGE
from gcs.planning.viewpoints_points import FARTHER, find_point_viewpoint, stand_off_m
from gcs.planning.viewpoints_surface import find_surface_viewpoints
from gcs.planning.visibility import SightLines

if TYPE_CHECKING:
    from gcs.core.inspection import NamedPoint
    from gcs.core.progress import Progress
    from gcs.core.scenario import Scenario
    from gcs.core.structure import Structure
    from gcs.planning.free_space import FreeSpace
    from gcs.planning.point_distance import SceneDistance
    from gcs.planning.viewpoint_pose import ViewpointPose

MOST_STAND_OFF_M = 40.0
"""No viewpoint is further away, however coarse the GSD: the space that is searched has to end somewhere."""


def points_to_inspect(scenario: Scenario, structure: Structure) -> tuple[NamedPoint, ...]:
    """The named points: the scenario's, or the sample's own when it asks for nothing else."""
    return structure.named_points if scenario.inspection is None else scenario.inspection.points


def stand_off_reach(scenario: Scenario, structure: Structure, clearance_m: float) -> float:
    """How far (m) from the structure viewpoints may lie, at most 40 m.

    Args:
        scenario: what is asked.
        structure: gives the sample's points.
        clearance_m: what the centre keeps, corridor reach included.

    Raises:
        InfeasibleError: a point's GSD asks for less than the clearance.
    """
    points = points_to_inspect(scenario, structure)
    reach = [stand_off_m(p, scenario.camera, clearance_m) * (1.0 if p.gsd_mm else FARTHER[-1]) for p in points]
    if scenario.inspection is not None and scenario.inspection.surface is not None:
        reach.append(scenario.camera.distance_for_gsd(scenario.inspection.surface.gsd_mm / 1000))
    return min(max(reach, default=0.0), MOST_STAND_OFF_M)


def find_viewpoints(
    scenario: Scenario, structure: Structure, space: FreeSpace, distance: SceneDistance, progress: Progress
) -> list[ViewpointPose]:
    """Find a viewpoint for every named point, and viewpoints that together see the surface that is asked for.

    Every one is free, connected with home, within the gimbal's range, and has clear sight of what it is for.

    Args:
        scenario: what is to be inspected, with which camera.
        structure: what stands in the scene.
        space: where the vehicle's centre may be.
        distance: exact distances, which every viewpoint is checked against once more.
        progress: told about the stage `viewpoints`.

    Returns:
        Points in the scenario's order, then the surface's viewpoints in the order they were chosen.

    Raises:
        InputError: nothing is to be inspected.
        InfeasibleError: a point or the surface cannot be photographed as asked; says which and why.
    """
    points = points_to_inspect(scenario, structure)
    surface = scenario.inspection.surface if scenario.inspection else None
    if not points and surface is None:
        raise InputError("nothing is to be inspected: name points or a surface", field="inspection")
    sight = SightLines(structure)
    poses = []
    for done, point in enumerate(points):
        poses.append(find_point_viewpoint(point, scenario.camera, space, sight, MOST_STAND_OFF_M))
        progress.report(STAGE, (0.1 if surface else 1.0) * (done + 1) / len(points))
    if surface is not None:
        reach = min(scenario.camera.distance_for_gsd(surface.gsd_mm / 1000), MOST_STAND_OFF_M)
        poses += find_surface_viewpoints(scenario, surface, structure, space, sight, reach, poses, progress)
    _require_clearance(poses, scenario.centre_clearance_m, distance)
    progress.report(STAGE, 1.0)
    return poses


def _require_clearance(poses: list[ViewpointPose], clearance_m: float, distance: SceneDistance) -> None:
    found = distance.distance([p.position_m for p in poses], limit=clearance_m)
    for pose, d in zip(poses, found, strict=True):
        if d < clearance_m:
            raise InfeasibleError(f"viewpoint {pose.name} is {d:.2f} m from a surface; {clearance_m:.2f} m are kept")
