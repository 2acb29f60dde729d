"""The loop that drives transactions: messages, deadlines, the end of the link and cancellation."""

import asyncio
import time
from contextlib import asynccontextmanager

import pytest

from gcs.core.errors import LinkError, RefusedError
from gcs.mavlink.transaction import Transaction, run


class Echo(Transaction[str]):
    """Sends `ask` until somebody says `yes` or `no`; gives up after three resends."""

    def __init__(self, send, clock, timeout_s=0.01):
        super().__init__(send, clock)
        self._timeout_s = timeout_s
        self._left = 3
        self._next = 0.0
        self.cancelled = False

    def start(self):
        self._send("ask")
        self._next = self._clock() + self._timeout_s

    def handle(self, message):
        if message == "yes":
            self._succeed("granted")
        elif message == "no":
            self._fail(RefusedError("it said no"))

    def on_time(self):
        self._left -= 1
        if self._left == 0:
            self._fail(LinkError("nobody answered"))
        self.start()

    def cancel(self):
        self.cancelled = True

    @property
    def deadline(self):
        return self._next


class Line:
    """A queue of messages as a source; None ends it."""

    def __init__(self):
        self.queue = asyncio.Queue()

    @asynccontextmanager
    async def messages(self):
        async def stream():
            while (message := await self.queue.get()) is not None:
                yield message

        yield stream()


async def test_the_answer_ends_it():
    sent, line = [], Line()
    for message in ("noise", "yes", "no"):
        line.queue.put_nowait(message)
    assert await run(Echo(sent.append, time.monotonic, 10.0), line, time.monotonic) == "granted"
    assert sent == ["ask"]


async def test_a_refusal_is_raised():
    line = Line()
    line.queue.put_nowait("no")
    with pytest.raises(RefusedError, match="it said no"):
        await run(Echo(lambda _: None, time.monotonic, 10.0), line, time.monotonic)


async def test_silence_is_resent_and_given_up():
    sent = []
    with pytest.raises(LinkError, match="nobody answered"):
        await run(Echo(sent.append, time.monotonic), Line(), time.monotonic)
    assert sent.count("ask") == 4


async def test_the_end_of_the_link_is_said():
    line = Line()
    line.queue.put_nowait(None)
    with pytest.raises(LinkError, match="closed"):
        await run(Echo(lambda _: None, time.monotonic, 10.0), line, time.monotonic)


async def test_cancelling_tells_the_transaction():
    echo = Echo(lambda _: None, time.monotonic, 10.0)
    task = asyncio.create_task(run(echo, Line(), time.monotonic))
    await asyncio.sleep(0.01)
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task
    assert echo.cancelled


def test_a_running_transaction_has_no_result():
    with pytest.raises(RuntimeError, match="still running"):
        Echo(lambda _: None, time.monotonic).result()
