"""`gcs upload`, `gcs download`, `gcs clear`, `gcs set-current`: transfer of mission, fence and rally points alone."""

from __future__ import annotations

import asyncio
import math
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from gcs.core.errors import RefusedError
from gcs.core.frames import GeoPoint
from gcs.core.mission import Mission
from gcs.planning.scene.point_distance import SceneDistance
from gcs.services.fence_rally import check_lists, upload_lists
from gcs.services.fitted_upload import STOPPED_UPLOAD, upload_fitted
from gcs.services.mission_files import mission_planner_waypoints
from gcs.services.mission_fitting import fit_mission
from gcs.services.opened_link import opened_link
from gcs.services.preflight import check_failsafes, check_limits, check_prediction
from gcs.services.vehicle_model import vehicle_model
from gcs.storage.plan_files import read_plan, read_structure

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from gcs.mavlink.mission_protocol import MissionType
    from gcs.mavlink.vehicle import Vehicle
    from gcs.services.mission_fitting import FittedMission
    from gcs.services.opened_link import OpenedLink

VEHICLE_TIMEOUT_S = 30.0


async def upload_plan(out: Path, url: str, say: Callable[[str], None], data_dir: Path | None = None) -> dict[str, Any]:
    """Put the mission of a written plan on a vehicle and prove it; then its fence and its rally points, if it has any.

    The vehicle's limits and failsafes are read first: a plan beyond the limits, or whose predicted flight leaves the
    clearance, is not uploaded; what is unknown or switched off is said, and has to be accepted by name before a flight.

    Args:
        out: the plan's folder.
        url: of the link.
        say: takes lines for the operator.
        data_dir: where the link's key is kept, if it is signed.

    Raises:
        InputError: the folder holds no plan, or the passphrase of stored keys is missing or wrong.
        LinkError: nobody answers, or the link was lost; what the vehicle holds is then not known.
        RefusedError: the plan is beyond the vehicle's limits, its predicted flight leaves the clearance, or the vehicle
            refused.
        CancelledError: the operator interrupted it; the vehicle was told, and the operator what is unknown now.
    """
    plan = read_plan(out)
    async with opened_link(url, data_dir, VEHICLE_TIMEOUT_S) as link:
        vehicle = link.vehicle
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

        try:
            proof, _ = await upload_fitted(vehicle, fitted, refit, say)
            lists = await upload_lists(plan, vehicle)
        except asyncio.CancelledError:  # the vehicle was told
            say(STOPPED_UPLOAD)
            raise
        return {
            "vehicle": vehicle.identity.name,
            "proved": True,
            "items": proof.items_sent,
            "items_read": proof.items_read,
            "how": proof.how,
            "canonical_crc32": proof.canonical_crc32,
            "lists": [asdict(entry) for entry in lists],
        }


async def download_mission(url: str, data_dir: Path | None = None) -> tuple[str, list[dict[str, Any]]]:
    """Read the mission that a vehicle holds.

    Args:
        url: of the link.
        data_dir: where the link's key is kept, if it is signed.

    Returns:
        Content of a `.waypoints` file, and the items as JSON objects (None for NaN).

    Raises:
        LinkError: nobody answers, or the link was lost.
        RefusedError: the vehicle refused.
    """
    async with opened_link(url, data_dir, VEHICLE_TIMEOUT_S) as link:
        vehicle = link.vehicle
        items = await vehicle.download_mission()
        autopilot, home = vehicle.identity.autopilot, vehicle.telemetry.home
        place = GeoPoint(0.0, 0.0, 0.0) if home is None else home.value
    objects = [{**asdict(item), "params": [None if math.isnan(p) else p for p in item.params]} for item in items]
    return mission_planner_waypoints(Mission(items), autopilot, place), objects


async def clear_list(url: str, name: str, mission_type: MissionType, data_dir: Path | None = None) -> None:
    """Have a disarmed vehicle forget its mission, its fence or its rally points, and read that nothing is left of it.

    Args:
        url: of the link.
        name: of the vehicle, or its system id.
        mission_type: what to clear.
        data_dir: where the link's key is kept, if it is signed.

    Raises:
        NotFoundError: another vehicle answers.
        RefusedError: the vehicle is armed, keeps no such list, or does not clear it.
        IncompleteError: it says that it has cleared it, and still holds some of it.
        LinkError: nobody answers, or the link was lost.
    """
    async with opened_link(url, data_dir, VEHICLE_TIMEOUT_S) as link:
        await (await _disarmed(link, name, "lists are cleared")).clear_list(mission_type)


async def set_current(url: str, name: str, item: int, data_dir: Path | None = None) -> None:
    """Make an item of a disarmed vehicle's mission the current one, and see that it tells so.

    In flight it would leave the path that was checked, and jump. A start by the station is from the first item anyhow.

    Args:
        url: of the link.
        name: of the vehicle, or its system id.
        item: its number in the mission, from 0.
        data_dir: where the link's key is kept, if it is signed.

    Raises:
        NotFoundError: another vehicle answers.
        RefusedError: the vehicle is armed.
        LinkError: nobody answers, or it does not tell that item: it may have none of that number.
    """
    async with opened_link(url, data_dir, VEHICLE_TIMEOUT_S) as link:
        await (await _disarmed(link, name, "the current item is set")).set_current(item)


async def _disarmed(link: OpenedLink, name: str, what: str) -> Vehicle:
    vehicle = link.station.vehicle(name)
    await vehicle.until(lambda: vehicle.telemetry.armed is not None, VEHICLE_TIMEOUT_S, "its state")
    armed = vehicle.telemetry.armed
    if armed is None or armed.value:
        raise RefusedError(f"{what} on a vehicle that is disarmed", field=vehicle.identity.name)
    return vehicle
