"""One link of a vehicle to whoever is at its other end, and what can go wrong on it."""

from __future__ import annotations

import heapq
import math
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
        latency_s: each packet takes at least this long.
        corrupt: share that has a bit flipped.
        shortened: share that loses its end.
        bytes_per_s: what the line carries; packets queue for it. 0 for any amount.
        mavlink_1: the vehicle speaks MAVLink 1.
    """

    loss: float = 0.0
    duplicate: float = 0.0
    delay_s: float = 0.0
    cut: bool = False
    latency_s: float = 0.0
    corrupt: float = 0.0
    shortened: float = 0.0
    bytes_per_s: float = 0.0
    mavlink_1: bool = False


class FaultyPipe:
    """Passes packets on with loss, doubling, damage and delay, reproducibly.

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
        self._line_free_s = -math.inf

    @property
    def next_s(self) -> float:
        """Wall time at which the next late packet is due; infinite when there is none."""
        return self._late[0][0] if self._late else math.inf

    def put(self, packet: bytes, wall_s: float) -> None:
        """Take a packet at a wall time."""
        if self._faults.cut or self._random.random() < self._faults.loss:
            return
        copies = 2 if self._random.random() < self._faults.duplicate else 1
        for _ in range(copies):
            due = self._due_s(len(packet), wall_s)
            if due <= wall_s:
                self._output(self._damaged(packet))
                continue
            self._number += 1
            heapq.heappush(self._late, (due, self._number, self._damaged(packet)))

    def release(self, wall_s: float) -> None:
        """Pass on the late packets whose time has come."""
        while self._late and self._late[0][0] <= wall_s:
            self._output(heapq.heappop(self._late)[2])

    def _due_s(self, size: int, wall_s: float) -> float:
        faults = self._faults
        sent_s = wall_s
        if faults.bytes_per_s > 0.0:
            sent_s = self._line_free_s = max(self._line_free_s, wall_s) + size / faults.bytes_per_s
        jitter_s = self._random.random() * faults.delay_s if faults.delay_s > 0.0 else 0.0
        return sent_s + faults.latency_s + jitter_s

    def _damaged(self, packet: bytes) -> bytes:
        if self._faults.corrupt and self._random.random() < self._faults.corrupt:
            place = self._random.randrange(len(packet))
            flipped = packet[place] ^ (1 << self._random.randrange(8))
            packet = packet[:place] + bytes([flipped]) + packet[place + 1 :]
        if self._faults.shortened and self._random.random() < self._faults.shortened:
            packet = packet[: self._random.randrange(1, len(packet))]
        return packet


class Channel:
    """Packs and unpacks MAVLink on one link; every component counts its own packets, as on a real vehicle.

    Args:
        system_id: of the vehicle.
        transmit: takes each packet.
        faults: of the link, for what the packing itself is to do.
    """

    def __init__(self, system_id: int, transmit: Callable[[bytes], None], faults: LinkFaults | None = None) -> None:
        self._system_id = system_id
        self._transmit = transmit
        self._faults = faults if faults is not None else LinkFaults()
        self._packers: dict[tuple[int, int], Message] = {}
        self._parser = mavlink.MAVLink(None)
        self._parser.robust_parsing = True
        self.signing = self._parser.signing
        """What signs and judges on this link (pymavlink's)."""
        self.peer_is_station = False
        """Whether a heartbeat of a ground station (MAV_TYPE_GCS) was heard here."""
        self.streams: dict[int, Stream] = {}
        """Periodic messages asked for or given by default on this link, by message id."""
        self.leads_to_companion = False
        """Whether the vehicle's companion computer is at the other end: it gets the lidar's messages."""

    def send(self, message: Message, component: int, system_id: int | None = None) -> None:
        """Send a message as one of the vehicle's components, or as one of another vehicle on the same link."""
        source = (self._system_id if system_id is None else system_id, component)
        packer = self._packers.get(source)
        if packer is None:
            packer = mavlink.MAVLink(None, srcSystem=source[0], srcComponent=source[1])
            packer.signing = self.signing
            self._packers[source] = packer
        packet = bytes(message.pack(packer, force_mavlink1=self._faults.mavlink_1))
        packer.seq = (packer.seq + 1) % 256
        self._transmit(packet)

    def pass_on(self, packet: bytes) -> None:
        """Send a packet of somebody else, as it came."""
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
