"""Giving a vehicle a key, and the proof that it took it, and goes by it on a link.

SETUP_SIGNING has no acknowledgement, and there are vehicles that take a key and go on answering everybody. So the proof
is a test: questions (TIMESYNC, each with a stamp of its own) that are signed must be answered, and questions that are
not must stay unanswered.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass

from gcs.core.errors import ConflictError, LinkError, RefusedError
from gcs.mavlink.dialect import Message, mavlink
from gcs.mavlink.link_base import Link, Peer
from gcs.mavlink.signing import KEY_BYTES, LinkSigning
from gcs.mavlink.transaction import Clock, Transaction, run
from gcs.mavlink.vehicle_state import VehicleState

TELL_S = 0.5
TELL_TRIES = 12
ROUND_S = 0.3
ROUNDS = 8
LAST_ANSWER_S = 1.0
FRESH_S = 3.0
NOT_SIGNED = "this link is not signed; one that has a key is signed when it is opened anew"
NOT_SHOWN = (
    "nothing shows that it took the new key: it may not support signing, hold another key, or hold the new one and its "
    "answers were lost; the new key is kept: set signing up again, which gives it the same key"
)
NO_KEY = bytes(KEY_BYTES)
"""With it SETUP_SIGNING switches signing off."""


@dataclass(frozen=True)
class SigningProof:
    """What came of the questions.

    Attributes:
        signed_answers: to questions that were signed.
        unsigned_answers: to questions that were not.
    """

    signed_answers: int
    unsigned_answers: int

    @property
    def proved(self) -> bool:
        """Whether the vehicle has the key, and answers nobody without it."""
        return self.signed_answers > 0 and self.unsigned_answers == 0

    @property
    def words(self) -> str:
        """For people."""
        if self.proved:
            return "proved: it answers signed packets, and none that are not signed"
        return "not enforced: it has the key, but answers unsigned packets too (ArduPilot always does so on USB)"


class SigningProbe(Transaction[SigningProof]):
    """Tells the key until a signed question is answered, then asks in turns with and without a signature.

    Args:
        vehicle_id: system and component id of the autopilot.
        tell: sends SETUP_SIGNING, or does nothing where the vehicle has the key already.
        ask_signed: sends a message, signed with the key in question.
        ask_unsigned: sends a message as a stranger would.
        clock: monotonic seconds.
    """

    def __init__(
        self,
        vehicle_id: tuple[int, int],
        *,
        tell: Callable[[], None],
        ask_signed: Callable[[Message], object],
        ask_unsigned: Callable[[Message], None],
        clock: Clock,
    ) -> None:
        super().__init__(ask_unsigned, clock)
        self._vehicle_id = vehicle_id
        self._tell = tell
        self._ask_signed = ask_signed
        self._stamp = int(clock() * 1e9)
        self._asked: dict[int, bool] = {}
        self._answers = {True: 0, False: 0}
        self._told = self._rounds = 0
        self._deadline = 0.0

    @property
    def deadline(self) -> float:
        """See Transaction."""
        return self._deadline

    def start(self) -> None:
        """See Transaction."""
        self._tell_and_ask()

    def handle(self, message: Message) -> None:
        """See Transaction."""
        if message.get_type() != "TIMESYNC" or message.tc1 == 0:
            return
        if (message.get_srcSystem(), message.get_srcComponent()) != self._vehicle_id:
            return
        was_signed = self._asked.pop(int(message.ts1), None)
        if was_signed is None or (was_signed and not message.is_signed):
            return
        self._answers[was_signed] += 1
        if was_signed and self._rounds == 0:
            self._ask_both()

    def on_time(self) -> None:
        """See Transaction."""
        if self._rounds == 0:
            if self._told < TELL_TRIES:
                self._tell_and_ask()
            else:
                self._finish()
        elif self._rounds < ROUNDS:
            self._ask_both()
        else:
            self._finish()

    def _finish(self) -> None:
        self._succeed(SigningProof(self._answers[True], self._answers[False]))

    def _tell_and_ask(self) -> None:
        self._tell()
        self._told += 1
        self._ask(signed=True)
        self._deadline = self._clock() + TELL_S

    def _ask_both(self) -> None:
        self._ask(signed=False)
        self._ask(signed=True)
        self._rounds += 1
        self._deadline = self._clock() + (ROUND_S if self._rounds < ROUNDS else LAST_ANSWER_S)

    def _ask(self, *, signed: bool) -> None:
        self._stamp += 1
        self._asked[self._stamp] = signed
        (self._ask_signed if signed else self._send)(mavlink.MAVLink_timesync_message(0, self._stamp))


async def set_up_signing(
    vehicle: VehicleState, link: Link, peer: Peer, signing: LinkSigning, clock: Clock, keep: Callable[[], None]
) -> SigningProof:
    """Give a vehicle the key of `signing`, prove it, and have the link signed with it from then on.

    The key goes over the link as plain text (or signed with the link's old key, which hides nothing either).

    Args:
        vehicle: must be disarmed.
        link: on which it is heard; as it was when this fails.
        peer: of the link, behind which the vehicle is.
        signing: what the link is to be signed with.
        clock: monotonic seconds.
        keep: keeps the key before it is sent: from then on the vehicle may hold it, whatever is heard of that.

    Raises:
        RefusedError: the vehicle is or may be armed; nothing was sent.
        LinkError: nothing shows that the vehicle took the key.
    """
    _must_be_disarmed(vehicle, clock())
    keep()
    old = link.signing

    def tell() -> None:
        link.signing = old
        setup = mavlink.MAVLink_setup_signing_message(*who, list(signing.key), signing.timestamp())
        peer.send(setup)
        link.signing = signing

    who = (vehicle.identity.system_id, vehicle.identity.component_id)
    taken = False
    try:
        proof = await _probed(vehicle, peer, signing, tell, clock)
        taken = proof.signed_answers > 0
    finally:
        if not taken:
            link.signing = old
            if old is not None:
                old.pending = signing.key
    if not taken:
        raise LinkError(NOT_SHOWN, field=vehicle.identity.name)
    return proof


async def prove_signing(vehicle: VehicleState, link: Link, peer: Peer, clock: Clock) -> SigningProof:
    """See whether a vehicle goes by the key of a signed link there, as it does where the key was given to it.

    Raises:
        ConflictError: the link is not signed.
        RefusedError: the vehicle is or may be armed, or answers nothing that is signed with this key.
        LinkError: the vehicle does not answer.
    """
    _must_be_disarmed(vehicle, clock())
    if link.signing is None:
        raise ConflictError(NOT_SIGNED, field=link.url)
    proof = await _probed(vehicle, peer, link.signing, lambda: None, clock)
    if proof.signed_answers == 0:
        raise RefusedError("it answers nothing that is signed with this link's key", field=vehicle.identity.name)
    return proof


async def _probed(
    vehicle: VehicleState, peer: Peer, signing: LinkSigning, tell: Callable[[], None], clock: Clock
) -> SigningProof:
    """The proof; for its time unsigned answers are let in, as they are what it looks for."""
    who = (vehicle.identity.system_id, vehicle.identity.component_id)
    rejects, signing.rejects_unsigned = signing.rejects_unsigned, False
    try:
        probe = SigningProbe(who, tell=tell, ask_signed=peer.send, ask_unsigned=peer.send_unsigned, clock=clock)
        return await run(probe, vehicle, clock)
    finally:
        signing.rejects_unsigned = rejects


async def remove_signing(vehicle: VehicleState, link: Link, peer: Peer, clock: Clock) -> None:
    """Have a vehicle forget its key and answer everybody again.

    Raises:
        ConflictError: the link is not signed, so that the vehicle would not obey.
        RefusedError: the vehicle is or may be armed.
        LinkError: it goes on signing; the link is signed as before.
    """
    _must_be_disarmed(vehicle, clock())
    old = link.signing
    if old is None:
        raise ConflictError(NOT_SIGNED, field=link.url)
    who = (vehicle.identity.system_id, vehicle.identity.component_id)
    rejects, old.rejects_unsigned = old.rejects_unsigned, False
    try:
        async with vehicle.messages() as messages:
            for _ in range(TELL_TRIES):
                peer.send(mavlink.MAVLink_setup_signing_message(*who, list(NO_KEY), 0))
                if await _unsigned_within(messages, TELL_S):
                    link.signing = None
                    return
    finally:
        old.rejects_unsigned = rejects
    raise LinkError("it goes on signing; the link is signed as before", field=vehicle.identity.name)


async def _unsigned_within(messages: AsyncIterator[Message], seconds: float) -> bool:
    try:
        async with asyncio.timeout(seconds):
            async for message in messages:
                if not message.is_signed:
                    return True
    except TimeoutError:
        pass
    return False


def _must_be_disarmed(vehicle: VehicleState, now_s: float) -> None:
    armed = vehicle.telemetry.armed
    if armed is None or armed.value or armed.age_s(now_s) > FRESH_S:
        words = "signing is set up on a vehicle that is disarmed and heard; this one is or may be armed"
        raise RefusedError(words, field=vehicle.identity.name)
