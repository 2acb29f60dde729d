"""Signing of links: keys made, given to vehicles, proved, kept, and used again at the next start."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

from gcs.core.clock import utc_now
from gcs.core.errors import GcsError, IncompleteError
from gcs.mavlink.link_url import parse_link_url
from gcs.mavlink.signing import LinkSigning, new_key
from gcs.storage.data_directory import default_data_directory
from gcs.storage.signing_keys import PASSPHRASE_VARIABLE, SigningKeyStore, StoredKey

if TYPE_CHECKING:
    from pathlib import Path

    from gcs.mavlink.signing_setup import SigningProof
    from gcs.mavlink.station import MavlinkStation


def key_store(data_dir: Path | None) -> SigningKeyStore:
    """The keys of a data directory (the user's own when not given), under the passphrase of the environment."""
    return SigningKeyStore(data_dir or default_data_directory(), os.environ.get(PASSPHRASE_VARIABLE))


class LinkSigningService:
    """What an operator can do about signing.

    Args:
        station: the MAVLink side.
        keys: where keys are kept.
    """

    def __init__(self, station: MavlinkStation, keys: SigningKeyStore) -> None:
        self._station = station
        self._keys = keys

    async def open(self, url: str) -> str:
        """Open a link, signed when it has a key; returns its URL with the port that was really bound.

        Raises:
            InputError: it has a key, and the passphrase is missing or wrong. It is not opened unsigned instead.
            GcsError: as of `MavlinkStation.open`.
        """
        stored = self._keys.get(parse_link_url(url).url)
        if stored is None:
            return await self._station.open(url)
        return await self._station.open(url, _signing(stored))

    async def set_up(self, vehicle_name: str, url: str, *, rejects_unsigned: bool = True) -> SigningProof:
        """Give a disarmed vehicle a new key over a link (instead of its old one, if there is one) and prove it.

        The key is kept as soon as the vehicle has it, also when it is not enforced there.

        Args:
            vehicle_name: must be heard on this link, and on no other.
            url: of the open link; the key goes over it in the clear.
            rejects_unsigned: whether packets without a signature are refused from now on.

        Raises:
            InputError: no passphrase to keep the key with.
            RefusedError: the vehicle is armed, heard elsewhere, or does not take the key.
            LinkError: it does not answer.
            IncompleteError: it has the key, which could not be kept here.
        """
        self._keys.check_passphrase()
        canonical = parse_link_url(url).url
        rotated_at = None if self._keys.get(canonical) is None else utc_now()
        stored = StoredKey(new_key(), rejects_unsigned, rotated_at)
        vehicle = self._station.vehicle(vehicle_name)
        proof = await self._station.set_up_signing(vehicle, url, _signing(stored))
        try:
            self._keys.put(canonical, stored)
        except GcsError as error:
            words = f"the vehicle has a new key, which is lost when the station ends: {error.message}; set it up again"
            raise IncompleteError(words, field=error.field) from error
        return proof

    async def prove(self, vehicle_name: str, url: str) -> SigningProof:
        """See whether a disarmed vehicle goes by the key of a signed link there: one that got it by `share`, say.

        Raises:
            ConflictError: the link is not signed, or the vehicle is heard elsewhere too.
            RefusedError: the vehicle is armed, or answers nothing that is signed with this key.
            LinkError: it does not answer.
        """
        return await self._station.prove_signing(self._station.vehicle(vehicle_name), url)

    def share(self, url: str, other_url: str) -> None:
        """Sign another link with the key of one, from when it is opened next: a vehicle's key holds for all its links.

        Raises:
            NotFoundError: the first link has no key.
            InputError: the passphrase is missing or wrong.
        """
        stored = self._keys.known(parse_link_url(url).url)
        self._keys.put(parse_link_url(other_url).url, stored)

    async def remove(self, vehicle_name: str, url: str) -> None:
        """Have a disarmed vehicle forget its key, and forget it here.

        Raises:
            NotFoundError: the link has no key.
            RefusedError: the vehicle is armed, or heard elsewhere.
            LinkError: it goes on signing.
        """
        canonical = parse_link_url(url).url
        self._keys.known(canonical)
        await self._station.remove_signing(self._station.vehicle(vehicle_name), url)
        self._keys.delete(canonical)


def _signing(stored: StoredKey) -> LinkSigning:
    return LinkSigning(stored.key, rejects_unsigned=stored.rejects_unsigned, rotated_at=stored.rotated_at)
