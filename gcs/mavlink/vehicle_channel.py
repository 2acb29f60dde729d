"""One vehicle's side of the links: where to send to it, and where its messages are heard."""

from __future__ import annotations

import asyncio
import contextlib
from collections import deque
from collections.abc import AsyncIterator, Callable, Iterator
from typing import Any, TypeVar

from gcs.core.errors import LinkError, RefusedError
from gcs.mavlink.command_protocol import Target
from gcs.mavlink.dialect import Message
from gcs.mavlink.events import MAX_WAITING, EventStream
from gcs.mavlink.link_base import Peer
from gcs.mavlink.transaction import Clock, Send, Transaction

R = TypeVar("R")


class _Exchange:
    """A transaction under way."""

    def __init__(self, transaction: Transaction[Any], clock: Clock) -> None:
        self._transaction = transaction
        self._clock = clock
        self._wake = asyncio.Event()
        self._sleeps_until = float("inf")
        self._heard: deque[Message] = deque(maxlen=MAX_WAITING)
        self._loop = asyncio.get_running_loop()
        self._failure: Exception | None = None

    def hear(self, message: Message) -> None:
        """Let the transaction take a message, as soon as whoever tells of it is done."""
        self._heard.append(message)
        if len(self._heard) == 1:
            self._loop.call_soon(self._step, None)

    async def over(self) -> None:
        """Begin, and call the transaction when its time has come, until it is finished."""
        transaction = self._transaction
        self._step(transaction.start)
        while not transaction.finished:
            if self._failure is not None:
                raise self._failure
            self._wake.clear()
            self._sleeps_until = transaction.deadline
            wait_s = self._sleeps_until - self._clock()
            if wait_s > 0:
                with contextlib.suppress(TimeoutError):
                    async with asyncio.timeout(wait_s):
                        await self._wake.wait()
            else:
                await asyncio.sleep(0)  # what has come in meanwhile is heard first
                if not transaction.finished and transaction.deadline <= self._clock():
                    self._step(transaction.on_time)

    def _step(self, action: Callable[[], None] | None) -> None:
        """Do something, and take what was heard."""
        transaction = self._transaction
        try:
            if action is not None:
                action()
            while self._heard:
                message = self._heard.popleft()
                if not transaction.finished:
                    transaction.handle(message)
        except Exception as failure:  # whoever waits for the transaction gets it
            self._failure = failure
        if self._failure is not None or transaction.finished or transaction.deadline < self._sleeps_until:
            self._wake.set()


class VehicleChannel:
    """Sends to a vehicle, from any thread, and hands out what it says.

    Args:
        target: system and component of its autopilot.
        sender: system and component of this station.
        send: puts a message on the link on which the message's target was last heard; safe from any thread.
        clock: monotonic seconds.
        peer: tells whom messages to the autopilot go to now, None when there is no way to it; safe from any thread.
    """

    __slots__ = ("_listeners", "clock", "peer", "refusal", "send", "sender", "target")

    def __init__(
        self,
        target: Target,
        sender: Target,
        send: Send,
        clock: Clock,
        peer: Callable[[], Peer | None] = lambda: None,
    ) -> None:
        self.target = target
        self.sender = sender
        self.send = send
        self.clock = clock
        self.peer = peer
        self.refusal: str | None = None
        """Why no exchange with the vehicle may begin; None when one may."""
        self._listeners: tuple[Callable[[Message], None], ...] = ()

    @contextlib.asynccontextmanager
    async def messages(self) -> AsyncIterator[AsyncIterator[Message]]:
        """Hear the vehicle's messages, of all its components, inside an `async with` block."""
        stream: EventStream[Message] = EventStream()
        with self._told(stream.publish):
            async with stream.read() as messages:
                yield messages

    def publish(self, message: Message) -> None:
        """A message of the vehicle was heard."""
        for listener in self._listeners:
            listener(message)

    @contextlib.contextmanager
    def _told(self, listener: Callable[[Message], None]) -> Iterator[None]:
        """Tell a listener of every message inside a `with` block."""
        self._listeners += (listener,)
        try:
            yield
        finally:
            self._listeners = tuple(each for each in self._listeners if each is not listener)

    def check(self) -> None:
        """Refuse an exchange that may not begin.

        Raises:
            RefusedError: says why.
        """
        if self.refusal is not None:
            raise RefusedError(self.refusal)

    async def run(self, transaction: Transaction[R]) -> R:
        """Drive a transaction to its end.

        It takes messages as they are heard, and a task is woken only when it is over or wants to be called earlier: a
        hundred vehicles that are asked at once must not wake a hundred tasks with each of their messages.

        Raises:
            RefusedError: no exchange may begin.
            GcsError: it failed.
        """
        self.check()
        exchange = _Exchange(transaction, self.clock)
        with self._told(exchange.hear):
            try:
                await exchange.over()
            except asyncio.CancelledError:
                transaction.cancel()
                raise
        return transaction.result()

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
