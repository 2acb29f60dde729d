"""A fake clock, a bad channel and two scripted vehicles, for the protocol tests.

The vehicles are written from the measured behaviour of the real ones and share nothing with the code under test but
the MAVLink packing library.
"""

from __future__ import annotations

import heapq
import math
import random
import struct
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

STATION = (255, 190)
VEHICLE = (1, 1)


class FakeClock:
    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now


@dataclass
class ChannelFaults:
    """What a direction of the link does to packets; `drop` sees the decoded message and may lose it on purpose."""

    loss: float = 0.0
    double: float = 0.0
    corrupt: float = 0.0
    delay_s: float = 0.01
    jitter_s: float = 0.0
    bytes_per_s: float = math.inf
    background_bytes_per_s: float = 0.0
    drop: Callable[[object], bool] = lambda message: False
    mavlink1: bool = False


class Channel:
    """One direction: packs, mistreats, delivers parsed messages in time order."""

    def __init__(self, clock: FakeClock, rng: random.Random, source: tuple[int, int], faults: ChannelFaults) -> None:
        self._clock, self._rng, self.faults = clock, rng, faults
        self._packer = mavlink.MAVLink(None, srcSystem=source[0], srcComponent=source[1])
        self._parser = mavlink.MAVLink(None)
        self._parser.robust_parsing = True
        self._queue: list[tuple[float, int, bytes]] = []
        self._count = 0
        self._free_at = 0.0
        self.sent = 0

    def put(self, message, source: tuple[int, int] | None = None) -> None:
        self.sent += 1
        if self.faults.drop(message) or self._rng.random() < self.faults.loss:
            return
        packer = self._packer if source is None else mavlink.MAVLink(None, srcSystem=source[0], srcComponent=source[1])
        raw = message.pack(packer, force_mavlink1=self.faults.mavlink1)
        packer.seq = (packer.seq + 1) % 256
        for _ in range(2 if self._rng.random() < self.faults.double else 1):
            self._enqueue(raw)

    def _enqueue(self, raw: bytes) -> None:
        now = self._clock()
        if self._rng.random() < self.faults.corrupt:
            place = self._rng.randrange(len(raw))
            raw = raw[:place] + bytes([raw[place] ^ (1 << self._rng.randrange(8))]) + raw[place + 1 :]
        rate = self.faults.bytes_per_s - self.faults.background_bytes_per_s
        self._free_at = max(self._free_at, now) + len(raw) / rate
        at = self._free_at + self.faults.delay_s + self._rng.random() * self.faults.jitter_s
        self._count += 1
        heapq.heappush(self._queue, (at, self._count, raw))

    @property
    def next_at(self) -> float:
        return self._queue[0][0] if self._queue else math.inf

    def due(self):
        while self._queue and self._queue[0][0] <= self._clock():
            raw = heapq.heappop(self._queue)[2]
            for message in self._parser.parse_buffer(raw) or []:
                if message.get_type() != "BAD_DATA":
                    yield message


class ScriptedVehicle:
    """Base of the vehicles: a list of items, timers, and hooks through which tests inject faults."""

    def __init__(self, clock: FakeClock, max_items: int = 1000) -> None:
        self.clock = clock
        self.max_items = max_items
        self.store: list = []
        self.put: Callable = lambda message, source=None: None
        self.alter_out: Callable = lambda message: [message]
        self.ignore_in: Callable = lambda message: False
        self.before_in: Callable = lambda message: None
        self.unsupported: set[int] = set()
        self.silent_until = 0.0
        self.others: list[ScriptedVehicle] = []

    deadline = math.inf

    def say(self, message) -> None:
        for altered in self.alter_out(message):
            self.put(altered)

    def ack(self, result: int) -> None:
        self.say(mavlink.MAVLink_mission_ack_message(*STATION, result, 0))

    def hear(self, message) -> None:
        self.before_in(message)
        if self.clock() < self.silent_until or self.ignore_in(message):
            return
        name = "on_" + message.get_type().lower()
        handler = getattr(self, name, None)
        if handler is not None:
            handler(message)

    def on_time(self) -> None:
        raise NotImplementedError

    def reboot(self, seconds: float, *, keeps_store: bool) -> None:
        self.silent_until = self.clock() + seconds
        self.deadline = math.inf
        self.idle()
        if not keeps_store:
            self.store = []

    def idle(self) -> None:
        raise NotImplementedError

    def send_item(self, sequence: int) -> None:
        item = self.store[sequence]
        self.say(
            mavlink.MAVLink_mission_item_int_message(
                *STATION,
                sequence,
                item.frame,
                item.command,
                1 if sequence == 0 else 0,
                item.autocontinue,
                *item.p,
                item.x,
                item.y,
                item.z,
                0,
            )
        )

    def send_count(self) -> None:
        self.say(mavlink.MAVLink_mission_count_message(*STATION, len(self.store), 0))


@dataclass(frozen=True)
class Held:
    """An item as a vehicle holds it."""

    frame: int
    command: int
    p: tuple[float, float, float, float]
    x: int
    y: int
    z: float
    autocontinue: int


def f32(value: float) -> float:
    return struct.unpack("<f", struct.pack("<f", value))[0]


def held(message) -> Held:
    return Held(
        message.frame,
        message.command,
        (message.param1, message.param2, message.param3, message.param4),
        message.x,
        message.y,
        message.z,
        message.autocontinue,
    )


class Px4Vehicle(ScriptedVehicle):
    """Two stores, strict order, asks again every 0.26 s, drops a dead transfer after 5.05 s without a word."""

    def __init__(self, clock: FakeClock, max_items: int = 1000) -> None:
        super().__init__(clock, max_items)
        self.idle()

    def idle(self) -> None:
        self.state, self.incoming, self.expected, self.count = "idle", [], 0, 0
        self.deadline, self.heard_at = math.inf, 0.0
        self.just_finished = -1

    def on_mission_count(self, message) -> None:
        if message.mission_type != 0:
            return
        if self.state == "receiving":
            if self.expected == 0:
                self.heard_at = self.clock()
                self.ask()
            else:
                self.ack(1)
            return
        if self.state == "sending":
            self.ack(1)
            return
        if message.count > self.max_items:
            self.ack(4)
            return
        if message.count == 0:
            self.store = []
            self.ack(0)
            return
        self.state, self.incoming, self.expected, self.count = "receiving", [], 0, message.count
        self.heard_at = self.clock()
        self.ask()

    def ask(self) -> None:
        self.say(mavlink.MAVLink_mission_request_int_message(*STATION, self.expected, 0))
        self.deadline = self.clock() + 0.26

    def on_mission_item_int(self, message) -> None:
        if message.mission_type != 0:
            return
        if self.state != "receiving":
            self.ack(0 if message.seq == self.just_finished else 1)
            return
        self.heard_at = self.clock()
        if message.seq != self.expected:
            return
        if message.command in self.unsupported:
            self.idle()
            self.ack(3)
            return
        self.incoming.append(self.stored(held(message)))
        self.expected += 1
        if self.expected < self.count:
            self.ask()
        else:
            last, self.store = message.seq, self.incoming
            self.idle()
            self.just_finished = last
            self.ack(0)

    @staticmethod
    def stored(item: Held) -> Held:
        p1, p2, p3, p4 = item.p
        frame = {0: 5, 3: 6}.get(item.frame, item.frame)
        if item.command == 16:
            p3 = 0.0
        if item.command in {16, 21, 22} and not math.isnan(p4):
            turns = f32(math.radians(p4)) % (2 * math.pi)
            p4 = f32(math.degrees(f32(turns)))
        return replace(item, frame=frame, p=(p1, p2, p3, p4))

    def on_mission_ack(self, message) -> None:
        if message.mission_type == 0 and (self.state == "sending" or message.type == 15):
            self.idle()

    def on_mission_request_list(self, message) -> None:
        if message.mission_type != 0 or self.state == "receiving":
            return
        self.state, self.expected = "sending", 0
        self.heard_at = self.clock()
        self.deadline = self.clock() + 5.05
        self.send_count()

    def on_mission_request_int(self, message) -> None:
        if message.mission_type != 0 or self.state != "sending":
            return
        self.heard_at = self.clock()
        self.deadline = self.clock() + 5.05
        if message.seq == self.expected and self.expected < len(self.store):
            self.expected += 1
        elif message.seq != self.expected - 1:
            self.idle()
            self.ack(1)
            return
        self.send_item(message.seq)

    def on_mission_clear_all(self, message) -> None:
        self.store = []
        self.ack(0)

    def on_time(self) -> None:
        if self.clock() >= self.heard_at + 5.05:
            self.idle()
        elif self.state == "receiving":
            self.ask()
        else:
            self.deadline = self.heard_at + 5.05


class ArduPilotVehicle(ScriptedVehicle):
    """One store written in place, asks with the old request, again each second, cancels at 8 s."""

    HOME = Held(0, 16, (0.0, 0.0, 0.0, 0.0), 313622001, 1216154999, f32(4.09), 1)

    def __init__(self, clock: FakeClock, max_items: int = 650) -> None:
        super().__init__(clock, max_items)
        self.idle()

    def idle(self) -> None:
        self.receiving, self.expected, self.count, self.sender = False, 0, 0, None
        self.deadline, self.heard_at = math.inf, 0.0

    def on_mission_count(self, message) -> None:
        sender = (message.get_srcSystem(), message.get_srcComponent())
        if message.mission_type != 0:
            self.say(mavlink.MAVLink_mission_ack_message(*STATION, 3, message.mission_type))
            return
        if self.receiving and sender != self.sender:
            self.ack(14)
            return
        if message.count > self.max_items:
            self.ack(4)
            return
        del self.store[message.count :]
        if message.count == 0:
            self.ack(0)
            return
        self.receiving, self.expected, self.count, self.sender = True, 0, message.count, sender
        self.heard_at = self.clock()
        self.ask()

    def on_mission_write_partial_list(self, message) -> None:
        self.sender = (message.get_srcSystem(), message.get_srcComponent())
        self.receiving, self.expected, self.count = True, message.start_index, message.end_index + 1
        self.heard_at = self.clock()
        self.ask()

    def ask(self) -> None:
        self.say(mavlink.MAVLink_mission_request_message(*self.sender, self.expected, 0))
        self.deadline = self.clock() + 1.0

    def on_mission_item_int(self, message) -> None:
        if message.mission_type != 0:
            return
        if not self.receiving:
            self.ack(1)
            return
        if message.seq != self.expected:
            self.ack(13)
            return
        self.heard_at = self.clock()
        if message.command in self.unsupported:
            self.idle()
            self.ack(3)
            return
        item = self.HOME if message.seq == 0 else self.stored(held(message))
        if message.seq < len(self.store):
            self.store[message.seq] = item
        else:
            self.store.append(item)
        self.expected += 1
        if self.expected < self.count:
            self.ask()
        else:
            self.idle()
            self.ack(0)

    @staticmethod
    def stored(item: Held) -> Held:
        kept = {
            16: (1, 0, 0, 0),
            22: (1, 0, 0, 0),
            93: (1, 1, 1, 1),
            115: (1, 1, 1, 1),
            178: (1, 1, 1, 0),
            203: (1, 1, 1, 1),
            205: (1, 1, 1, 0),
        }
        if item.command == 21:
            p = (float(int(item.p[0])), 0.0, 0.0, -1.0 if item.p[3] < 0 else 1.0)
        else:
            p = tuple(v if k else 0.0 for v, k in zip(item.p, kept[item.command], strict=True))
        if item.command == 16:
            p = (float(int(p[0])), 0.0, 0.0, 0.0)
        place = item.command in {16, 21, 22}
        frame = {5: 0, 6: 3, 11: 10}.get(item.frame, item.frame) if place else 0
        z = f32(int(f32(item.z * f32(100.0))) / 100) if place else item.z
        return Held(frame, item.command, p, item.x, item.y, z, 1)

    def on_mission_request_list(self, message) -> None:
        if message.mission_type != 0:
            return
        if self.receiving:
            self.ack(14)
            return
        self.send_count()

    def on_mission_request_int(self, message) -> None:
        if message.mission_type != 0 or self.receiving:
            return
        if message.seq < len(self.store):
            self.send_item(message.seq)
        else:
            self.ack(13)

    def on_mission_clear_all(self, message) -> None:
        self.store = []
        self.ack(0)

    def on_time(self) -> None:
        if self.clock() >= self.heard_at + 8.0:
            self.idle()
            self.ack(15)
        elif self.receiving:
            self.ask()
        else:
            self.deadline = math.inf


@dataclass
class Rig:
    """A station's transaction and a vehicle with a bad link between them, on fake time."""

    clock: FakeClock
    vehicle: object
    up: Channel
    down: Channel
    to_station: list = field(default_factory=list)
    at: list[tuple[float, Callable[[], None]]] = field(default_factory=list)
    on_heard: Callable = lambda transaction, message: None

    def send(self, message) -> None:
        self.up.put(message)

    def drive(self, transaction, limit_s: float = 600.0) -> None:
        """Run a transaction to its end; a transaction that never ends is a failure."""
        end = self.clock() + limit_s
        transaction.start()
        for _ in range(2_000_000):
            if transaction.finished:
                return
            times = [transaction.deadline, self.up.next_at, self.down.next_at, self.vehicle.deadline]
            times += [at for at, _ in self.at]
            self.clock.now = max(self.clock.now, min(times))
            assert self.clock.now < end, "the transaction does not end"
            for at, action in [entry for entry in self.at if entry[0] <= self.clock.now]:
                self.at.remove((at, action))
                action()
            for message in self.up.due():
                self.vehicle.hear(message)
            if self.clock.now >= self.vehicle.deadline:
                self.vehicle.on_time()
            for message in self.down.due():
                if not transaction.finished:
                    transaction.handle(message)
                    self.on_heard(transaction, message)
            if not transaction.finished and self.clock.now >= transaction.deadline:
                transaction.on_time()
        raise AssertionError("the transaction spins without end")

    async def run(self, transaction):
        self.drive(transaction)
        return transaction.result()

    def pass_time(self, seconds: float) -> None:
        """Let the vehicle and the channels go on without a station."""
        end = self.clock.now + seconds
        while True:
            at = min(self.up.next_at, self.vehicle.deadline)
            if at > end:
                break
            self.clock.now = max(self.clock.now, at)
            for message in self.up.due():
                self.vehicle.hear(message)
            if self.clock.now >= self.vehicle.deadline:
                self.vehicle.on_time()
        self.clock.now = end
        list(self.down.due())


@pytest.fixture
def make_rig():
    """Builds a rig: `make_rig("px4" | "ardupilot" | vehicle factory, seed=…, up=…, down=…, both=…)`."""

    def make(kind="px4", *, seed: int = 1, max_items: int | None = None, up=None, down=None, **both) -> Rig:
        clock = FakeClock()
        rng = random.Random(seed)
        kinds = {"px4": Px4Vehicle, "ardupilot": ArduPilotVehicle}
        vehicle = kinds[kind](clock, max_items or 1000) if isinstance(kind, str) else kind(clock)
        rig = Rig(
            clock,
            vehicle,
            Channel(clock, rng, STATION, ChannelFaults(**{**both, **(up or {})})),
            Channel(clock, rng, VEHICLE, ChannelFaults(**{**both, **(down or {})})),
        )
        vehicle.put = rig.down.put
        return rig

    return make


@pytest.fixture
def wire():
    """The packing library, for messages that tests forge."""
    return mavlink
