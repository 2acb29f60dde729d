"""PLAN_ANNOUNCE: a vehicle is told the hash of the plan that it is about to fly."""

from __future__ import annotations

from gcs.core.errors import OperationCancelled
from gcs.mavlink.dialect import Message
from gcs.mavlink.transaction import Clock, Send, Transaction
from gcs.mavlink.tunnel_carrier import carried, replanning, tunnelled


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
        message = replanning.MAVLink_plan_announce_message(list(self._hash))
        self._send(tunnelled(message, self._target_system, 0))
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
