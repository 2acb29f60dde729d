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
from gcs.core.learned_dynamics import NOTHING_LEARNED
from gcs.planning.dynamics.quadrotor import GRAVITY_M_S2
from gcs.services.flight_types import PreflightCheck
from gcs.services.vehicle_model import airframe_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from gcs.core.learned_dynamics import LearnedDynamics
    from gcs.core.plan import Plan
    from gcs.core.vehicle import Failsafe, Telemetry, VehicleLimits
    from gcs.mavlink.camera_description import CameraDescription
    from gcs.services.flight_types import CheckState
    from gcs.services.mission_fitting import FittedMission

MAX_HORIZONTAL_DATUM_M = 1.0
MAX_VERTICAL_DATUM_M = 0.5
MIN_GPS_FIX = 3
FRESH_S = 5.0
"""A value older than this is not used to allow anything."""

MIN_FREE_MIB = 100.0
"""With less room than this on the camera's storage a flight asks first."""

SPEED_SLACK = 1.01
"""A plan's extremum may exceed a parameter by this factor, which is rounding."""

TILT_RESERVE_RAD = math.radians(5.0)
"""Of the vehicle's limit of the tilt this much is left to gusts and to the correction of errors."""

_SAMPLE_S = 0.05


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


def check_limits(plan: Plan, limits: VehicleLimits, learned: LearnedDynamics = NOTHING_LEARNED) -> list[PreflightCheck]:
    """The plan's extrema against the vehicle's own limits (safety rule 5).

    Args:
        plan: what is to be flown.
        limits: as read from the vehicle.
        learned: what its flights have shown of its drag, against which it leans too.
    """
    trajectory = plan.trajectory
    t = _times(plan)
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
    return [*checks, _check_tilt(plan, limits.max_tilt_rad, learned)]


def planned_tilt_rad(plan: Plan, drag_1_s: float) -> float:
    """How far a vehicle leans at most to fly a plan in still air: against its inertia, and against its drag.

    Args:
        plan: what is to be flown.
        drag_1_s: drag over mass, per speed.
    """
    t = _times(plan)
    velocity, acceleration = (plan.trajectory.value(t, k) for k in (1, 2))
    force = acceleration + drag_1_s * velocity
    return float(np.arctan2(np.hypot(force[:, 0], force[:, 1]), GRAVITY_M_S2 + force[:, 2]).max())


def _check_tilt(plan: Plan, allowed_rad: float | None, learned: LearnedDynamics) -> PreflightCheck:
    """What it cannot lean it cannot accelerate: it then flies wide of every bend.

    A plan is refused for a drag that the vehicle has shown; for a usual one that it may not have, it must be accepted.
    """
    drag_1_s = airframe_of(learned).drag_1_s
    name, planned_rad = "tilt", planned_tilt_rad(plan, drag_1_s)
    whose = "a usual drag" if learned.drag is None else "its drag"
    planned = f"planned {math.degrees(planned_rad):.0f}° with {whose} of {drag_1_s:.2f} m/s² per m/s"
    if allowed_rad is None:
        return PreflightCheck(name, "unknown", f"{planned}; the vehicle tells no limit")
    limit = f"{math.degrees(allowed_rad):.0f}°"
    within_rad = allowed_rad - TILT_RESERVE_RAD
    if planned_rad > within_rad:
        reserve = f"{math.degrees(TILT_RESERVE_RAD):.0f}°"
        why = f"{planned}, the vehicle's limit is {limit}, of which {reserve} are left for gusts: plan slower"
        certain = learned.drag is not None or planned_tilt_rad(plan, 0.0) > within_rad
        return PreflightCheck(name, "refused" if certain else "needs_acceptance", why)
    return PreflightCheck(name, "ok", f"{planned}, of {limit}")


def _times(plan: Plan) -> NDArray[np.float64]:
    duration = plan.trajectory.duration_s
    return np.linspace(0.0, duration, max(2, math.ceil(duration / _SAMPLE_S)))


def check_prediction(fitted: FittedMission, *, offboard: bool) -> list[PreflightCheck]:
    """How the vehicle is predicted to fly the plan, one way or the other; nothing where that is not known.

    A mission that leaves the clearance is refused: nothing corrects it on the way. Setpoints are corrected by what the
    station learns of the vehicle, so that a prediction against them must be accepted by name.
    """
    found, name = fitted.prediction, "predicted flight"
    if found is None:
        return []
    needed = found.needed_clearance_m
    way = found.offboard if offboard else found.mission
    figures = (
        f"{way.time_s:.0f} s, at most {way.max_deviation_m:.2f} m from the plan's curve, hull clearance "
        f"{way.min_clearance_m:.2f} m of {needed:.2f} m"
    )
    if not offboard:
        figures += f", {found.mission_items} items, {fitted.sampling.words}"
    if way.keeps(needed):
        return [PreflightCheck(name, "ok", f"{figures} (with {found.basis})")]
    if offboard:
        return [PreflightCheck(name, "needs_acceptance", way.problem(needed))]
    also = f", nor with any of {fitted.tried - 1} finer or slower samplings" if fitted.tried > 1 else ""
    instead = "fly it with --mode offboard, which keeps it" if found.offboard.keeps(needed) else "plan slower"
    return [PreflightCheck(name, "refused", f"as a mission {way.problem(needed)}{also}: {instead}")]


def check_camera(component: int | None, camera: CameraDescription) -> PreflightCheck:
    """Whether the camera, if it speaks MAVLink, can take and keep pictures now."""
    if component is None:
        return PreflightCheck("camera", "ok", "no camera component was heard: its pictures have to come on a card")
    problems = []
    if camera.takes_images is False:
        problems.append("it says that it takes no images")
    if camera.in_image_mode is False:
        problems.append("it is in video mode")
    if camera.storage_ready is False:
        problems.append("its storage is empty or not formatted")
    if camera.free_mib is not None and camera.free_mib < MIN_FREE_MIB:
        problems.append(f"its storage is full ({camera.free_mib:.0f} MiB free)")
    if problems:
        return PreflightCheck("camera", "needs_acceptance", f"{camera.words()}: {', '.join(problems)}")
    return PreflightCheck("camera", "ok", camera.words())


def check_failsafes(failsafes: Sequence[Failsafe]) -> list[PreflightCheck]:
    """Each failsafe as the vehicle is set up; one that is off must be accepted by name, or set (safety rule 5)."""
    checks = []
    for f in failsafes:
        value = "not told" if f.value is None else f"{f.name} = {f.value:g}"
        state: CheckState = "ok" if f.active else "unknown" if f.active is None else "needs_acceptance"
        how = "" if f.active is not False else _way_to_set(f)
        checks.append(PreflightCheck(f.name, state, f"{f.about}: {f.effect} ({value}){how}"))
    return checks


def _way_to_set(failsafe: Failsafe) -> str:
    """How a failsafe that is off can be switched on by the station, in words."""
    settings = [setting for setting in failsafe.settings.values() if setting.startswith(f"{failsafe.name} ")]
    return f"; to have it set, accept {settings[0].replace(' ', '=')}" if settings else ""


def with_acceptance(checks: Sequence[PreflightCheck], accepted: Sequence[str]) -> tuple[PreflightCheck, ...]:
    """What is unknown or switched off may be accepted by its name; what is refused may not."""
    return tuple(
        replace(c, accept=c.name, state="accepted" if c.name in accepted else c.state)
        if c.state in {"unknown", "needs_acceptance"}
        else c
        for c in checks
    )


def check_energy(plan: Plan, telemetry: Telemetry, predicted_s: float | None = None) -> PreflightCheck:
    """What is left in the battery against what the flight needs (safety rule 8).

    Args:
        plan: what is flown.
        telemetry: of the vehicle.
        predicted_s: how long the vehicle is predicted to take; a flight that is longer than the plan's curve needs more
            in proportion, as a multirotor takes about the same power whatever it does.
    """
    needed = plan.certificates.energy_wh
    if predicted_s is not None:
        needed *= max(1.0, predicted_s / plan.trajectory.duration_s)
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
