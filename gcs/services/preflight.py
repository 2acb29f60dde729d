"""What is compared between plan and vehicle before anything is uploaded or armed (safety rules 3, 5, 7 and 8).

Each check is a pure function of what was read; `PreflightCheck` says how it came out. Unknown is said as unknown and
stands in the way until the operator accepts it by name.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.frames import GeoPoint, enu_from_geodetic, geodetic_from_enu
from gcs.services.flight_types import PreflightCheck

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from gcs.core.plan import Plan
    from gcs.core.vehicle import Failsafe, Telemetry, VehicleLimits
    from gcs.services.flight_prediction import FlightPrediction
    from gcs.services.flight_types import CheckState

MAX_HORIZONTAL_DATUM_M = 1.0
MAX_VERTICAL_DATUM_M = 0.5
MIN_GPS_FIX = 3
FRESH_S = 5.0
"""A value older than this is not used to allow anything."""

SPEED_SLACK = 1.01
"""A plan's extremum may exceed a parameter by this factor, which is rounding."""


def check_link(telemetry: Telemetry, last_heard_s: float, now_s: float) -> PreflightCheck:
    """The vehicle must have been heard within the last seconds."""
    age = now_s - last_heard_s
    if telemetry.armed is None or age > FRESH_S:
        return PreflightCheck("link", "refused", f"the vehicle has not been heard for {age:.0f} s")
    return PreflightCheck("link", "ok", f"heard {age:.1f} s ago")


def check_on_ground(telemetry: Telemetry) -> PreflightCheck:
    """A flight starts with a vehicle that is disarmed."""
    if telemetry.armed is not None and telemetry.armed.value:
        return PreflightCheck("disarmed", "refused", "the vehicle is armed already: land and disarm it first")
    return PreflightCheck("disarmed", "ok", "the vehicle is disarmed")


def check_fix(telemetry: Telemetry) -> PreflightCheck:
    """A position fix in three dimensions."""
    if telemetry.gps_fix is None:
        return PreflightCheck("position fix", "unknown", "the vehicle does not tell its position fix")
    fix = telemetry.gps_fix.value
    satellites = "" if telemetry.satellites is None else f", {telemetry.satellites.value} satellites"
    if fix < MIN_GPS_FIX:
        return PreflightCheck("position fix", "refused", f"no 3D position fix (fix type {fix}{satellites})")
    return PreflightCheck("position fix", "ok", f"fix type {fix}{satellites}")


def check_datum(plan: Plan, telemetry: Telemetry) -> PreflightCheck:
    """Home and origin of the vehicle against home of the scene (safety rule 3).

    Compared are HOME_POSITION, and where the vehicle believes it stands by GPS_GLOBAL_ORIGIN and its local position,
    which is what setpoints refer to; both must be where the scene has its home.
    """
    if telemetry.home is None:
        return PreflightCheck("datum", "refused", "the vehicle does not tell its home, so heights cannot be compared")
    places = {"HOME_POSITION": telemetry.home.value}
    if telemetry.origin is not None and telemetry.local_position_m is not None:
        places["GPS_GLOBAL_ORIGIN"] = _through_origin(telemetry.origin.value, telemetry.local_position_m.value)
    worst, state = [], "ok"
    for name, place in places.items():
        horizontal, vertical = _offsets(plan, place)
        worst.append(f"{name} is {horizontal:.2f} m beside and {vertical:+.2f} m above home of the scene")
        if horizontal > MAX_HORIZONTAL_DATUM_M or abs(vertical) > MAX_VERTICAL_DATUM_M:
            state = "refused"
    detail = "; ".join(worst)
    if state == "refused":
        limits = f"{MAX_HORIZONTAL_DATUM_M} m / {MAX_VERTICAL_DATUM_M} m"
        return PreflightCheck("datum", "refused", f"{detail} (allowed {limits}): check the anchor and its altitude")
    return PreflightCheck("datum", "ok", detail)


def check_limits(plan: Plan, limits: VehicleLimits) -> list[PreflightCheck]:
    """The plan's extrema against the vehicle's own limits (safety rule 5)."""
    trajectory = plan.trajectory
    t = np.linspace(0.0, trajectory.duration_s, max(2, math.ceil(trajectory.duration_s / 0.05)))
    velocity = trajectory.value(t, 1)
    figures = [
        ("horizontal speed", float(np.hypot(velocity[:, 0], velocity[:, 1]).max()), limits.max_speed_m_s, "m/s"),
        ("climb speed", float(velocity[:, 2].max()), limits.max_climb_m_s, "m/s"),
        ("descent speed", float(-velocity[:, 2].min()), limits.max_descent_m_s, "m/s"),
        ("acceleration", plan.certificates.max_acceleration_m_s2, limits.max_acceleration_m_s2, "m/s²"),
    ]
    checks = []
    for name, planned, allowed, unit in figures:
        if allowed is None:
            checks.append(PreflightCheck(name, "unknown", f"planned {planned:.2f} {unit}; the vehicle tells no limit"))
        elif planned > allowed * SPEED_SLACK:
            why = f"planned {planned:.2f} {unit}, the vehicle's limit is {allowed:.2f} {unit}: plan slower"
            checks.append(PreflightCheck(name, "refused", why))
        else:
            checks.append(PreflightCheck(name, "ok", f"planned {planned:.2f} {unit} of {allowed:.2f} {unit}"))
    return checks


def check_prediction(found: FlightPrediction, *, offboard: bool) -> PreflightCheck:
    """How the vehicle is predicted to fly the plan, one way or the other.

    A mission that leaves the clearance is refused: nothing corrects it on the way. Setpoints are corrected by what the
    station learns of the vehicle, so that a prediction against them must be accepted by name.
    """
    name, needed = "predicted flight", found.needed_clearance_m
    way = found.offboard if offboard else found.mission
    figures = (
        f"{way.time_s:.0f} s, at most {way.max_deviation_m:.2f} m from the plan's curve, hull clearance "
        f"{way.min_clearance_m:.2f} m of {needed:.2f} m"
    )
    if way.keeps(needed):
        return PreflightCheck(name, "ok", figures)
    if offboard:
        return PreflightCheck(name, "needs_acceptance", way.problem(needed))
    instead = "fly it with --mode offboard, which keeps it" if found.offboard.keeps(needed) else "plan slower"
    return PreflightCheck(name, "refused", f"as a mission {way.problem(needed)}: {instead}")


def check_failsafes(failsafes: Sequence[Failsafe]) -> list[PreflightCheck]:
    """Each failsafe as the vehicle is set up; one that is off must be accepted by name (safety rule 5)."""
    checks = []
    for f in failsafes:
        value = "not told" if f.value is None else f"{f.name} = {f.value:g}"
        state: CheckState = "ok" if f.active else "unknown" if f.active is None else "needs_acceptance"
        checks.append(PreflightCheck(f.name, state, f"{f.about}: {f.effect} ({value})"))
    return checks


def with_acceptance(checks: Sequence[PreflightCheck], accepted: Sequence[str]) -> tuple[PreflightCheck, ...]:
    """What is unknown or switched off may be accepted by its name; what is refused may not."""
    return tuple(
        replace(c, accept=c.name, state="accepted" if c.name in accepted else c.state)
        if c.state in {"unknown", "needs_acceptance"}
        else c
        for c in checks
    )


def check_energy(plan: Plan, telemetry: Telemetry) -> PreflightCheck:
    """What is left in the battery against what the plan needs (safety rule 8)."""
    needed = plan.certificates.energy_wh
    battery = plan.scenario.vehicle.battery
    left = None if telemetry.battery is None else telemetry.battery.value.remaining
    if battery is None:
        told = "not told" if left is None else f"{left:.0%}"
        return PreflightCheck(
            "battery", "ok", f"{told} left; the scenario names no battery to compare {needed:.0f} Wh with"
        )
    share = needed / battery.capacity_wh + battery.reserve
    if left is None:
        return PreflightCheck("battery", "refused", f"the vehicle does not tell its battery; {share:.0%} is needed")
    if left < share:
        why = f"{left:.0%} left, {share:.0%} is needed ({needed:.0f} Wh and the reserve): charge it"
        return PreflightCheck("battery", "refused", why)
    return PreflightCheck("battery", "ok", f"{left:.0%} left of {share:.0%} needed ({needed:.0f} Wh and the reserve)")


def _offsets(plan: Plan, place: GeoPoint) -> tuple[float, float]:
    anchor = plan.scenario.anchor.point
    there = enu_from_geodetic(place.latitude_deg, place.longitude_deg, place.altitude_m, anchor)
    off = there - np.asarray(plan.scenario.home_m)
    return float(np.hypot(off[0], off[1])), float(off[2])


def _through_origin(origin: GeoPoint, local_enu_m: NDArray[np.float64]) -> GeoPoint:
    latitude, longitude, altitude = geodetic_from_enu(local_enu_m, origin)
    return GeoPoint(float(latitude), float(longitude), float(altitude))
