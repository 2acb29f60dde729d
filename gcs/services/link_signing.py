"""Signing of links: keys made, given to vehicles, proved, kept, and used again at the next start.

A key is kept before it is sent, as pending: if the answers are lost, or the station ends, the vehicle may hold it.
The next set-up gives the vehicle the pending key, not another one; its proof makes it the link's key. Until then a link
that is opened goes by whichever of the two keys the vehicle signs with.
"""

from __future__ import annotations

import os
from dataclasses import replace
from typing import TYPE_CHECKING

from gcs.core.clock import utc_now
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
        canonical = parse_link_url(url).url
        present, pending = self._keys.get(canonical), self._keys.pending(canonical)
        if present is not None:
            return await self._station.open(url, _signing(present, pending))
        if pending is not None:  # a vehicle without a key takes what is signed, too
            return await self._station.open(url, _signing(replace(pending, rejects_unsigned=False)))
        return await self._station.open(url)

    async def set_up(self, vehicle_name: str, url: str, *, rejects_unsigned: bool = True) -> SigningProof:
        """Give a disarmed vehicle a new key over a link (instead of its old one, if there is one) and prove it.

        The key becomes the link's as soon as the vehicle is known to have it, also when it is not enforced there.

        Args:
            vehicle_name: must be heard on this link and on no other, and be alone on it.
            url: of the open link; the key goes over it in the clear.
            rejects_unsigned: whether packets without a signature are refused from now on.

        Raises:
            InputError: no passphrase to keep the key with.
            RefusedError: the vehicle is armed or heard elsewhere, or another one is heard on this link.
            LinkError: nothing shows that it took the key, which stays pending.
            StorageError: the key could not be kept, and was not sent; or it is proved, and is still kept as pending.
        """
        self._keys.check_passphrase()
        canonical = parse_link_url(url).url
        rotated_at = None if self._keys.get(canonical) is None else utc_now()
        pending = self._keys.pending(canonical)
        stored = StoredKey(new_key() if pending is None else pending.key, rejects_unsigned, rotated_at)
        vehicle = self._station.vehicle(vehicle_name)
        proof = await self._station.set_up_signing(
            vehicle, url, _signing(stored), lambda: self._keys.put_pending(canonical, stored)
        )
        self._keys.put(canonical, stored)
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
            ConflictError: its key is not proved.
            InputError: the passphrase is missing or wrong.
        """
        stored = self._keys.proved(parse_link_url(url).url)
        self._keys.put(parse_link_url(other_url).url, stored)

    async def remove(self, vehicle_name: str, url: str) -> None:
        """Have a disarmed vehicle forget its key, and forget it here.

        Raises:
            NotFoundError: the link has no key.
            ConflictError: the link is open unsigned, the vehicle is heard elsewhere, or another one on this link.
            RefusedError: the vehicle is armed.
            LinkError: it goes on signing.
        """
        canonical = parse_link_url(url).url
        self._keys.known(canonical)
        await self._station.remove_signing(self._station.vehicle(vehicle_name), url)
        self._keys.delete(canonical)


def _signing(stored: StoredKey, pending: StoredKey | None = None) -> LinkSigning:
    return LinkSigning(
        stored.key,
        rejects_unsigned=stored.rejects_unsigned,
        rotated_at=stored.rotated_at,
        pending=None if pending is None else pending.key,
    )
