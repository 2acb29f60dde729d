"""Where flights take off and land: home, a rally point, or the pad of one of several vehicles."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.errors import InputError
from gcs.planning.flights.flight_scene import prepare_scene
from gcs.planning.tours.tour import find_tour
from gcs.planning.trajectories.time_allocation import FlightLimits
from gcs.planning.trajectories.trajectory_builder import estimated_leg_time_s

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike, NDArray

    from gcs.core.progress import Progress
    from gcs.core.scenario import Scenario, VehicleSpec
    from gcs.core.structure import Structure
    from gcs.planning.flights.flight_scene import Scene
    from gcs.planning.tours.tour import LegTime, Tour
    from gcs.planning.views.viewpoint_pose import ViewpointPose


AT_HOME_M = 1.0
"""A rally point that is this near to home is no other place to fly from."""


@dataclass(frozen=True, eq=False)
class FlightBase:
    """A place where flights take off and land.

    Attributes:
        scenario: of one vehicle, with its home there.
        scene: what is connected with that home.
        rally: which of the scenario's rally points it is, from 1; None for home and for pads.
    """

    scenario: Scenario
    scene: Scene
    rally: int | None = None


def base_at(
    place_m: ArrayLike, scenario: Scenario, structure: Structure, progress: Progress, rally: int | None = None
) -> FlightBase:
    """Prepare a place for flights.

    Args:
        place_m: on the ground, shape (3,).
        scenario: what is asked, with another home.
        structure: the placed structure.
        progress: told about the stages of the scene; may cancel.
        rally: which rally point it is, from 1.

    Raises:
        InputError: nothing can take off there.
    """
    x, y, z = np.asarray(place_m, dtype=np.float64).tolist()
    vehicle = scenario.vehicle.model_copy(update={"count": 1, "pads_m": ()})
    one = scenario.model_copy(update={"vehicle": vehicle, "home_m": (x, y, z)})
    return FlightBase(one, prepare_scene(one, structure, progress), rally)


def rally_bases(
    scenario: Scenario, structure: Structure, stops_m: NDArray[np.float64], progress: Progress
) -> list[FlightBase]:
    """The rally points, other than home, from which a vehicle can take off and reach all stops.

    Args:
        scenario: with rally points that passed `check_rally_points`.
        structure: the placed structure.
        stops_m: shape (N, 3).
        progress: told about the stages of the scenes; may cancel.
    """
    bases = []
    for number, place in enumerate(scenario.rally_m, start=1):
        if math.dist(place, scenario.home_m) <= AT_HOME_M:
            continue
        try:
            base = base_at(place, scenario, structure, progress, number)
        except InputError:
            continue  # nearer to something than a flight begins, or under a roof: good to come down at only
        if base.scene.space.is_reachable(stops_m).all():
            bases.append(base)
    return bases


def leg_time_of(vehicle: VehicleSpec) -> LegTime:
    """Estimated time of a vehicle's legs from rest to rest."""
    limits = FlightLimits(vehicle.max_speed_m_s, vehicle.max_acceleration_m_s2, vehicle.max_jerk_m_s3)
    return lambda lengths: estimated_leg_time_s(lengths, limits)


def tour_from(base: FlightBase, run: Sequence[int], poses: Sequence[ViewpointPose], progress: Progress) -> Tour:
    """The tour from a base through some of the poses and back; its `order` numbers all of them.

    Raises:
        InfeasibleError: a pose cannot be reached; it is named.
    """
    scenario = base.scenario
    tour = find_tour(
        base.scene.space,
        scenario.home_m,
        np.array([poses[k].position_m for k in run]).reshape(-1, 3),
        scenario.planner,
        leg_time_of(scenario.vehicle),
        progress,
        names=[poses[k].name for k in run],
    )
    return replace(tour, order=np.array([run[int(k)] for k in tour.order], dtype=np.int64))
