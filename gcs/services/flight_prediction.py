"""What a vehicle will truly fly of a plan: its mission, flown by the autopilot alone, and the plan as setpoints.

Missions are flown by the autopilot's own waypoint controller, which cuts or overshoots corners and has a clock of its
own. So the path, the time and the clearance of both ways to fly are predicted from the vehicle's settings (or the
autopilot's usual ones), and one of the two is recommended. A mission whose predicted path leaves the clearance is not
uploaded.

The tracking budget of the plan is what a prediction may use up; clearance, position and model errors stay.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from gcs.core.errors import InputError
from gcs.core.flight_law import ArduPilotLaw
from gcs.core.frames import enu_from_geodetic
from gcs.core.mission import Command
from gcs.planning.dynamics.ardupilot_mission import predict_ardupilot_mission
from gcs.planning.dynamics.flown_path import clearance_of_flight, deviation_from_curve
from gcs.planning.dynamics.predicted_flight import MissionRoute, SetpointStream
from gcs.planning.dynamics.px4_mission import predict_px4_mission
from gcs.planning.dynamics.setpoint_following import predict_ardupilot_stream, predict_px4_stream
from gcs.planning.scene.room import HOME_COLUMN_RADIUS_M
from gcs.services.home_column import column_times, streamed_times

if TYPE_CHECKING:
    from gcs.core.flight_law import Airframe, FlightLaw
    from gcs.core.mission import Mission
    from gcs.core.plan import Plan
    from gcs.core.vehicle import Autopilot
    from gcs.planning.dynamics.predicted_flight import PredictedFlight
    from gcs.planning.scene.point_distance import SceneDistance
    from gcs.services.vehicle_model import VehicleModel

STREAM_HZ = 20.0
_CURVE_STEP_S = 0.02
_STOP_S = 0.1
_SLOW_LANDING_M = 10.0
_SLOWEST_LANDING_M = 5.0
_PATIENCE = 1.5
"""A mission is preferred to setpoints, which need the station and its link all along, until it moves so much longer."""


@dataclass(frozen=True)
class Forecast:
    """How one way to fly a plan is predicted to go.

    Attributes:
        time_s: from take-off to the ground; of setpoints without what they wait for pictures.
        waits_s: how much of it the mission stands still for pictures.
        mean_deviation_m: from the plan's curve.
        max_deviation_m: likewise.
        min_clearance_m: hull to the nearest surface, cable or the ground.
        place_m: where that is, scene ENU.
        at_s: when.
        finished: whether the flight comes to its end.
    """

    time_s: float
    waits_s: float
    mean_deviation_m: float
    max_deviation_m: float
    min_clearance_m: float
    place_m: tuple[float, float, float]
    at_s: float
    finished: bool

    def keeps(self, needed_m: float) -> bool:
        """Whether it is flown to its end and nothing comes nearer than that."""
        return self.finished and self.min_clearance_m >= needed_m

    def problem(self, needed_m: float) -> str:
        """Why it does not keep the clearance, with the place and by how much."""
        if self.min_clearance_m < needed_m:
            x, y, z = self.place_m
            return (
                f"it comes {needed_m - self.min_clearance_m:.2f} m too near at ({x:.1f}, {y:.1f}, {z:.1f}) m after "
                f"{self.at_s:.0f} s: {self.min_clearance_m:.2f} m of {needed_m:.2f} m are left"
            )
        return "the autopilot does not come to its end: it circles about a waypoint that it misses"


@dataclass(frozen=True)
class FlightPrediction:
    """Both ways to fly a plan on one kind of autopilot.

    Attributes:
        autopilot: whose way of flying it is.
        mission: flown by the autopilot alone.
        offboard: as setpoints from the station.
        mission_items: how many items the mission has.
        needed_clearance_m: what either must keep.
        choice: `mission` or `offboard`.
        why: the choice in a sentence.
        basis: what of the vehicle is known for it, and what is only usual.
    """

    autopilot: Autopilot
    mission: Forecast
    offboard: Forecast
    mission_items: int
    needed_clearance_m: float
    choice: str
    why: str
    basis: str

    def as_json(self) -> dict[str, Any]:
        """As `report.json` has it."""
        return asdict(self) | {"autopilot": self.autopilot.value}

    @property
    def line(self) -> str:
        """In a line for people."""
        return f"{self.autopilot.value}: {self.why} ({self.basis})"


def predict_flights(plan: Plan, scene: SceneDistance, mission: Mission, model: VehicleModel) -> FlightPrediction:
    """Predict both ways to fly a plan.

    Args:
        plan: one flight, not several sorties.
        scene: exact distance to what stands in the scene.
        mission: as it is uploaded to this vehicle.
        model: of the vehicle.
    """
    law, airframe = model.law, model.airframe
    route = mission_route(plan, mission, home_is_first=isinstance(law, ArduPilotLaw))
    flown = predict_mission(route, law, airframe)
    landing = _landing_s(float(flown.position_m[-1, 2] - plan.scenario.home_m[2]), law)
    forecasts = (
        _forecast(
            flown, plan, scene, (0.0, plan.trajectory.duration_s), after_s=landing, waits_s=float(route.hold_s.sum())
        ),
        _offboard_forecast(plan, scene, model),
    )
    needed = needed_clearance_m(plan)
    choice, why = _choose(*forecasts, needed, plan.scenario.safety.tracking_m)
    return FlightPrediction(model.autopilot, *forecasts, len(mission.items), needed, choice, why, model.basis)


def needed_clearance_m(plan: Plan) -> float:
    """What a predicted flight must keep between hull and scene: all of the budget but the tracking error."""
    safety = plan.scenario.safety
    return safety.clearance_m + safety.position_m + safety.model_m


def predict_mission(route: MissionRoute, law: FlightLaw, airframe: Airframe) -> PredictedFlight:
    """The path of a mission from its take-off to above its landing place."""
    if isinstance(law, ArduPilotLaw):
        return predict_ardupilot_mission(route, law, airframe)
    return predict_px4_mission(route, law, airframe)


def predict_offboard(plan: Plan, model: VehicleModel) -> PredictedFlight:
    """The path of the plan's curve as setpoints, between the columns over home.

    The station asks for an acceleration against the drag in advance, where the autopilot takes it.
    """
    law, airframe = model.law, model.airframe
    times, plan_s, rates = streamed_times(plan, 1 / STREAM_HZ)
    position, velocity, acceleration = (plan.trajectory.value(plan_s, k) for k in range(3))
    rate, change = rates[:, None], np.gradient(rates, times)[:, None]
    acceleration, velocity = acceleration * rate**2 + velocity * change, velocity * rate
    if isinstance(law, ArduPilotLaw):
        return predict_ardupilot_stream(SetpointStream(times, position, velocity, acceleration), law, airframe)
    acceleration = acceleration + model.fed_drag_1_s * velocity * np.array([1.0, 1.0, 0.0])
    return predict_px4_stream(SetpointStream(times, position, velocity, acceleration), law, airframe)


def mission_route(plan: Plan, mission: Mission, *, home_is_first: bool) -> MissionRoute:
    """A mission's items as places in the scene, from home on the ground to above the landing place.

    Args:
        plan: whose anchor and home count.
        mission: its items.
        home_is_first: item 0 is home, as ArduPilot has it.

    Raises:
        InputError: there is no place in it.
    """
    places, radii, holds = [np.asarray(plan.scenario.home_m, dtype=np.float64)], [0.0], [0.0]
    speeds: dict[int, float] = {}
    for item in mission.items[1:] if home_is_first else mission.items:
        if item.command == Command.DO_CHANGE_SPEED:
            speeds.setdefault(round(item.params[0]), item.params[1])
        elif item.command == Command.NAV_DELAY:
            holds[-1] += item.params[0]
        elif item.command in {Command.NAV_TAKEOFF, Command.NAV_WAYPOINT, Command.NAV_LAND}:
            place = enu_from_geodetic(item.x / 1e7, item.y / 1e7, item.z, plan.scenario.anchor.point)
            if item.command == Command.NAV_LAND:
                # Level to above it, then down; both autopilots stop before.
                place = np.array([place[0], place[1], places[-1][2]])
            waypoint = item.command == Command.NAV_WAYPOINT
            places.append(place)
            radii.append(item.params[1] if waypoint else 0.0)
            holds.append(item.params[0] if waypoint else _STOP_S)
    if len(places) < 2:
        raise InputError("the mission names no place", field="mission")
    return MissionRoute(np.array(places), np.array(radii), np.array(holds), speeds.get(1), speeds.get(2), speeds.get(3))


def _offboard_forecast(plan: Plan, scene: SceneDistance, model: VehicleModel) -> Forecast:
    """Take-off and landing in the columns are the autopilot's own; they take what the plan gives them."""
    leave, enter = column_times(plan)
    after = plan.trajectory.duration_s - enter
    return _forecast(predict_offboard(plan, model), plan, scene, (leave, enter), before_s=leave, after_s=after)


def _forecast(
    flight: PredictedFlight,
    plan: Plan,
    scene: SceneDistance,
    part_s: tuple[float, float],
    *,
    before_s: float = 0.0,
    after_s: float = 0.0,
    waits_s: float = 0.0,
) -> Forecast:
    """Figures of a flight along a part of a plan's curve, with what comes before and after it."""
    first, last = part_s
    samples = np.linspace(first, last, math.ceil((last - first) / _CURVE_STEP_S) + 2)
    apart = deviation_from_curve(flight, plan.trajectory.value(samples))
    scenario = plan.scenario
    nearest = clearance_of_flight(flight, scene, scenario.vehicle.radius_m, scenario.home_m, HOME_COLUMN_RADIUS_M)
    return Forecast(
        time_s=before_s + flight.duration_s + after_s,
        waits_s=waits_s,
        mean_deviation_m=apart.mean_m,
        max_deviation_m=apart.max_m,
        min_clearance_m=nearest.hull_m,
        place_m=nearest.place_m,
        at_s=before_s + nearest.at_s,
        finished=flight.finished,
    )


def _landing_s(height_m: float, law: FlightLaw) -> float:
    """How long the descent takes from a height above home."""
    quick, slow = law.descent_m_s, law.landing_speed_m_s
    high = max(height_m - _SLOW_LANDING_M, 0.0) / quick
    if isinstance(law, ArduPilotLaw):
        return high + min(height_m, _SLOW_LANDING_M) / slow
    # PX4 goes from one speed to the other between 10 m and 5 m.
    middle = min(max(height_m - _SLOWEST_LANDING_M, 0.0), _SLOW_LANDING_M - _SLOWEST_LANDING_M)
    return high + middle * 2.0 / (quick + slow) + min(height_m, _SLOWEST_LANDING_M) / slow


def _choose(mission: Forecast, offboard: Forecast, needed_m: float, tracking_m: float) -> tuple[str, str]:
    """Which of both, and why, in a sentence."""
    both = (
        f"mission {mission.time_s:.0f} s ({mission.waits_s:.0f} s of it at rest for pictures), at most "
        f"{mission.max_deviation_m:.2f} m from the plan's curve; setpoints {offboard.time_s:.0f} s and "
        f"{offboard.max_deviation_m:.2f} m"
    )
    if not mission.keeps(needed_m):
        if offboard.keeps(needed_m):
            return "offboard", f"fly it offboard: as a mission {mission.problem(needed_m)}"
        return "offboard", (
            f"neither way keeps the clearance: as a mission {mission.problem(needed_m)}; as setpoints "
            f"{offboard.problem(needed_m)}"
        )
    if not offboard.keeps(needed_m):
        return "mission", f"fly it as a mission: as setpoints {offboard.problem(needed_m)}"
    follows = offboard.max_deviation_m <= max(tracking_m, mission.max_deviation_m)
    # A stream waits for its pictures too, and nobody knows how long.
    if follows and mission.time_s - mission.waits_s > _PATIENCE * offboard.time_s:
        return "offboard", f"fly it offboard, which keeps the clearance too and is much quicker ({both})"
    return "mission", f"fly it as a mission, which keeps the clearance and needs no stream ({both})"
