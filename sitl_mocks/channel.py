"""One link of a vehicle to whoever is at its other end, and what can go wrong on it."""

from __future__ import annotations

import heapq
import random
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from sitl_mocks.dialect import Message, mavlink


@dataclass
class LinkFaults:
    """What a link does to packets, each way.

    Attributes:
        loss: share that is lost.
        duplicate: share that comes twice.
        delay_s: each packet is late by a random time up to this (wall time), so that they overtake each other.
        cut: nothing passes.
    """

    loss: float = 0.0
    duplicate: float = 0.0
    delay_s: float = 0.0
    cut: bool = False


class FaultyPipe:
    """Passes packets on with loss, doubling and delay, reproducibly.

    Args:
        output: where packets go.
        faults: shared with whoever wants to change them at run time.
        seed: of the faults.
    """

    def __init__(self, output: Callable[[bytes], None], faults: LinkFaults, seed: int) -> None:
        self._output = output
        self._faults = faults
        self._random = random.Random(seed)
        self._late: list[tuple[float, int, bytes]] = []
        self._number = 0

    def put(self, packet: bytes, wall_s: float) -> None:
        """Take a packet at a wall time."""
        if self._faults.cut or self._random.random() < self._faults.loss:
            return
        copies = 2 if self._random.random() < self._faults.duplicate else 1
        for _ in range(copies):
            if self._faults.delay_s <= 0.0:
                self._output(packet)
                continue
            due = wall_s + self._random.random() * self._faults.delay_s
            self._number += 1
            heapq.heappush(self._late, (due, self._number, packet))

    def release(self, wall_s: float) -> None:
        """Pass on the late packets whose time has come."""
        while self._late and self._late[0][0] <= wall_s:
            self._output(heapq.heappop(self._late)[2])


class Channel:
    """Packs and unpacks MAVLink on one link; every component counts its own packets, as on a real vehicle.

    Args:
        system_id: of the vehicle.
        transmit: takes each packet.
    """

    def __init__(self, system_id: int, transmit: Callable[[bytes], None]) -> None:
        self._system_id = system_id
        self._transmit = transmit
        self._packers: dict[int, Message] = {}
        self._parser = mavlink.MAVLink(None)
        self._parser.robust_parsing = True
        self.peer_is_station = False
        """Whether a heartbeat of a ground station (MAV_TYPE_GCS) was heard here."""
        self.streams: dict[int, Stream] = {}
        """Periodic messages asked for or given by default on this link, by message id."""

    def send(self, message: Message, component: int) -> None:
        """Send a message as one of the vehicle's components."""
        packer = self._packers.get(component)
        if packer is None:
            packer = mavlink.MAVLink(None, srcSystem=self._system_id, srcComponent=component)
            self._packers[component] = packer
        packet = bytes(message.pack(packer))
        packer.seq = (packer.seq + 1) % 256
        self._transmit(packet)

    def receive(self, data: bytes) -> Iterable[Message]:
        """Messages in received bytes; damaged and unknown ones are dropped."""
        messages = self._parser.parse_buffer(data) or []
        return [m for m in messages if m.get_msgId() >= 0]


@dataclass
class Stream:
    """A periodic message on one link.

    It is paced by the vehicle's clock, but never sent faster on wall time than `MIN_WALL_INTERVAL_S`, so that a
    speeded-up flight does not flood its link.
    """

    MIN_WALL_INTERVAL_S = 0.012

    interval_s: float
    next_s: float = 0.0
    next_wall_s: float = 0.0

    def is_due(self, now_s: float, wall_s: float) -> bool:
        """Whether to send now; if so, the next time is set."""
        if now_s < self.next_s or wall_s < self.next_wall_s:
            return False
        self.next_s = max(self.next_s + self.interval_s, now_s - self.interval_s)
        self.next_wall_s = wall_s + self.MIN_WALL_INTERVAL_S
        return True
