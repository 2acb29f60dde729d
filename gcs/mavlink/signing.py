"""MAVLink 2 signing of one link: every packet that goes out is signed, and every one that comes in is judged.

A signature is the first 48 bits of SHA-256 over the key and the packet, with a time stamp (10 us since 2015) that must
grow from packet to packet of each sender, so that an old packet cannot be sent again.
"""

from __future__ import annotations

import hashlib
import hmac
import secrets
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

import fastcrc

from gcs.mavlink.dialect import mavlink
from gcs.mavlink.received_message import CHECKSUM, CHECKSUM_EXTRAS, HEADER_V2, SIGNATURE, SIGNED, ReceivedMessage

KEY_BYTES = 32
EPOCH_S = 1_420_070_400
"""1 January 2015 (UTC), from which signatures count time."""
TICKS_PER_S = 100_000
NEW_STREAM_S = 60
"""A sender's first packet may be so much older than ours; the standard's one minute."""
_DIGEST = 6
_UNSIGNED_ALLOWED = frozenset({int(mavlink.MAVLINK_MSG_ID_RADIO_STATUS)})
"""A telemetry radio puts these in between, and has no key; the standard lets them pass."""


class Verdict(Enum):
    """What a packet is taken for."""

    GOOD = "signed with our key"
    UNSIGNED = "not signed"
    WRONG_KEY = "signed with another key"
    REPEATED = "no newer than one that was heard before"
    PAST = "signed with a clock in the past"


PROBLEMS = {
    Verdict.UNSIGNED: "unsigned packets come in and are refused: set the vehicle up to sign, or check who sends them",
    Verdict.WRONG_KEY: "packets are signed with another key: set signing up on the vehicle anew, over a link you trust",
    Verdict.REPEATED: "signed packets are repeated and refused: somebody may be sending recorded ones",
    Verdict.PAST: "packets are signed with a clock in the past and refused, until their sender has taken over our time",
}


@dataclass(frozen=True)
class SigningStatus:
    """How signing of a link goes, for people.

    Attributes:
        rejects_unsigned: whether packets without a signature are refused.
        counts: packets by what they were taken for.
        problem: what went wrong lately and what to do; None when nothing did.
        rotated_at: when the key took the place of an older one, UTC ISO 8601; None while it is the first.
    """

    rejects_unsigned: bool
    counts: dict[Verdict, int]
    problem: str | None
    rotated_at: str | None = None


def new_key() -> bytes:
    """A random key."""
    return secrets.token_bytes(KEY_BYTES)


class LinkSigning:
    """Signs and judges with one key; signing is safe from any thread.

    Args:
        key: 32 bytes that the other end has too.
        rejects_unsigned: whether packets without a signature are refused.
        wall: seconds since 1970.
        rotated_at: when the key took the place of an older one; None while it is the first.
        newest: no time stamp is at or before this one, whatever the clock says.
        pending: another key that the other end may hold; the first packet that is signed with it shows that it does,
            and it takes the place of `key` for good: recordings of what the old one signed bring nothing back.
    """

    PROBLEM_KEPT_S = 10.0

    def __init__(
        self,
        key: bytes,
        *,
        rejects_unsigned: bool = True,
        wall: Callable[[], float] = time.time,
        rotated_at: str | None = None,
        newest: int = 0,
        pending: bytes | None = None,
    ) -> None:
        self.rejects_unsigned = rejects_unsigned
        self.rotated_at = rotated_at
        self.pending = pending
        self._key = key
        self._wall = wall
        self._lock = threading.Lock()
        self._newest = newest
        self._streams: dict[bytes, int] = {}
        self._good = 0
        self._others: dict[Verdict, int] = {verdict: 0 for verdict in Verdict if verdict is not Verdict.GOOD}
        self._problem: tuple[Verdict, float] | None = None

    @property
    def key(self) -> bytes:
        """Its key."""
        return self._key

    @property
    def newest(self) -> int:
        """The latest time stamp that was sent or heard."""
        return self._newest

    def status(self) -> SigningStatus:
        """How it goes."""
        problem = self._problem
        lately = problem is not None and abs(self._wall() - problem[1]) < self.PROBLEM_KEPT_S
        said = PROBLEMS[problem[0]] if problem is not None and lately else None
        return SigningStatus(self.rejects_unsigned, {Verdict.GOOD: self._good, **self._others}, said, self.rotated_at)

    def timestamp(self) -> int:
        """The time stamp of the next signature: now, but later than any that was sent or heard."""
        with self._lock:
            self._newest = max(self._newest + 1, int((self._wall() - EPOCH_S) * TICKS_PER_S))
            return self._newest

    def sign(self, frame: bytes, link_id: int = 0) -> bytes:
        """A MAVLink 2 packet, signed."""
        return signed(frame, self._key, self.timestamp(), link_id)

    def admits(self, message: ReceivedMessage) -> bool:
        """Whether a message may be taken; counts it."""
        verdict = self.judge(message)
        if verdict is Verdict.GOOD:
            self._good += 1
            return True
        self._others[verdict] += 1
        if verdict is Verdict.UNSIGNED and self._lets_pass(message):
            return True
        self._problem = (verdict, self._wall())
        return False

    def judge(self, message: ReceivedMessage) -> Verdict:
        """What a message is taken for; one that is good makes all older ones of its sender bad."""
        if not message.is_signed:
            return Verdict.UNSIGNED
        packet = message.packet
        if not _is_signed_with(self._key, packet):
            if self.pending is None or not _is_signed_with(self.pending, packet):
                return Verdict.WRONG_KEY
            self._key, self.pending = self.pending, None
        stamp = int.from_bytes(packet[-12:-_DIGEST], "little")
        stream = packet[-SIGNATURE:-12] + packet[5:7]  # link id of the sender, system and component id
        newest = self._streams.get(stream)
        if newest is None:
            now = max(self._newest, int((self._wall() - EPOCH_S) * TICKS_PER_S))
            if stamp + NEW_STREAM_S * TICKS_PER_S < now:
                return Verdict.PAST
        elif stamp <= newest:
            return Verdict.REPEATED
        self._streams[stream] = stamp
        if stamp > self._newest:
            with self._lock:
                self._newest = max(self._newest, stamp)
        return Verdict.GOOD

    def _lets_pass(self, message: ReceivedMessage) -> bool:
        return not self.rejects_unsigned or message.message_number in _UNSIGNED_ALLOWED


def _is_signed_with(key: bytes, packet: bytes) -> bool:
    return hmac.compare_digest(hashlib.sha256(key + packet[:-_DIGEST]).digest()[:_DIGEST], packet[-_DIGEST:])


def signed(frame: bytes, key: bytes, timestamp: int, link_id: int = 0) -> bytes:
    """A MAVLink 2 packet with a signature.

    Args:
        frame: the unsigned packet.
        key: 32 bytes.
        timestamp: in 10 us since 2015.
        link_id: of the sender's link, 0 to 255.
    """
    number = int.from_bytes(frame[7:HEADER_V2], "little")
    body = frame[1:2] + bytes([frame[2] | SIGNED]) + frame[3:-CHECKSUM]
    checksum = int(fastcrc.crc16.mcrf4xx(body + CHECKSUM_EXTRAS[number]))
    packet = frame[:1] + body + checksum.to_bytes(2, "little") + bytes([link_id]) + timestamp.to_bytes(6, "little")
    return packet + hashlib.sha256(key + packet).digest()[:_DIGEST]
