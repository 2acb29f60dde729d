"""Simulated vehicles on fake time in a process of their own, and many transfers with them at once.

A transfer is a coroutine that awaits `Order`s; all orders that are waiting go to the process together, so that the pipe
costs little. Nothing here waits for a clock: time is what the simulated world says.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable, Coroutine, Generator, Iterable, Iterator
from functools import partial
from typing import Any, TypeVar

from gcs.core.errors import LinkError
from gcs.mavlink.dialect import Message
from gcs.mavlink.framing import FramePacker, FrameParser
from gcs.mavlink.ftp_fetch import FetchFile
from gcs.mavlink.ftp_protocol import OnBytes, SequenceNumbers
from gcs.mavlink.ftp_store import StoreFile
from gcs.mavlink.ftp_transaction import FtpTransaction
from gcs.mavlink.transaction import Transaction
from gcs.mavlink.vehicle_files import MADE_UP_BYTES

T = TypeVar("T")
R = TypeVar("R")
Work = Coroutine["list[Any]", Any, T]
"""Yields orders, is sent their answers, returns what came out."""

STATION = (255, 190)
AT_ONCE = 64


class Order:
    """Something to be done by the simulated worlds; awaiting it gives the answer."""

    def __init__(self, *words: Any) -> None:
        self._words = list(words)

    def __await__(self) -> Generator[list[Any], Any, Any]:
        return (yield self._words)


class WorldLink:
    """The station's end of the link to the vehicle in one world, on that world's time.

    Args:
        number: of the world.
    """

    def __init__(self, number: int) -> None:
        self._number = number
        self._packer = FramePacker(*STATION)
        self._outbox: list[str] = []
        self.now_s = 0.0
        self.on_heard: Callable[[Transaction[Any]], None] = lambda _: None
        """Called after each message that a transaction has taken; may cancel it."""

    def send(self, message: Message) -> None:
        """Put a message on the link."""
        self._outbox.append(self._packer.pack(message).hex())

    def clock(self) -> float:
        """The world's time (s)."""
        return self.now_s

    async def run(self, transaction: Transaction[R], /) -> R:
        """Drive a transaction to its end."""
        transaction.start()
        while not transaction.finished:
            outbox, self._outbox = self._outbox, []
            self.now_s, packets = await Order("pass", self._number, transaction.deadline, outbox)
            for packet in packets:  # a datagram each: one that lost its end does not take the next one with it
                for message in FrameParser().feed(bytes.fromhex(packet)):
                    if not transaction.finished:
                        transaction.handle(message)
                        self.on_heard(transaction)
            if not transaction.finished and self.now_s >= transaction.deadline:
                transaction.on_time()
        return transaction.result()

    async def truth(self, read: list[list[float]] | None = None) -> dict[str, bool]:
        """What is so in the world, once what was sent last has had its effect; the world is gone afterwards.

        Args:
            read: wire items that the station read.
        """
        outbox, self._outbox = self._outbox, []
        await Order("pass", self._number, self.now_s, outbox)
        return dict(await Order("truth", self._number, read))


class WorldFiles:
    """The files of the vehicle's autopilot in one world; see `FilePeer`.

    Args:
        link: to the vehicle.
    """

    target = (1, 1)

    def __init__(self, link: WorldLink) -> None:
        self._link = link
        self._numbers = SequenceNumbers(0)

    async def read_made_up(self, path: str) -> bytes:
        """See `FilePeer`."""
        fetch = self._exchange(partial(FetchFile, max_bytes=MADE_UP_BYTES, made_up=True), path)
        return (await self._link.run(fetch)).data

    async def write_to_autopilot(self, path: str, data: bytes, on_bytes: OnBytes | None = None) -> None:
        """See `FilePeer`."""
        await self._link.run(self._exchange(partial(StoreFile, data=data, on_progress=on_bytes), path))

    def _exchange(self, make: Callable[..., FtpTransaction[R]], path: str) -> FtpTransaction[R]:
        link = self._link
        return make(path, *self.target, link.send, link.clock, sequence=self._numbers, own_system=STATION[0])


class LockstepWorlds:
    """The process with the simulated worlds, inside a `with` block."""

    def __enter__(self) -> LockstepWorlds:
        self._process = subprocess.Popen(
            [sys.executable, "-m", "sitl_mocks.lockstep"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        return self

    def __exit__(self, *_: object) -> None:
        if self._process.stdin is not None:
            self._process.stdin.close()
        self._process.wait()
        if self._process.stdout is not None:
            self._process.stdout.close()

    def answers(self, orders: list[list[Any]]) -> list[Any]:
        """Have orders carried out.

        Raises:
            LinkError: the process has ended.
        """
        if self._process.stdin is None or self._process.stdout is None:
            raise RuntimeError("use it inside a `with` block")
        self._process.stdin.write(json.dumps(orders) + "\n")
        self._process.stdin.flush()
        line = self._process.stdout.readline()
        if not line:
            raise LinkError("the simulated vehicles have ended; their own message stands above")
        return list(json.loads(line))

    def run_all(self, works: Iterable[Work[T]]) -> Iterator[T]:
        """Run transfers, many at once; gives what each returns, in the order in which they end."""
        waiting = iter(works)
        running: list[tuple[Work[T], list[Any]]] = []
        while True:
            while len(running) < AT_ONCE and (work := next(waiting, None)) is not None:
                running.append((work, work.send(None)))
            if not running:
                return
            answers = self.answers([order for _, order in running])
            going_on: list[tuple[Work[T], list[Any]]] = []
            for (work, _), answer in zip(running, answers, strict=True):
                try:
                    going_on.append((work, work.send(answer)))
                except StopIteration as end:
                    yield end.value
            running = going_on
