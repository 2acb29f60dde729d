"""`gcs signing`: keys given to vehicles and taken back, without a running station."""

from __future__ import annotations

import os
from contextlib import asynccontextmanager
from typing import TYPE_CHECKING

from gcs.mavlink.station import MavlinkStation
from gcs.services.link_signing import LinkSigningService
from gcs.storage.data_directory import default_data_directory
from gcs.storage.signing_keys import PASSPHRASE_VARIABLE, SigningKeyStore

if TYPE_CHECKING:
    from collections.abc import AsyncIterator
    from pathlib import Path

    from gcs.mavlink.signing_setup import SigningProof

VEHICLE_TIMEOUT_S = 30.0


def key_store(data_dir: Path | None) -> SigningKeyStore:
    """The keys of a data directory, under the passphrase of the environment."""
    return SigningKeyStore(data_dir or default_data_directory(), os.environ.get(PASSPHRASE_VARIABLE))


async def give_key(url: str, vehicle: str, data_dir: Path | None, *, rejects_unsigned: bool) -> SigningProof:
    """Give a vehicle a new key over a link; errors as of `LinkSigningService.set_up`."""
    keys = key_store(data_dir)
    keys.check_passphrase()
    async with _opened(url, keys) as (signing, opened):
        return await signing.set_up(vehicle, opened, rejects_unsigned=rejects_unsigned)


async def take_key_back(url: str, vehicle: str, data_dir: Path | None) -> None:
    """Have a vehicle forget its key; errors as of `LinkSigningService.remove`."""
    async with _opened(url, key_store(data_dir)) as (signing, opened):
        await signing.remove(vehicle, opened)


@asynccontextmanager
async def _opened(url: str, keys: SigningKeyStore) -> AsyncIterator[tuple[LinkSigningService, str]]:
    station = MavlinkStation()
    signing = LinkSigningService(station, keys)
    opened = await signing.open(url)
    try:
        found = await station.wait_for_vehicle(VEHICLE_TIMEOUT_S)
        await found.until(lambda: found.telemetry.armed is not None, VEHICLE_TIMEOUT_S, "its state")
        yield signing, opened
    finally:
        await station.close_all()
