"""Which checks stand before which command, and the proofs that need the scene (safety rules 3 to 8)."""

from __future__ import annotations

import asyncio
import time
from contextlib import suppress
from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.clock import utc_now
from gcs.core.errors import GcsError, InfeasibleError, LinkError, RefusedError
from gcs.mavlink.mission_protocol import MissionType
from gcs.planning.flights.retrace import memory_settings, retrace_problem
from gcs.planning.flights.ways_home import check_ways_home, return_is_clear
from gcs.planning.scene.point_distance import SceneDistance
from gcs.planning.trajectories.stream_loss import slow_for_stream_loss
from gcs.services import preflight
from gcs.services.failsafe_checks import OwnWaysOfVehicle, check_failsafes_along
from gcs.services.failsafe_settings import set_failsafes
from gcs.services.fence_rally import check_lists
from gcs.services.flight_types import PreflightCheck, PreflightReport
from gcs.services.image_account import scene_position
from gcs.services.mission_fitting import fit_mission, predicted_mission, sampling_of
from gcs.services.vehicle_model import vehicle_model
from gcs.storage.plan_files import read_structure
from gcs.storage.records import FlightPath

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from numpy.typing import NDArray

    from gcs.core.fields import Point3
    from gcs.core.learned_dynamics import LearnedDynamics
    from gcs.core.plan import Plan
    from gcs.core.vehicle import Failsafe, VehicleLimits
    from gcs.core.way_home import ReturnFlight
    from gcs.mavlink.vehicle import Vehicle
    from gcs.planning.flights.ways_home import Intervals, WaysHome
    from gcs.planning.trajectories.retiming import TimeWarp
    from gcs.services.mission_fitting import FittedMission
    from gcs.storage.records import FlightRecord

DEFAULT_OFFBOARD_TIMEOUT_S = 3.0
"""Taken for a vehicle that does not tell how long it flies on without setpoints: the longest that was measured."""

TOLD_WITHIN_S = 3.0
"""So long a vehicle is given to tell its battery and its position fix, before either counts as not told."""

BRAKING_SHARE = 0.8
"""Share of the plan's acceleration limit that braking after a lost stream is counted with."""


class CheckedReport(PreflightReport):
    """A report that can be demanded to be clean."""

    def demand(self) -> None:
        """Refuse to go on unless every check is ok or accepted.

        Raises:
            RefusedError: naming what stands in the way, and how what can be accepted is accepted.
        """
        bad = [c for c in self.checks if c.state not in {"ok", "accepted"}]
        if not bad:
            return
        refused = [f"{c.name}: {c.detail}" for c in bad if c.state == "refused"]
        open_ones = [f"{c.name} ({c.detail})" for c in bad if c.state != "refused"]
        asked = [f"must be accepted by name: {', '.join(open_ones)}"] if open_ones else []
        raise RefusedError("; ".join([*refused, *asked]), field="preflight")


class FlightChecks:
    """The checks of one flight.

    Args:
        flight: which flight.
        plan: what is flown.
        directory: the plan's folder, for its structure.
        learned: what the vehicle's flights have shown of it.
        tell: takes what was changed on the vehicle, in words.
    """

    def __init__(
        self, flight: FlightRecord, plan: Plan, directory: Path, learned: LearnedDynamics, tell: Callable[[str], None]
    ) -> None:
        self._flight = flight
        self._tell = tell
        self._plan = plan
        self._directory = directory
        self._learned = learned

    async def report(self, vehicle: Vehicle, accepted: tuple[str, ...]) -> CheckedReport:
        """All checks, as far as they can be made now; nothing is changed on the vehicle."""
        limits = await vehicle.read_limits()
        fitted = await self._fitted_or_uploaded(vehicle, limits)
        checks = [
            *await self._of_the_moment(vehicle, fitted),
            await self._datum(vehicle),
            *self._limits(limits),
            *await check_lists(self._plan, vehicle, sent=False),
            *await self._ways_home(vehicle, limits, await vehicle.read_failsafes(), may_raise=True),
        ]
        if self._offboard:
            checks.append(await self._stream_loss(limits))
        checks += await self._companion(vehicle)
        return replace(self._report([*checks, *self._prediction(fitted)], accepted), prediction=fitted.prediction)

    async def fitted(self, vehicle: Vehicle, most_items: int | None = None) -> FittedMission:
        """The plan's mission for this vehicle, sampled so that its predicted flight keeps the clearance if any does.

        Args:
            vehicle: whose settings count.
            most_items: more than that it does not store; None when it has not refused any.

        Raises:
            RefusedError: it has no room for any sampling.
        """
        return await self._fit(vehicle, await vehicle.read_limits(), most_items)

    async def before_upload(self, vehicle: Vehicle, fitted: FittedMission, accepted: tuple[str, ...]) -> CheckedReport:
        """Limits, predicted flight, failsafes, ways home; the return altitude is raised where that clears the way."""
        await set_failsafes(vehicle, accepted, self._tell)
        limits = await vehicle.read_limits()
        checks = [*self._limits(limits), *self._prediction(fitted)]
        checks += await check_lists(self._plan, vehicle, sent=False)
        return await self._with_ways_home(vehicle, limits, checks, accepted)

    async def before_start(self, vehicle: Vehicle, accepted: tuple[str, ...]) -> CheckedReport:
        """Everything, on the ground and just before arming."""
        await set_failsafes(vehicle, accepted, self._tell)
        limits = await vehicle.read_limits()
        fitted = await self._fitted_or_uploaded(vehicle, limits)
        checks = [
            *await self._of_the_moment(vehicle, fitted),
            await self._datum(vehicle),
            *self._limits(limits),
            *self._prediction(fitted),
            *await check_lists(self._plan, vehicle, sent=not self._offboard),
            *await self._companion(vehicle),
        ]
        return await self._with_ways_home(vehicle, limits, checks, accepted)

    async def in_the_air(self, vehicle: Vehicle, accepted: tuple[str, ...]) -> CheckedReport:
        """What can be asked of a vehicle that is to go on from where it hovers."""
        limits = await vehicle.read_limits()
        checks = [preflight.check_link(vehicle.telemetry, vehicle.last_heard_s, time.monotonic())]
        checks += self._limits(limits)
        checks.append(preflight.check_energy(self._plan, vehicle.telemetry))
        checks += await self._ways_home(vehicle, limits, await vehicle.read_failsafes(), may_raise=False)
        return self._report(checks, accepted)

    async def return_is_clear_now(self, vehicle: Vehicle) -> bool:
        """How the vehicle can be sent home from where it is now.

        Where that cannot be judged (parameters or position are not told) it counts as clear: it is the operator's
        decision, and the checks before the flight have said what was not known.

        Returns:
            True for its own return, False where that would hit the structure and it can fly back the way it came.

        Raises:
            RefusedError: both would hit the structure, or nothing is known of the way back.
        """
        place, velocity = vehicle.telemetry.position, vehicle.telemetry.velocity_m_s
        try:
            limits = await vehicle.read_limits()
        except LinkError as error:
            self._tell(f"whether its return is clear from here was not checked: {error}")
            return True
        if limits.return_flight is None or place is None or place.age_s(time.monotonic()) > preflight.FRESH_S:
            self._tell("whether its return is clear from here is not known")
            return True
        position = np.asarray(scene_position(self._plan, place.value))
        moving = np.zeros(3) if velocity is None else velocity.value
        scene = _scene(self._directory, self._plan.scenario.ground_m)
        plan = self._returning_to(vehicle, position)
        if await asyncio.to_thread(return_is_clear, plan, scene, limits.return_flight, position, moving):
            return True
        problem = await asyncio.to_thread(retrace_problem, self._plan, limits.retrace)
        if problem:
            raise RefusedError(
                f"from where it is its return would hit the structure, and it cannot fly back the way it came "
                f"({problem}): let the plan go on, land it, or fly it clear by hand",
                field=vehicle.identity.name,
            )
        return False

    async def stream_loss_warp(self, vehicle: Vehicle) -> TimeWarp:
        """The plan's times, slowed where losing the stream would not be survivable.

        Raises:
            RefusedError: it cannot be slowed enough.
        """
        try:
            return await asyncio.to_thread(self._warp, await vehicle.read_limits())
        except InfeasibleError as error:
            raise RefusedError(f"stream loss: {error.message}", field=vehicle.identity.name) from error

    @property
    def _offboard(self) -> bool:
        return self._flight.mode.by_setpoints

    def _report(self, checks: list[PreflightCheck], accepted: tuple[str, ...]) -> CheckedReport:
        return CheckedReport(self._flight.id, utc_now(), preflight.with_acceptance(checks, accepted))

    async def _of_the_moment(self, vehicle: Vehicle, fitted: FittedMission) -> list[PreflightCheck]:
        with suppress(LinkError):  # a vehicle that was just found may not have been heard of everything yet
            await vehicle.until(lambda: _told(vehicle), TOLD_WITHIN_S, "its state")
        telemetry, found = vehicle.telemetry, fitted.prediction
        way = None if found is None else found.offboard if self._offboard else found.mission
        return [
            preflight.check_link(telemetry, vehicle.last_heard_s, time.monotonic()),
            preflight.check_on_ground(telemetry),
            preflight.check_fix(telemetry),
            preflight.check_energy(self._plan, telemetry, None if way is None else way.time_s),
            preflight.check_camera(vehicle.camera_component, vehicle.camera),
        ]

    def _limits(self, limits: VehicleLimits) -> list[PreflightCheck]:
        return preflight.check_limits(self._plan, limits, self._learned)

    def _prediction(self, fitted: FittedMission) -> list[PreflightCheck]:
        return preflight.check_prediction(fitted, offboard=self._offboard)

    async def _fitted_or_uploaded(self, vehicle: Vehicle, limits: VehicleLimits) -> FittedMission:
        """The mission that was uploaded for this flight; the one that would be, before that."""
        sampling = sampling_of(self._flight)
        if sampling is None:
            return await self._fit(vehicle, limits, None)
        scene, autopilot = _scene(self._directory, self._plan.scenario.ground_m), vehicle.identity.autopilot
        model = vehicle_model(autopilot, limits, self._learned)
        return await asyncio.to_thread(predicted_mission, self._plan, scene, autopilot, model, sampling)

    async def _fit(self, vehicle: Vehicle, limits: VehicleLimits, most_items: int | None) -> FittedMission:
        scene, autopilot = _scene(self._directory, self._plan.scenario.ground_m), vehicle.identity.autopilot
        model = vehicle_model(autopilot, limits, self._learned)
        return await asyncio.to_thread(fit_mission, self._plan, scene, autopilot, model, most_items)

    async def _datum(self, vehicle: Vehicle) -> PreflightCheck:
        try:
            await vehicle.request_position_references()
        except GcsError as error:
            return PreflightCheck("datum", "refused", error.message)
        return preflight.check_datum(self._plan, vehicle.telemetry)

    async def _companion(self, vehicle: Vehicle) -> list[PreflightCheck]:
        """Whether the companion that is to lead holds this plan; it is given the time to get it and make it ready."""
        if self._flight.mode is not FlightPath.COMPANION:
            return []
        try:
            await vehicle.ready_companion(self._flight.plan_hash, self._tell)
        except (LinkError, RefusedError) as error:
            return [PreflightCheck("companion", "refused", error.message)]
        return [PreflightCheck("companion", "ok", "holds the plan, ready to fly it")]

    async def _with_ways_home(
        self, vehicle: Vehicle, limits: VehicleLimits, checks: list[PreflightCheck], accepted: tuple[str, ...]
    ) -> CheckedReport:
        """The last checks of a report; nothing is changed on a vehicle that is refused for another reason."""
        failsafes = await vehicle.read_failsafes()
        before = await self._ways_home(vehicle, limits, failsafes, may_raise=True)
        fit = self._report([*checks, *before], accepted).ok
        if fit:
            limits = await self._with_safe_return(vehicle, limits)
        return self._report([*checks, *await self._ways_home(vehicle, limits, failsafes, may_raise=not fit)], accepted)

    async def _with_safe_return(self, vehicle: Vehicle, limits: VehicleLimits) -> VehicleLimits:
        """Raise the vehicle's return altitude where its return would hit the structure and a higher one does not."""
        if limits.return_altitude_m is None or limits.return_flight is None:
            return limits
        wanted = _higher(await self._return(vehicle, limits.return_flight))
        if wanted is None:
            return limits
        kept_parameter = await vehicle.set_return_altitude(wanted)
        kept = await vehicle.read_limits()
        self._tell(
            f"the return altitude of {vehicle.identity.name} was raised from {limits.return_altitude_m:g} m to "
            f"{kept.return_altitude_m:g} m above home ({kept_parameter}, read back), so that its own return keeps clear"
        )
        return kept

    async def _ways_home(
        self, vehicle: Vehicle, limits: VehicleLimits, failsafes: tuple[Failsafe, ...], *, may_raise: bool
    ) -> list[PreflightCheck]:
        """Safety rule 7: from everywhere along the plan, what the vehicle does by itself keeps clear."""
        flight = limits.return_flight
        found = await self._return(vehicle, flight)
        raised = _higher(found) if may_raise else None
        if raised is not None and flight is not None:
            found = replace(found, blocked_s=found.never_clear_s)
        problem = await asyncio.to_thread(retrace_problem, self._plan, limits.retrace)
        settings = await asyncio.to_thread(memory_settings, self._plan, limits.retrace)
        ways = OwnWaysOfVehicle(found, flight is not None, problem, settings, self._plan.trajectory.duration_s)
        checks = check_failsafes_along(failsafes, ways, self._flight.mode)
        cone = "" if flight is None else await self._cone_note(vehicle, found, flight)
        return [*checks, self._return_check(found, limits, raised, cone)]

    async def _cone_note(self, vehicle: Vehicle, found: WaysHome, flight: ReturnFlight) -> str:
        """What to say where the return is blocked because it climbs less close to home."""
        if flight.cone_slope is None or not found.blocked_s:
            return ""
        without = await self._return(vehicle, replace(flight, cone_slope=None))
        if _seconds(without.never_clear_s) >= _seconds(found.blocked_s):
            return ""
        return f"; close to home it climbs less, which {flight.no_cone} ends and would clear the way"

    def _return_check(
        self, found: WaysHome, limits: VehicleLimits, raised_m: float | None, cone: str
    ) -> PreflightCheck:
        """What the vehicle's own return, by its own switch, would do; `found` is that of the raised altitude."""
        name, altitude, flight = "ways home", limits.return_altitude_m, limits.return_flight
        if altitude is None:
            return PreflightCheck(name, "unknown", "the vehicle does not tell its return altitude")
        if flight is None:
            return PreflightCheck(name, "unknown", "the vehicle's return is not a straight one to home (RTL_TYPE 0)")
        seconds = _seconds(found.landing_blocked_s)
        landing = f"; landing on the spot would hit it during {seconds:.0f} s of the plan" if seconds else ""
        if found.ok:
            return PreflightCheck(name, "ok", f"return at {altitude:.0f} m keeps clear from everywhere{landing}")
        why = f"the vehicle's return at {altitude:.0f} m is blocked: {found.reason}"
        if raised_m is not None:
            why += f"; {raised_m:.0f} m is set on the vehicle at upload or start"
            if not found.blocked_s:
                return PreflightCheck(name, "ok", f"{why}, which keeps clear{landing}")
        elif _higher(found) is not None:
            return PreflightCheck(name, "refused", f"{why}; {found.clearest_m:.0f} m keeps clear")
        blocked, first = _seconds(found.blocked_s), found.blocked_s[0][0]
        return PreflightCheck(
            name,
            "needs_acceptance",
            f"{why}{cone}; no altitude clears it during {blocked:.0f} s of the plan, first at {first:.0f} s: nobody "
            f"may switch the vehicle to return then{landing}",
        )

    async def _stream_loss(self, limits: VehicleLimits) -> PreflightCheck:
        try:
            warp = await asyncio.to_thread(self._warp, limits)
        except InfeasibleError as error:
            return PreflightCheck("stream loss", "refused", error.message)
        slower = warp.duration_s / self._plan.trajectory.duration_s - 1
        return PreflightCheck(
            "stream loss", "ok", f"survivable everywhere; the plan is flown {slower:.0%} slower for it"
        )

    def _warp(self, limits: VehicleLimits) -> TimeWarp:
        scenario, safety = self._plan.scenario, self._plan.scenario.safety
        acceleration = scenario.vehicle.max_acceleration_m_s2
        told = limits.offboard_timeout_s
        return slow_for_stream_loss(
            self._plan.trajectory,
            _scene(self._directory, scenario.ground_m),
            timeout_s=DEFAULT_OFFBOARD_TIMEOUT_S if told is None else told,
            deceleration_m_s2=BRAKING_SHARE * acceleration,
            acceleration_m_s2=acceleration * 1.001,
            keep_m=scenario.vehicle.radius_m + safety.position_m + safety.model_m,
            home_m=scenario.home_m,
        )

    async def _return(self, vehicle: Vehicle, flight: ReturnFlight | None) -> WaysHome:
        scene, rally_m = _scene(self._directory, self._plan.scenario.ground_m), self._rally_m(vehicle)
        return await asyncio.to_thread(check_ways_home, self._plan, scene, flight, rally_m=rally_m)

    def _rally_m(self, vehicle: Vehicle) -> tuple[Point3, ...]:
        """Places that the vehicle knows beside home when it flies: the scenario's, if it keeps any."""
        return self._plan.scenario.rally_m if vehicle.keeps_list(MissionType.RALLY) else ()

    def _returning_to(self, vehicle: Vehicle, position_m: NDArray[np.float64]) -> Plan:
        """The plan with its home where a return from here ends: the nearest of home and the rally points."""
        scenario = self._plan.scenario
        places = np.asarray([scenario.home_m, *self._rally_m(vehicle)])
        nearest = int(np.argmin(np.hypot(*(places[:, :2] - position_m[:2]).T)))
        if nearest == 0:
            return self._plan
        x, y = places[nearest, :2]
        return replace(self._plan, scenario=scenario.model_copy(update={"home_m": (x, y, scenario.home_m[2])}))


def _higher(found: WaysHome) -> float | None:
    """A return altitude that clears more than the present one; None when there is none."""
    better = _seconds(found.never_clear_s) < _seconds(found.blocked_s)
    return found.clearest_m if better and found.clearest_m is not None else None


def _seconds(intervals: Intervals) -> float:
    return sum(b - a + 1e-3 for a, b in intervals)


@lru_cache(maxsize=4)
def _scene(directory: Path, ground_m: float | None) -> SceneDistance:
    return SceneDistance(read_structure(directory), ground_m)


def _told(vehicle: Vehicle) -> bool:
    return vehicle.telemetry.battery is not None and vehicle.telemetry.gps_fix is not None
