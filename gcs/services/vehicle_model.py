"""A vehicle as a prediction takes it: its settings and its airframe, as far as they are known of it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from gcs.core.flight_law import Airframe, ArduPilotLaw, Px4Law
from gcs.core.learned_dynamics import NOTHING_LEARNED
from gcs.core.vehicle import Autopilot
from gcs.planning.dynamics.feed_forward import carried_over, usable

if TYPE_CHECKING:
    from gcs.core.flight_law import FlightLaw
    from gcs.core.learned_dynamics import LearnedDynamics
    from gcs.core.vehicle import VehicleLimits

USUAL_LAWS: dict[Autopilot, FlightLaw] = {Autopilot.PX4: Px4Law(), Autopilot.ARDUPILOT: ArduPilotLaw()}
"""Settings as delivered, for vehicles whose parameters are not known."""

_TILT_LAGS_S = (0.05, 0.15)
"""Bounds of each of the two lags of an airframe."""


@dataclass(frozen=True)
class VehicleModel:
    """What a flight is predicted with.

    Attributes:
        autopilot: whose way of flying it is.
        law: its settings.
        airframe: its drag and lag.
        fed_drag_1_s: drag that the station's setpoints ask for in advance, where the autopilot takes it.
        basis: in words, what of this is known of the vehicle and what is only usual.
    """

    autopilot: Autopilot
    law: FlightLaw
    airframe: Airframe
    fed_drag_1_s: float
    basis: str


def vehicle_model(
    autopilot: Autopilot, limits: VehicleLimits | None = None, learned: LearnedDynamics = NOTHING_LEARNED
) -> VehicleModel | None:
    """What is known of a vehicle, and the usual where nothing is.

    A vehicle that has shown no drag yet is taken to find out soon, so that all of the usual drag counts as fed forward;
    of a drag that it has shown, what its next stream starts with.

    Args:
        autopilot: of the vehicle.
        limits: as read from it; None when no vehicle was asked.
        learned: what its flights have shown.

    Returns:
        None for autopilots whose way of flying is not known.
    """
    told = None if limits is None else limits.flight_law
    law = told or USUAL_LAWS.get(autopilot)
    if law is None:
        return None
    airframe = airframe_of(learned)
    fed = airframe.drag_1_s if learned.drag is None else usable(carried_over(learned)).drag_s
    basis = f"{_settings(limits)}; {_airframe_words(airframe, learned)}"
    return VehicleModel(autopilot, law, airframe, fed, basis)


def airframe_of(learned: LearnedDynamics) -> Airframe:
    """Drag and lag as flights have shown them, the usual ones where they have not.

    The tilt follows through both lags of an airframe, so that each is half of what it shows.
    """
    usual = Airframe()
    low, high = _TILT_LAGS_S
    return Airframe(
        drag_1_s=usual.drag_1_s if learned.drag is None else max(learned.drag.value, 0.0),
        tilt_lag_s=usual.tilt_lag_s if learned.tilt_lag is None else min(max(learned.tilt_lag.value / 2, low), high),
    )


def _settings(limits: VehicleLimits | None) -> str:
    if limits is None or limits.flight_law is None:
        return "usual settings"
    if limits.law_defaults:
        return f"the vehicle's own settings, usual ones for {', '.join(limits.law_defaults)}, which it did not tell"
    return "the vehicle's own settings"


def _airframe_words(airframe: Airframe, learned: LearnedDynamics) -> str:
    if learned.drag is None:
        return f"a usual drag of {airframe.drag_1_s:g} m/s² per m/s, as it has shown none yet"
    lean = math.degrees(math.atan(5.0 * airframe.drag_1_s / 9.80665))
    return f"the drag that it showed in flight, {airframe.drag_1_s:.2f} m/s² per m/s ({lean:.0f}° of tilt at 5 m/s)"
