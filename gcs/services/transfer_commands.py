"""`gcs upload` and `gcs download`: the transfer of mission, fence and rally points alone."""

from __future__ import annotations

import math
from contextlib import asynccontextmanager
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from gcs.core.errors import RefusedError
from gcs.core.frames import GeoPoint
from gcs.core.mission import Mission
from gcs.mavlink.station import MavlinkStation
from gcs.planning.scene.point_distance import SceneDistance
from gcs.services.fence_rally import check_lists, upload_lists
from gcs.services.fitted_upload import upload_fitted
from gcs.services.mission_files import mission_planner_waypoints
from gcs.services.mission_fitting import fit_mission
from gcs.services.preflight import check_failsafes, check_limits, check_prediction
from gcs.services.vehicle_model import vehicle_model
from gcs.storage.plan_files import read_plan, read_structure

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Callable
    from pathlib import Path

    from gcs.mavlink.vehicle import Vehicle
    from gcs.services.mission_fitting import FittedMission

VEHICLE_TIMEOUT_S = 30.0


@asynccontextmanager
async def connected_vehicle(url: str) -> AsyncIterator[Vehicle]:
    """The first vehicle that answers on a link, for the time of an `async with` block.

    Raises:
        InputError: the URL is malformed.
        LinkError: nobody answers.
    """
    station = MavlinkStation()
    await station.open(url)
    try:
        yield await station.wait_for_vehicle(VEHICLE_TIMEOUT_S)
    finally:
        await station.close_all()


async def upload_plan(out: Path, url: str, say: Callable[[str], None]) -> dict[str, Any]:
    """Put the mission of a written plan on a vehicle and prove it; then its fence and its rally points, if it has any.

    The vehicle's limits and failsafes are read first: a plan beyond the limits, or whose predicted flight leaves the
    clearance, is not uploaded; what is unknown or switched off is said, and has to be accepted by name before a flight.

    Args:
        out: the plan's folder.
        url: of the link.
        say: takes lines for the operator.

    Raises:
        InputError: the folder holds no plan.
        LinkError: nobody answers, or the link was lost; what the vehicle holds is then not known.
        RefusedError: the plan is beyond the vehicle's limits, its predicted flight leaves the clearance, or the vehicle
            refused.
    """
    plan = read_plan(out)
    async with connected_vehicle(url) as vehicle:
        limits = await vehicle.read_limits()
        checks = check_limits(plan, limits)
        autopilot, scene = vehicle.identity.autopilot, SceneDistance(read_structure(out), plan.scenario.ground_m)
        model = vehicle_model(autopilot, limits)
        fitted = fit_mission(plan, scene, autopilot, model)
        checks += check_prediction(fitted, offboard=False)
        checks += check_failsafes(await vehicle.read_failsafes())
        checks += await check_lists(plan, vehicle, sent=False)
        for check in checks:
            if check.state == "refused":
                raise RefusedError(f"{check.name}: {check.detail}", field=vehicle.identity.name)
            if check.state != "ok":
                say(f"{check.state.replace('_', ' ')}: {check.name}: {check.detail}")

        async def refit(most_items: int) -> FittedMission:
            return fit_mission(plan, scene, autopilot, model, most_items)

        proof, _ = await upload_fitted(vehicle, fitted, refit, say)
        lists = await upload_lists(plan, vehicle)
        return {
            "vehicle": vehicle.identity.name,
            "proved": True,
            "items": proof.items_sent,
            "items_read": proof.items_read,
            "how": proof.how,
            "canonical_crc32": proof.canonical_crc32,
            "lists": [asdict(entry) for entry in lists],
        }


async def download_mission(url: str) -> tuple[str, list[dict[str, Any]]]:
    """Read the mission that a vehicle holds.

    Returns:
        Content of a `.waypoints` file, and the items as JSON objects (None for NaN).

    Raises:
        LinkError: nobody answers, or the link was lost.
        RefusedError: the vehicle refused.
    """
    async with connected_vehicle(url) as vehicle:
        items = await vehicle.download_mission()
        autopilot, home = vehicle.identity.autopilot, vehicle.telemetry.home
        place = GeoPoint(0.0, 0.0, 0.0) if home is None else home.value
    objects = [{**asdict(item), "params": [None if math.isnan(p) else p for p in item.params]} for item in items]
    return mission_planner_waypoints(Mission(items), autopilot, place), objects
