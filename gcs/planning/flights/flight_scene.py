"""What is flown in: the distance to the structure, and the free space about it that is connected with home."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gcs.planning.flights.ways_home import MARGIN_M
from gcs.planning.scene.distance_field import build_distance_field, choose_pitch
from gcs.planning.scene.fence import fence_volume
from gcs.planning.scene.free_space import FreeSpace
from gcs.planning.scene.mesh_simplification import PLANNING_ERROR_M, planning_mesh
from gcs.planning.scene.point_distance import SceneDistance
from gcs.planning.trajectories.safe_corridor import corridor_reach
from gcs.planning.views.viewpoints import stand_off_reach

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from gcs.core.progress import Progress
    from gcs.core.scenario import Scenario
    from gcs.core.structure import Structure

CURVE_ROOM_M = 0.01
"""What the boxes about the path keep besides the clearance: a certificate may be half of it under the truth."""


@dataclass(frozen=True, eq=False)
class Scene:
    """What is flown in, made once for a plan."""

    distance: SceneDistance
    space: FreeSpace


def prepare_scene(scenario: Scenario, structure: Structure, progress: Progress) -> Scene:
    """Distance field and free space about a structure, with room to stand off and to fly over it.

    Large meshes are simplified for it, and the error is kept besides; exact distances are always those of the full one.
    """
    safety = scenario.safety
    planned = planning_mesh(structure, PLANNING_ERROR_M)
    clearance = scenario.centre_clearance_m + planned.error_m + CURVE_ROOM_M
    low, high = planning_volume(scenario, structure, clearance)
    distance = SceneDistance(structure, scenario.ground_m)
    field_ = build_distance_field(planned.structure, low, high, choose_pitch(low, high, clearance), progress)
    own_return = scenario.vehicle.radius_m + safety.position_m + safety.model_m + MARGIN_M
    space = FreeSpace(
        field_,
        clearance,
        scenario.ground_m,
        scenario.home_m,
        fence_volume(scenario.fence, scenario.vehicle, safety),
        progress,
        reach_m=corridor_reach(safety.corridor_half_width_m),
        climb_clearance_m=min(own_return, scenario.centre_clearance_m) + planned.error_m,
        surfaces=distance.surfaces if planned.structure is structure else None,
    )
    return Scene(distance, space)


def planning_volume(
    scenario: Scenario, structure: Structure, clearance_m: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Low and high corner of what is searched: the structure, home, and room around them."""
    bounds = structure.bounds_m
    margin = stand_off_reach(scenario, structure, clearance_m) + clearance_m + 3.0
    low, high = bounds[0] - margin, bounds[1] + margin
    around_home = np.array([2.0, 2.0, 2.0]) + clearance_m
    home = np.asarray(scenario.home_m)
    low, high = np.minimum(low, home - around_home), np.maximum(high, home + around_home)
    if scenario.ground_m is not None:
        low[2] = max(low[2], min(scenario.ground_m, bounds[0, 2], home[2]) - 1.0)
    return low, high
