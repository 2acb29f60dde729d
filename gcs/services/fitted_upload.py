"""A mission put on a vehicle that may have no room for it: then a coarser one, if its predicted flight allows it."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING

from gcs.core.errors import RefusedError
from gcs.mavlink.mission_upload import UNKNOWN, NoRoomError
from gcs.services.preflight import check_prediction

if TYPE_CHECKING:
    from collections.abc import Awaitable, Callable

    from gcs.core.progress import Progress
    from gcs.mavlink.mission_proof import UploadProof
    from gcs.mavlink.vehicle import Vehicle
    from gcs.services.flight_recorder import FlightRecorder
    from gcs.services.mission_fitting import FittedMission

STOPPED_UPLOAD = f"the upload was cancelled; {UNKNOWN}"
"""What is true, and what the operator is told, whenever an upload was stopped before its proof."""

_COARSER_TRIES = 3


async def upload_fitted(
    vehicle: Vehicle,
    fitted: FittedMission,
    refit: Callable[[int], Awaitable[FittedMission]],
    say: Callable[[str], None],
    progress: Progress | None = None,
) -> tuple[UploadProof, FittedMission]:
    """Upload a mission, or the first coarser one that the vehicle has room for.

    Args:
        vehicle: who is to hold it.
        fitted: what is sent first.
        refit: samples the plan again for a number of items at most.
        say: takes a line for the operator when another mission is sent.
        progress: see `upload_and_prove`.

    Returns:
        The proof, and what it is the proof of.

    Raises:
        RefusedError: no mission that the vehicle has room for keeps the clearance, or it refused for another reason.
        LinkError: the link is gone.
    """
    for _ in range(_COARSER_TRIES):
        try:
            return await vehicle.upload_mission(fitted.mission, progress), fitted
        except NoRoomError as error:
            count = len(fitted.mission.items)
            fitted = await refit(min(error.capacity or count - 1, count - 1))
            refused = [c for c in check_prediction(fitted, offboard=False) if c.state != "ok"]
            if refused:
                raise RefusedError(
                    f"{error.message}; sampled coarser, {refused[0].detail}", field=error.field
                ) from error
            sent = len(fitted.mission.items)
            say(f"the vehicle has no room for {count} items: {sent} are sent instead, {fitted.sampling.words}")
    return await vehicle.upload_mission(fitted.mission, progress), fitted


def remember_sampling(recorder: FlightRecorder, fitted: FittedMission) -> None:
    """What is read back later is compared with the same mission, after a restart of the station too."""
    recorder.change(mission_sampling=asdict(fitted.sampling))
