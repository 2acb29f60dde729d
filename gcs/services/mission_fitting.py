"""A plan's mission, sampled so that its predicted flight keeps the clearance and the vehicle has room for its items.

The usual sampling comes first. Where its predicted flight comes too near, finer chords and then slower speeds are
predicted; where the vehicle stores fewer items, coarser chords, which the prediction must allow as well. A vehicle
tells how much it stores only by refusing, or not at all.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from gcs.core.errors import RefusedError
from gcs.mavlink.mission_items import MissionLimits
from gcs.planning.trajectories.mission_sampling import CHORD_ERROR_M
from gcs.services.flight_prediction import predict_flights
from gcs.services.mission_files import mission_of_plan
from gcs.services.vehicle_model import USUAL_LAWS, vehicle_model

if TYPE_CHECKING:
    from gcs.core.mission import Mission
    from gcs.core.plan import Plan
    from gcs.core.vehicle import Autopilot
    from gcs.planning.scene.point_distance import SceneDistance
    from gcs.services.flight_prediction import FlightPrediction
    from gcs.services.vehicle_model import VehicleModel
    from gcs.storage.records import FlightRecord

_SAMPLINGS = (
    (CHORD_ERROR_M, 1.0),
    (0.15, 1.0),
    (0.08, 1.0),
    (0.15, 0.6),
    (0.08, 0.4),
    (0.6, 1.0),
    (1.2, 1.0),
    (2.4, 1.0),
    (0.6, 0.5),
)
"""Chord errors (m) and shares of the plan's speed, in the order in which they are tried."""


@dataclass(frozen=True)
class MissionSampling:
    """How a plan's curve becomes a mission.

    Attributes:
        chord_error_m: how far the curve may lie from the straight legs.
        speed_m_s: that the mission commands; the plan's own when None.
        climb_m_s: no more than that upwards, where the mission commands it (ArduPilot).
        descent_m_s: likewise downwards.
    """

    chord_error_m: float = CHORD_ERROR_M
    speed_m_s: float | None = None
    climb_m_s: float | None = None
    descent_m_s: float | None = None

    @property
    def words(self) -> str:
        """For people."""
        slower = "" if self.speed_m_s is None else f", flown at {self.speed_m_s:.1f} m/s"
        return f"chord error {self.chord_error_m:g} m{slower}"


USUAL_SAMPLING = MissionSampling()


@dataclass(frozen=True, eq=False)
class FittedMission:
    """A mission and what is predicted of it.

    Attributes:
        mission: the items.
        sampling: how they were chosen.
        prediction: None for autopilots whose way of flying is not known.
        tried: how many samplings were predicted.
    """

    mission: Mission
    sampling: MissionSampling
    prediction: FlightPrediction | None
    tried: int = 1


def sampled_mission(plan: Plan, autopilot: Autopilot, sampling: MissionSampling) -> Mission:
    """A plan's mission with one sampling; errors as of `mission_of_plan`."""
    limits = MissionLimits(sampling.speed_m_s, sampling.climb_m_s, sampling.descent_m_s)
    return mission_of_plan(plan, autopilot, limits, sampling.chord_error_m)


def sampling_of(flight: FlightRecord) -> MissionSampling | None:
    """The sampling that was chosen for a flight at its upload; None before that."""
    return None if flight.mission_sampling is None else MissionSampling(**flight.mission_sampling)


def predicted_mission(
    plan: Plan, scene: SceneDistance, autopilot: Autopilot, model: VehicleModel | None, sampling: MissionSampling
) -> FittedMission:
    """A plan's mission with one sampling, and what is predicted of it."""
    mission = sampled_mission(plan, autopilot, sampling)
    prediction = None if model is None else predict_flights(plan, scene, mission, model)
    return FittedMission(mission, sampling, prediction)


def fit_mission(
    plan: Plan,
    scene: SceneDistance,
    autopilot: Autopilot,
    model: VehicleModel | None,
    most_items: int | None = None,
) -> FittedMission:
    """The first sampling that the vehicle has room for and whose predicted flight keeps the clearance.

    Args:
        plan: one flight, not several sorties.
        scene: exact distance to what stands in the scene.
        autopilot: whose words to use.
        model: of the vehicle; None when it cannot be predicted.
        most_items: more than that the vehicle does not store; None when it has not refused any.

    Returns:
        The first one that it has room for, when none keeps the clearance.

    Raises:
        RefusedError: it has no room for any; says for how many, and how the plan can be split.
    """
    speed_m_s = plan.scenario.vehicle.max_speed_m_s
    # A speed item takes the place of the vehicle's own limit, so that it must not exceed it.
    vertical = (None, None) if model is None else (model.law.climb_m_s, model.law.descent_m_s)
    first: FittedMission | None = None
    tried, fewest = 0, math.inf
    for chord_error_m, share in _SAMPLINGS:
        if most_items is None and chord_error_m > CHORD_ERROR_M:
            continue
        sampling = MissionSampling(chord_error_m, None if share == 1.0 else share * speed_m_s, *vertical)
        mission = sampled_mission(plan, autopilot, sampling)
        fewest = min(fewest, len(mission.items))
        if most_items is not None and len(mission.items) > most_items:
            continue
        prediction = None if model is None else predict_flights(plan, scene, mission, model)
        tried += 1
        found = FittedMission(mission, sampling, prediction, tried)
        if prediction is None or prediction.mission.keeps(prediction.needed_clearance_m):
            return found
        first = first or found
    if first is None:
        room, flights = most_items or 0, math.ceil(fewest / max(most_items or 1, 1))
        raise RefusedError(
            f"the mission has {fewest:.0f} items at least, for {len(plan.viewpoints)} viewpoints, and the vehicle "
            f"stores no more than {room}: split the points or regions over {flights} plans or more, or fly it with "
            "--mode offboard",
            field="mission",
        )
    return replace(first, tried=tried)


def predict_usual_flights(plan: Plan, scene: SceneDistance) -> list[FlightPrediction]:
    """Both ways to fly a plan on vehicles with their autopilot's usual settings; none for a plan of several sorties."""
    if plan.sorties:
        return []
    missions = (predicted_mission(plan, scene, kind, vehicle_model(kind), USUAL_SAMPLING) for kind in USUAL_LAWS)
    return [found.prediction for found in missions if found.prediction is not None]
