"""Command sequences without an event loop: a coroutine of transactions, driven by messages and by time.

The sequences of `autopilots` and `flight_commands` are coroutines that await transactions. Here a coroutine runs until
its next transaction and then waits, as a transaction itself does, to be told of messages and of passing time; so a
whole flight can be one synchronous state machine, on real or on fake time.
"""

from __future__ import annotations

from collections.abc import Callable, Coroutine, Generator
from typing import Any, TypeVar

from gcs.core.errors import GcsError, LinkError
from gcs.mavlink.dialect import Message
from gcs.mavlink.transaction import Clock, Send, Transaction
from gcs.mavlink.vehicle_channel import VehicleChannel

R = TypeVar("R")
LOOK_S = 0.05
"""What is waited for is looked at this often, and after every message."""


def _ignore(message: Message) -> None:
    """A wait sends nothing."""


class Wait(Transaction[None]):
    """Nothing is sent; it ends when something holds.

    Args:
        holds: may raise to give up.
        timeout_s: how long to wait.
        what: is awaited, for the error.
        clock: monotonic seconds.
    """

    def __init__(self, holds: Callable[[], bool], timeout_s: float, what: str, clock: Clock) -> None:
        super().__init__(_ignore, clock)
        self._holds = holds
        self._timeout_s = timeout_s
        self._give_up_at = clock() + timeout_s
        self._what = what
        self._look_at = clock()

    @property
    def deadline(self) -> float:
        """See Transaction."""
        return min(self._look_at, self._give_up_at)

    def start(self) -> None:
        """See Transaction."""
        self.on_time()

    def handle(self, message: Message) -> None:
        """See Transaction."""
        del message  # whatever it says, what is waited for may hold now
        self.on_time()

    def on_time(self) -> None:
        """See Transaction."""
        now = self._clock()
        self._look_at = now + LOOK_S
        try:
            if self._holds():
                self._succeed(None)
            elif now >= self._give_up_at:
                self._fail(LinkError(f"waited {self._timeout_s:g} s in vain for {self._what}"))
        except GcsError as error:
            self._fail(error)


class _Step:
    """Awaiting it runs a transaction to its end."""

    def __init__(self, transaction: Transaction[Any]) -> None:
        self._transaction = transaction

    def __await__(self) -> Generator[Transaction[Any], None, None]:
        self._transaction.start()
        while not self._transaction.finished:
            yield self._transaction


class SteppedChannel(VehicleChannel):
    """A channel whose exchanges run inside a `SteppedTask` instead of an event loop.

    Args:
        target: system and component of the autopilot.
        sender: system and component of this program.
        send: puts a message on the link.
        clock: monotonic seconds.
    """

    def __init__(self, target: tuple[int, int], sender: tuple[int, int], send: Send, clock: Clock) -> None:
        super().__init__(target, sender, send, clock)

    async def run(self, transaction: Transaction[R]) -> R:
        """See VehicleChannel."""
        await _Step(transaction)
        return transaction.result()

    async def until(self, holds: Callable[[], bool], timeout_s: float, what: str) -> None:
        """See VehicleChannel."""
        await self.run(Wait(holds, timeout_s, what, self.clock))

    async def sleep(self, seconds: float) -> None:
        """Wait."""
        awake_at = self.clock() + seconds
        await self.until(lambda: self.clock() >= awake_at, seconds + 1.0, "the time to pass")


class SteppedTask:
    """A coroutine on a `SteppedChannel`; it begins at once.

    Args:
        work: awaits nothing but the channel's exchanges.

    Attributes:
        error: what it failed of; None while it runs and after success.
        finished: whether it has ended.
    """

    def __init__(self, work: Coroutine[Any, Any, None]) -> None:
        self._work = work
        self._waits_for: Transaction[Any] | None = None
        self._running = False
        self.error: GcsError | None = None
        self.finished = False
        self._go_on()

    @property
    def deadline(self) -> float:
        """Clock time at which `on_time` wants to be called next; infinity after the end."""
        return float("inf") if self._waits_for is None else self._waits_for.deadline

    def handle(self, message: Message) -> None:
        """Take a message."""
        if self._waits_for is not None:
            self._waits_for.handle(message)
            self._go_on()

    def on_time(self) -> None:
        """Called when `deadline` has passed."""
        if self._waits_for is not None:
            self._waits_for.on_time()
            self._go_on()

    def cancel(self) -> None:
        """End it without sending anything more."""
        self._waits_for, self.finished = None, True
        if not self._running:  # one that cancels itself ends at its next step
            self._work.close()

    def _go_on(self) -> None:
        while not self.finished and (self._waits_for is None or self._waits_for.finished):
            self._running = True
            try:
                self._waits_for = self._work.send(None)
            except StopIteration:
                self._waits_for, self.finished = None, True
            except GcsError as error:
                self._waits_for, self.finished, self.error = None, True, error
            finally:
                self._running = False
        if self.finished:
            self._waits_for = None
            self._work.close()
