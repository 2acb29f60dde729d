"""What speaks against leading the vehicle: on the ground already, and in the air where the plan goes on."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gcs.core.frames import rigid_between

if TYPE_CHECKING:
    from gcs.services.companion.companion_options import CompanionOptions
    from gcs.services.companion.flyable_plan import FlyablePlan
    from gcs.services.companion.own_vehicle import OwnVehicle
    from gcs.services.companion.senses import Senses

OBJECTION_S = 4.0
"""What speaks against flying may go away within this (a value not heard yet); then an order or a plan is refused."""

NEAR_START_M = 3.0
"""A lease begins only when the vehicle hovers within this of the place where the plan goes on."""

POSITION_SILENT_S = 0.7
NO_SECTORS = "the lidar is silent: OBSTACLE_DISTANCE must be sent, _3D alone is mute in free air"


def blind_lidar(senses: Senses, options: CompanionOptions, now_s: float) -> str | None:
    """Says so when a lidar that is needed gives no good scans, or not all round (`now_s`: the vehicle's clock)."""
    if not options.needs_lidar:
        return None
    age_s = senses.lidar_age_s(now_s)
    if age_s is not None and age_s <= options.lidar_silent_s:
        return senses.covered(now_s)
    return "the lidar is silent" if senses.hears_sectors else NO_SECTORS


def unwell_in_flight(
    vehicle: OwnVehicle, senses: Senses, options: CompanionOptions, now_s: float
) -> dict[str, str | None]:
    """What the vehicle has to hover for, by what it is about; None where all is well."""
    newest = vehicle.poses.newest
    lost = newest is None or now_s - newest.at_s > POSITION_SILENT_S
    return {
        "lidar": blind_lidar(senses, options, now_s),
        "position": "the position is old" if lost else None,
        "odometry": senses.odometry.problem(now_s),
    }


def unfit_senses(senses: Senses, options: CompanionOptions, now_s: float) -> str | None:
    """What is wrong with lidar or odometry; None when nothing is."""
    return blind_lidar(senses, options, now_s) or senses.odometry.problem(now_s)


def away_from_start(flyable: FlyablePlan, vehicle: OwnVehicle, now_s: float, plan_s: float | None) -> str | None:
    """Where the vehicle hovers, if that is not where the plan goes on; None when it is.

    Args:
        flyable: the plan.
        vehicle: that hovers.
        now_s: the vehicle's clock.
        plan_s: how far the plan is flown, in its time; None for one that begins.
    """
    place, origin = vehicle.poses.position(now_s), vehicle.telemetry.origin
    if place is None or origin is None or vehicle.poses.attitude(now_s) is None:
        return "the vehicle does not tell where it is"
    start = flyable.curve.value(flyable.leave_s if plan_s is None else flyable.time_of(plan_s))
    rotation, shift = rigid_between(flyable.plan.scenario.anchor.point, origin.value)
    off_m = float(np.linalg.norm(place - (rotation @ start + shift)))
    near_m = NEAR_START_M if plan_s is None else NEAR_START_M + flyable.swept_m
    return None if off_m <= near_m else f"{off_m:.0f} m away from where the plan goes on"
