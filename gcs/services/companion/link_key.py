"""Signing of the companion's link: where its key is from, its time stamps over restarts, and what goes wrong."""

from __future__ import annotations

import asyncio
import logging
from typing import TYPE_CHECKING

from gcs.core.errors import StorageError
from gcs.mavlink.link_url import parse_link_url
from gcs.mavlink.signing import TICKS_PER_S, LinkSigning
from gcs.services.link_signing import key_store
from gcs.storage.key_files import read_key_file
from gcs.storage.signing_stamps import SigningStamps

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

log = logging.getLogger(__name__)

FILE = "signing_stamp"
CLAIMED_S = 20
LOOK_S = 1.0
KEY_WANTED = "the autopilot signs its packets: give the link's key with --key-file, or with `gcs signing share`"


def link_signing(url: str, key_file: Path | None, data_dir: Path | None, directory: Path) -> CompanionSigning | None:
    """What signs the link; None when it has no key.

    Args:
        url: of the link.
        key_file: holds the key; when not given, it is that which the data directory has for this link, if any.
        data_dir: see `key_store`.
        directory: keeps the time stamp.

    Raises:
        InputError: the file holds no key; or keys are stored, and the passphrase is missing or wrong.
        StorageError: the time stamp cannot be kept.
    """
    key, rejects_unsigned = None, True
    if key_file is not None:
        key = read_key_file(key_file)
    else:
        stored = key_store(data_dir).get(parse_link_url(url).url)
        if stored is not None:
            key, rejects_unsigned = stored.key, stored.rejects_unsigned
    if key is None:
        return None
    return CompanionSigning(key, SigningStamps(directory / FILE, CLAIMED_S * TICKS_PER_S), rejects_unsigned)


class CompanionSigning:
    """One key for the link, however often that is opened.

    Args:
        key: 32 bytes.
        stamps: over restarts.
        rejects_unsigned: whether packets without a signature are refused.

    Attributes:
        signing: for the link.

    Raises:
        StorageError: the time stamp cannot be kept.
    """

    def __init__(self, key: bytes, stamps: SigningStamps, rejects_unsigned: bool = True) -> None:
        self.signing = LinkSigning(key, rejects_unsigned=rejects_unsigned, newest=stamps.read())
        self._stamps = stamps
        self._said: set[str] = set()
        stamps.claim(self.signing.timestamp())

    async def watch(self, say: Callable[[str], None]) -> None:
        """Claim time stamps, and say each problem once, until it is cancelled."""
        try:
            while True:
                problem = self.signing.status().problem
                if problem is not None and problem not in self._said:
                    self._said.add(problem)
                    say(f"signing: {problem}")
                if self._stamps.needs_claim(self.signing.newest):
                    await asyncio.to_thread(self._keep, self._stamps.claim)
                await asyncio.sleep(LOOK_S)
        finally:
            self._keep(self._stamps.give_back)

    def _keep(self, how: Callable[[int], None]) -> None:
        try:
            how(self.signing.newest)
        except StorageError as error:
            log.warning("after a restart signatures may be taken for repeated ones: %s", error)
