"""Which checks stand before which command, and the proofs that need the scene (safety rules 3 to 8)."""

from __future__ import annotations

import asyncio
import time
from functools import lru_cache
from typing import TYPE_CHECKING

from gcs.core.clock import utc_now
from gcs.core.errors import GcsError, InfeasibleError, RefusedError
from gcs.planning.point_distance import SceneDistance
from gcs.planning.stream_loss import slow_for_stream_loss
from gcs.planning.ways_home import check_ways_home
from gcs.services import preflight
from gcs.services.flight_types import PreflightCheck, PreflightReport
from gcs.storage.plan_files import read_structure
from gcs.storage.records import FlightPath

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from gcs.core.plan import Plan
    from gcs.core.vehicle import VehicleLimits
    from gcs.mavlink.vehicle import Vehicle
    from gcs.planning.retiming import TimeWarp
    from gcs.planning.ways_home import WaysHome
    from gcs.storage.records import FlightRecord

DEFAULT_OFFBOARD_TIMEOUT_S = 3.0
"""Taken for a vehicle that does not tell how long it flies on without setpoints: the longest that was measured."""

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
        tell: takes what was changed on the vehicle, in words.
    """

    def __init__(self, flight: FlightRecord, plan: Plan, directory: Path, tell: Callable[[str], None]) -> None:
        self._flight = flight
        self._tell = tell
        self._plan = plan
        self._directory = directory

    async def report(self, vehicle: Vehicle, accepted: tuple[str, ...]) -> CheckedReport:
        """All checks, as far as they can be made now; nothing is changed on the vehicle."""
        limits = await vehicle.read_limits()
        checks = [
            *self._of_the_moment(vehicle),
            await self._datum(vehicle),
            *preflight.check_limits(self._plan, limits),
        ]
        checks += preflight.check_failsafes(await vehicle.read_failsafes())
        checks.append(await self._ways_home(limits, may_raise=True))
        if self._flight.mode is FlightPath.OFFBOARD:
            checks.append(await self._stream_loss(limits))
        return self._report(checks, accepted)

    async def before_upload(self, vehicle: Vehicle, accepted: tuple[str, ...]) -> CheckedReport:
        """Limits, failsafes and ways home; the return altitude is raised on the vehicle where that clears the way."""
        limits = await vehicle.read_limits()
        checks = preflight.check_limits(self._plan, limits)
        checks += preflight.check_failsafes(await vehicle.read_failsafes())
        return await self._with_ways_home(vehicle, limits, checks, accepted)

    async def before_start(self, vehicle: Vehicle, accepted: tuple[str, ...]) -> CheckedReport:
        """Everything, on the ground and just before arming."""
        limits = await vehicle.read_limits()
        checks = [
            *self._of_the_moment(vehicle),
            await self._datum(vehicle),
            *preflight.check_limits(self._plan, limits),
        ]
        checks += preflight.check_failsafes(await vehicle.read_failsafes())
        return await self._with_ways_home(vehicle, limits, checks, accepted)

    async def in_the_air(self, vehicle: Vehicle, accepted: tuple[str, ...]) -> CheckedReport:
        """What can be asked of a vehicle that is to go on from where it hovers."""
        limits = await vehicle.read_limits()
        checks = [preflight.check_link(vehicle.telemetry, vehicle.last_heard_s, time.monotonic())]
        checks += preflight.check_limits(self._plan, limits)
        checks.append(preflight.check_energy(self._plan, vehicle.telemetry))
        checks.append(await self._ways_home(limits, may_raise=False))
        return self._report(checks, accepted)

    async def stream_loss_warp(self, vehicle: Vehicle) -> TimeWarp:
        """The plan's times, slowed where losing the stream would not be survivable.

        Raises:
            RefusedError: it cannot be slowed enough.
        """
        try:
            return await asyncio.to_thread(self._warp, await vehicle.read_limits())
        except InfeasibleError as error:
            raise RefusedError(f"stream loss: {error.message}", field=vehicle.identity.name) from error

    def _report(self, checks: list[PreflightCheck], accepted: tuple[str, ...]) -> CheckedReport:
        return CheckedReport(self._flight.id, utc_now(), preflight.with_acceptance(checks, accepted))

    def _of_the_moment(self, vehicle: Vehicle) -> list[PreflightCheck]:
        telemetry = vehicle.telemetry
        return [
            preflight.check_link(telemetry, vehicle.last_heard_s, time.monotonic()),
            preflight.check_on_ground(telemetry),
            preflight.check_fix(telemetry),
            preflight.check_energy(self._plan, telemetry),
        ]

    async def _datum(self, vehicle: Vehicle) -> PreflightCheck:
        try:
            await vehicle.request_position_references()
        except GcsError as error:
            return PreflightCheck("datum", "refused", error.message)
        return preflight.check_datum(self._plan, vehicle.telemetry)

    async def _with_ways_home(
        self, vehicle: Vehicle, limits: VehicleLimits, checks: list[PreflightCheck], accepted: tuple[str, ...]
    ) -> CheckedReport:
        """The last check of a report; nothing is changed on a vehicle that is refused for another reason."""
        fit = self._report(checks, accepted).ok
        if fit:
            limits = await self._with_safe_return(vehicle, limits)
        return self._report([*checks, await self._ways_home(limits, may_raise=not fit)], accepted)

    async def _with_safe_return(self, vehicle: Vehicle, limits: VehicleLimits) -> VehicleLimits:
        """Raise the vehicle's return altitude where its return would hit the structure and a higher one does not."""
        if limits.return_altitude_m is None:
            return limits
        found = await asyncio.to_thread(self._return, limits.return_altitude_m)
        if found.ok or found.lowest_safe_m is None:
            return limits
        kept_parameter = await vehicle.set_return_altitude(found.lowest_safe_m)
        kept = await vehicle.read_limits()
        self._tell(
            f"the return altitude of {vehicle.identity.name} was raised from {limits.return_altitude_m:g} m to "
            f"{kept.return_altitude_m:g} m above home ({kept_parameter}, read back), so that its own return keeps clear"
        )
        return kept

    async def _ways_home(self, limits: VehicleLimits, *, may_raise: bool) -> PreflightCheck:
        """Safety rule 7: from everywhere along the plan, the vehicle's own return keeps clear."""
        name, altitude = "ways home", limits.return_altitude_m
        if altitude is None:
            return PreflightCheck(name, "unknown", "the vehicle does not tell its return altitude")
        found = await asyncio.to_thread(self._return, altitude)
        seconds = sum(b - a for a, b in found.landing_blocked_s)
        landing = f"; landing on the spot would hit it during {seconds:.0f} s of the plan" if seconds else ""
        if found.ok:
            return PreflightCheck(name, "ok", f"return at {altitude:.0f} m keeps clear from everywhere{landing}")
        why = f"the vehicle's return at {altitude:.0f} m is blocked: {found.reason}"
        if found.lowest_safe_m is None:
            how = "no altitude clears it, some climb is under the structure: leave those viewpoints out"
            return PreflightCheck(name, "refused", f"{why}; {how}")
        lowest = f"{found.lowest_safe_m:.0f} m keeps clear"
        if may_raise:
            return PreflightCheck(name, "ok", f"{why}; {lowest} and is set on the vehicle at upload or start{landing}")
        return PreflightCheck(name, "refused", f"{why}; {lowest}")

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

    def _return(self, altitude_m: float) -> WaysHome:
        return check_ways_home(self._plan, _scene(self._directory, self._plan.scenario.ground_m), altitude_m)


@lru_cache(maxsize=4)
def _scene(directory: Path, ground_m: float | None) -> SceneDistance:
    return SceneDistance(read_structure(directory), ground_m)
