"""Protocol transactions as state machines without I/O, and the one loop that drives them.

A transaction (an upload, a command, a file read) never sleeps and never reads a socket: it is told of messages and of
passing time, sends through a function that was injected, and says when it next wants to be called. Tests drive it on
fake time; `run` drives it on a real link.
"""

from __future__ import annotations

import asyncio
from abc import ABC, abstractmethod
from collections.abc import AsyncIterator, Callable
from contextlib import AbstractAsyncContextManager
from typing import Generic, Protocol, TypeVar

from gcs.core.errors import LinkError
from gcs.mavlink.dialect import Message

R = TypeVar("R")
Send = Callable[[Message], None]
Clock = Callable[[], float]
"""Monotonic seconds."""


class Transaction(ABC, Generic[R]):
    """One exchange with one vehicle.

    Args:
        send: puts a message on the link; it may be lost.
        clock: monotonic seconds.
    """

    def __init__(self, send: Send, clock: Clock) -> None:
        self._send = send
        self._clock = clock
        self._result: R | None = None
        self._error: Exception | None = None
        self._finished = False

    @abstractmethod
    def start(self) -> None:
        """Send the first message."""

    @abstractmethod
    def handle(self, message: Message) -> None:
        """Take a message of the vehicle; those of no concern are ignored."""

    @abstractmethod
    def on_time(self) -> None:
        """Called when `deadline` has passed: resend, or give up."""

    @property
    @abstractmethod
    def deadline(self) -> float:
        """Clock time at which `on_time` wants to be called next."""

    def cancel(self) -> None:
        """Stop as cleanly as the protocol allows; by default nothing is sent."""

    @property
    def finished(self) -> bool:
        """Whether there is a result or an error."""
        return self._finished

    def result(self) -> R:
        """The result of a finished transaction.

        Raises:
            GcsError: what went wrong.
        """
        if not self._finished:
            raise RuntimeError("the transaction is still running")
        if self._error is not None:
            raise self._error
        return self._result  # type: ignore[return-value]  # a finished transaction without an error has one

    def _succeed(self, result: R) -> None:
        if not self._finished:
            self._result, self._finished = result, True

    def _fail(self, error: Exception) -> None:
        if not self._finished:
            self._error, self._finished = error, True


class MessageSource(Protocol):
    """Where a running transaction hears its vehicle."""

    def messages(self) -> AbstractAsyncContextManager[AsyncIterator[Message]]:
        """Subscribe to the vehicle's messages for the time of a `with` block."""
        ...


async def run(transaction: Transaction[R], source: MessageSource, clock: Clock) -> R:
    """Drive a transaction to its end over a real link.

    Raises:
        GcsError: the transaction failed.
        asyncio.CancelledError: the task was cancelled; the transaction was told.
    """
    async with source.messages() as messages:
        transaction.start()
        pending: asyncio.Task[Message] | None = None
        try:
            while not transaction.finished:
                if pending is None:
                    pending = asyncio.ensure_future(anext(messages))
                wait_s = max(0.0, transaction.deadline - clock())
                done, _ = await asyncio.wait({pending}, timeout=wait_s)
                if not done:
                    transaction.on_time()
                    continue
                try:
                    message = pending.result()
                except StopAsyncIteration:
                    raise LinkError("the link was closed") from None
                pending = None
                transaction.handle(message)
        except asyncio.CancelledError:
            transaction.cancel()
            raise
        finally:
            if pending is not None:
                pending.cancel()
        return transaction.result()
