"""One vehicle's side of the links: where to send to it, and where its messages are heard."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import AbstractAsyncContextManager
from typing import TypeVar

from gcs.core.errors import LinkError
from gcs.mavlink.command_protocol import Target
from gcs.mavlink.dialect import Message
from gcs.mavlink.events import EventStream
from gcs.mavlink.transaction import Clock, Send, Transaction, run

R = TypeVar("R")


class VehicleChannel:
    """Sends to a vehicle, from any thread, and hands out what it says.

    Args:
        target: system and component of its autopilot.
        sender: system and component of this station.
        send: puts a message on the link on which the message's target was last heard; safe from any thread.
        clock: monotonic seconds.
    """

    def __init__(self, target: Target, sender: Target, send: Send, clock: Clock) -> None:
        self.target = target
        self.sender = sender
        self.send = send
        self.clock = clock
        self._heard: EventStream[Message] = EventStream()

    def messages(self) -> AbstractAsyncContextManager[AsyncIterator[Message]]:
        """Hear the vehicle's messages, of all its components, inside a `with` block."""
        return self._heard.read()

    def publish(self, message: Message) -> None:
        """A message of the vehicle was heard."""
        self._heard.publish(message)

    async def run(self, transaction: Transaction[R]) -> R:
        """Drive a transaction to its end.

        Raises:
            GcsError: it failed.
        """
        return await run(transaction, self, self.clock)

    async def until(self, holds: Callable[[], bool], timeout_s: float, what: str) -> None:
        """Wait until something holds, asking after every message and every half second.

        Args:
            holds: may raise to give up.
            timeout_s: how long to wait.
            what: is awaited, for the error.

        Raises:
            LinkError: it did not hold in time.
        """
        give_up_at = self.clock() + timeout_s
        async with self.messages() as messages:
            pending: asyncio.Future[Message] | None = None
            try:
                while not holds():
                    left = give_up_at - self.clock()
                    if left <= 0:
                        raise LinkError(f"waited {timeout_s:g} s in vain for {what}")
                    pending = pending or asyncio.ensure_future(anext(messages))
                    done, _ = await asyncio.wait({pending}, timeout=min(left, 0.5))
                    if done:
                        pending = None
            finally:
                if pending is not None:
                    pending.cancel()
