"""Signing of links: keys made, given to vehicles, proved, kept, and used again at the next start."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gcs.core.errors import GcsError, IncompleteError, NotFoundError
from gcs.mavlink.link_url import parse_link_url
from gcs.mavlink.signing import LinkSigning, new_key
from gcs.storage.signing_keys import StoredKey

if TYPE_CHECKING:
    from gcs.mavlink.signing_setup import SigningProof
    from gcs.mavlink.station import MavlinkStation
    from gcs.storage.signing_keys import SigningKeyStore


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
        return await self._station.open(url, LinkSigning(stored.key, rejects_unsigned=stored.rejects_unsigned))

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
        key = new_key()
        vehicle = self._station.vehicle(vehicle_name)
        proof = await self._station.set_up_signing(vehicle, url, LinkSigning(key, rejects_unsigned=rejects_unsigned))
        try:
            self._keys.put(parse_link_url(url).url, StoredKey(key, rejects_unsigned))
        except GcsError as error:
            words = f"the vehicle has a new key, which is lost when the station ends: {error.message}; set it up again"
            raise IncompleteError(words, field=error.field) from error
        return proof

    async def remove(self, vehicle_name: str, url: str) -> None:
        """Have a disarmed vehicle forget its key, and forget it here.

        Raises:
            NotFoundError: the link has no key.
            RefusedError: the vehicle is armed, or heard elsewhere.
            LinkError: it goes on signing.
        """
        canonical = parse_link_url(url).url
        if self._keys.get(canonical) is None:
            raise NotFoundError("this link is not signed", field=canonical)
        await self._station.remove_signing(self._station.vehicle(vehicle_name), url)
        self._keys.delete(canonical)
