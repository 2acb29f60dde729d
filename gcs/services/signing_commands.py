"""`gcs signing`: keys given to vehicles and taken back, without a running station."""

from __future__ import annotations

from contextlib import asynccontextmanager
from typing import TYPE_CHECKING

from gcs.mavlink.link_url import parse_link_url
from gcs.mavlink.station import MavlinkStation
from gcs.services.link_signing import LinkSigningService, key_store
from gcs.services.opened_link import OpenedLink, opened_link
from gcs.storage.key_files import write_key_file

if TYPE_CHECKING:
    from collections.abc import AsyncIterator
    from pathlib import Path

    from gcs.mavlink.signing_setup import SigningProof

VEHICLE_TIMEOUT_S = 30.0


async def give_key(url: str, vehicle: str, data_dir: Path | None, *, rejects_unsigned: bool) -> SigningProof:
    """Give a vehicle a new key over a link; errors as of `LinkSigningService.set_up`."""
    key_store(data_dir).check_passphrase()
    async with _state_known(url, data_dir) as link:
        return await link.signing.set_up(vehicle, link.url, rejects_unsigned=rejects_unsigned)


async def prove_key(url: str, vehicle: str, data_dir: Path | None) -> SigningProof:
    """See whether a vehicle goes by a link's key; errors as of `LinkSigningService.prove`, and NotFoundError."""
    key_store(data_dir).known(parse_link_url(url).url)
    async with _state_known(url, data_dir) as link:
        return await link.signing.prove(vehicle, link.url)


async def take_key_back(url: str, vehicle: str, data_dir: Path | None) -> None:
    """Have a vehicle forget its key; errors as of `LinkSigningService.remove`."""
    async with _state_known(url, data_dir) as link:
        await link.signing.remove(vehicle, link.url)


def share_key(url: str, other_url: str, data_dir: Path | None) -> None:
    """Have a second link to a vehicle signed with the key of the first; errors as of `LinkSigningService.share`."""
    LinkSigningService(MavlinkStation(), key_store(data_dir)).share(url, other_url)


def export_key(url: str, file: Path, data_dir: Path | None) -> None:
    """Write a link's key to a file of its own.

    Raises:
        NotFoundError: the link has no key.
        ConflictError: its key is not proved.
        InputError: the passphrase is missing or wrong.
        StorageError: the file cannot be written.
    """
    write_key_file(file, key_store(data_dir).proved(parse_link_url(url).url).key)


@asynccontextmanager
async def _state_known(url: str, data_dir: Path | None) -> AsyncIterator[OpenedLink]:
    async with opened_link(url, data_dir, VEHICLE_TIMEOUT_S) as link:
        vehicle = link.vehicle
        await vehicle.until(lambda: vehicle.telemetry.armed is not None, VEHICLE_TIMEOUT_S, "its state")
        yield link
