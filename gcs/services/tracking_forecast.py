"""How closely a rigid body of the vehicle's mass could fly a plan in light gusts, for its report and before take-off.

An autopilot's own controllers are what `flight_prediction` is about; this is the best that may be hoped for, and what
it takes of the motors.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from gcs.planning.dynamics.tracking_prediction import track_curve, usual_quadrotor
from gcs.planning.dynamics.wind_gusts import WindGusts

if TYPE_CHECKING:
    from gcs.core.plan import Plan
    from gcs.planning.dynamics.tracking_prediction import TrackingHistory, TrackingPrediction

GUSTS = WindGusts(deviation_m_s=1.0)


@dataclass(frozen=True, eq=False)
class TrackingForecast:
    """A predicted flight of a usual quadrotor.

    Attributes:
        history: errors and motor thrusts over time.
        figures: of the whole flight.
        mass_kg: of the vehicle.
        most_thrust_n: what one motor can give.
    """

    history: TrackingHistory
    figures: TrackingPrediction
    mass_kg: float
    most_thrust_n: float

    def as_json(self) -> dict[str, Any]:
        """As `report.json` has it."""
        own = {"mass_kg": self.mass_kg, "gusts_m_s": GUSTS.deviation_m_s, "most_thrust_n": self.most_thrust_n}
        return asdict(self.figures) | own


def forecast_tracking(plan: Plan) -> TrackingForecast:
    """Fly a plan's curve with its yaw; the gusts are seeded by the scenario."""
    body = usual_quadrotor(plan.scenario.vehicle.mass_kg)
    seed = plan.scenario.planner.seed
    history = track_curve(plan.trajectory, plan.yaw, parameters=body, gusts=GUSTS, seed=seed)
    return TrackingForecast(history, history.figures, body.mass_kg, body.max_motor_thrust_n)
