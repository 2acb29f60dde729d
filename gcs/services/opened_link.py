"""One link opened for the time of a command, with its stored key if it has one, and the vehicle that answers on it."""

from __future__ import annotations

from contextlib import asynccontextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

from gcs.mavlink.station import MavlinkStation
from gcs.services.link_signing import LinkSigningService, key_store

if TYPE_CHECKING:
    from collections.abc import AsyncIterator
    from pathlib import Path

    from gcs.mavlink.vehicle import Vehicle


@dataclass(frozen=True)
class OpenedLink:
    """An open link.

    Attributes:
        station: which has no other link.
        signing: of its links.
        url: in its canonical spelling.
        vehicle: the first that answered.
    """

    station: MavlinkStation
    signing: LinkSigningService
    url: str
    vehicle: Vehicle


@asynccontextmanager
async def opened_link(url: str, data_dir: Path | None, timeout_s: float) -> AsyncIterator[OpenedLink]:
    """Open a link for the time of an `async with` block, as soon as a vehicle answers on it.

    Args:
        url: of the link.
        data_dir: where its key is kept, if it is signed; the user's own when not given.
        timeout_s: how long to wait for a vehicle.

    Raises:
        InputError: the URL is malformed; or keys are stored, and the passphrase is missing or wrong.
        LinkError: nobody answers.
    """
    station = MavlinkStation()
    signing = LinkSigningService(station, key_store(data_dir))
    opened = await signing.open(url)
    try:
        yield OpenedLink(station, signing, opened, await station.wait_for_vehicle(timeout_s))
    finally:
        await station.close_all()
