"""A second key of a link is a rotation, and is told as one, also after a restart."""

from types import SimpleNamespace

from gcs.mavlink.signing_setup import SigningProof
from gcs.services.link_signing import LinkSigningService
from gcs.storage.signing_keys import SigningKeyStore

URL = "udpin:127.0.0.1:14550"


class TrustingStation:
    """Takes every key."""

    def __init__(self):
        self.signing = None

    def vehicle(self, name):
        return SimpleNamespace(name=name)

    async def set_up_signing(self, vehicle, url, signing, keep):
        keep()
        self.signing = signing
        return SigningProof(3, 0)

    async def open(self, url, signing=None):
        self.signing = signing
        return url


async def test_the_first_key_is_no_rotation_and_the_second_is(tmp_path):
    station, keys = TrustingStation(), SigningKeyStore(tmp_path, "correct horse")
    service = LinkSigningService(station, keys)
    await service.set_up("px4-1", URL)
    first = station.signing.key
    assert station.signing.status().rotated_at is None
    await service.set_up("px4-1", URL)
    rotated_at = station.signing.status().rotated_at
    assert rotated_at is not None
    assert station.signing.key != first
    again = TrustingStation()
    await LinkSigningService(again, keys).open(URL)
    assert (again.signing.key, again.signing.status().rotated_at) == (station.signing.key, rotated_at)
