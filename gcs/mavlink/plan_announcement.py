"""PLAN_ANNOUNCE: a vehicle is told the hash of the plan that it is about to fly, and its companion whether it can."""

from __future__ import annotations

from collections.abc import Callable

from gcs.core.errors import LinkError, OperationCancelled, RefusedError
from gcs.mavlink.command_protocol import Target
from gcs.mavlink.companion_lease import COMPANION, PREPARING_S, UNHEARD_S
from gcs.mavlink.dialect import Message
from gcs.mavlink.transaction import Clock, Send, Transaction
from gcs.mavlink.tunnel_carrier import carried, replanning, text_of, tunnelled

RESEND_S = 1.0
TEXT_BYTES = 90


def announced_plan(message: Message) -> str | None:
    """The hash of the plan that a TUNNEL announces, 64 hex digits; None when it is something else."""
    inner = carried(message)
    return bytes(inner.plan_hash).hex() if inner is not None and inner.get_type() == "PLAN_ANNOUNCE" else None


def plan_ready_message(plan_hash: str) -> Message:
    """The TUNNEL by which a companion says that it holds a plan, and could fly it now."""
    return tunnelled(replanning.MAVLink_plan_announce_ack_message(list(bytes.fromhex(plan_hash))), 0, 0)


def plan_not_ready_message(plan_hash: str, text: str, *, refused: bool) -> Message:
    """The TUNNEL by which a companion says that it could not fly a plan, for good (`refused`) or not yet."""
    words = text.encode("ascii", "replace")[:TEXT_BYTES]
    inner = replanning.MAVLink_plan_not_ready_message(list(bytes.fromhex(plan_hash)), int(refused), words)
    return tunnelled(inner, 0, 0)


def _announcement(plan_hash: str, target: Target) -> Message:
    return tunnelled(replanning.MAVLink_plan_announce_message(list(bytes.fromhex(plan_hash))), *target)


class PlanAnnouncement(Transaction[bool]):
    """Tell a vehicle the hash of the plan that it is about to fly.

    Ends with True when one of its components acknowledged it, with False when none did five times: most vehicles know
    no replanning, and fly all the same.

    Args:
        plan_hash: SHA-256 of plan.json, 64 hex digits.
        target_system: system id of the vehicle.
        send: puts a message on the link.
        clock: monotonic seconds.
        retry_s: pause between two tries.
        tries: how often it is sent.
    """

    def __init__(
        self, plan_hash: str, target_system: int, send: Send, clock: Clock, *, retry_s: float = 1.0, tries: int = 5
    ) -> None:
        super().__init__(send, clock)
        self._hash = bytes.fromhex(plan_hash)
        if len(self._hash) != 32:
            raise ValueError("a plan hash has 64 hex digits")
        self._target_system = target_system
        self._retry_s = retry_s
        self._left = tries
        self._deadline = clock()

    @property
    def deadline(self) -> float:
        """Clock time at which `on_time` wants to be called next."""
        return self._deadline

    def start(self) -> None:
        """Send it."""
        self._left -= 1
        self._send(_announcement(self._hash.hex(), (self._target_system, 0)))
        self._deadline = self._clock() + self._retry_s

    def handle(self, message: Message) -> None:
        """Take the acknowledgement, if it is of this plan."""
        if self.finished or message.get_srcSystem() != self._target_system:
            return
        answer = carried(message)
        if answer is None or answer.get_type() != "PLAN_ANNOUNCE_ACK":
            return
        if bytes(answer.plan_hash) == self._hash:
            self._succeed(True)

    def on_time(self) -> None:
        """Send it again, or go on without."""
        if self.finished:
            return
        if self._left <= 0:
            self._succeed(False)
        else:
            self.start()

    def cancel(self) -> None:
        """Stop asking."""
        self._fail(OperationCancelled("announcing the plan was cancelled"))


class CompanionAnnouncement(Transaction[None]):
    """Announce a plan to a vehicle's companion until that holds it, ready to be flown; so nothing takes off in vain.

    Args:
        plan_hash: SHA-256 of plan.json, 64 hex digits.
        system_id: of the vehicle.
        send: puts a message on the link.
        clock: monotonic seconds.
        tell: takes what the companion says while it prepares the plan, each text once.

    Raises:
        LinkError: there is no companion, or it does not come to an end with its preparations.
        RefusedError: it cannot fly the plan, in its own words.
    """

    def __init__(self, plan_hash: str, system_id: int, send: Send, clock: Clock, tell: Callable[[str], None]) -> None:
        super().__init__(send, clock)
        self._plan_hash = plan_hash
        self._target: Target = (system_id, COMPANION)
        self._tell = tell
        self._is_heard = False
        self._text = ""
        self._resend_at = clock()
        self._give_up_at = clock() + UNHEARD_S
        self._preparing_until = clock() + PREPARING_S

    @property
    def deadline(self) -> float:
        """See Transaction."""
        return min(self._resend_at, self._give_up_at)

    def start(self) -> None:
        """See Transaction."""
        self._send(_announcement(self._plan_hash, self._target))
        self._resend_at = self._clock() + RESEND_S

    def handle(self, message: Message) -> None:
        """See Transaction."""
        if (message.get_srcSystem(), message.get_srcComponent()) != self._target:
            return
        self._is_heard = True
        inner = carried(message)
        if inner is None or inner.get_type() not in {"PLAN_ANNOUNCE_ACK", "PLAN_NOT_READY"}:
            return
        if bytes(inner.plan_hash).hex() != self._plan_hash:
            return
        if inner.get_type() == "PLAN_ANNOUNCE_ACK":
            self._succeed(None)
            return
        text = text_of(inner.text)
        if inner.state != replanning.PLAN_NOT_READY_PREPARING:
            why = f"the companion cannot fly this plan: {text}"
            self._fail(RefusedError(f"{why}; nothing is armed, mend that and start again"))
            return
        if text != self._text:
            self._tell(f"companion: {text}")
        self._text = text
        self._give_up_at = min(self._clock() + UNHEARD_S, self._preparing_until)

    def on_time(self) -> None:
        """See Transaction."""
        if self._clock() < self._give_up_at:
            self.start()
        elif self._text:
            self._fail(LinkError(f"the companion does not come to hold the plan; it last said: {self._text}"))
        elif self._is_heard:
            self._fail(LinkError("the companion is heard, but says nothing of the plan: restart `gcs companion`"))
        else:
            self._fail(LinkError("no companion is heard: start `gcs companion` beside the autopilot"))

    def cancel(self) -> None:
        """See Transaction."""
        self._fail(OperationCancelled("announcing the plan to the companion was cancelled"))
