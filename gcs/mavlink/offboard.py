"""The offboard stream: setpoints at a fixed rate of the vehicle's clock, with a lease, a dead-man's switch and a lock.

Setpoints are encoded a little ahead of their time, and a process of their own puts each on the link when it is due
(`sender_process`): neither a busy event loop nor a busy machine that preempts this process makes one late. What is
queued never reaches beyond the dead-man's switch, and gives way to new setpoints at once when the source changes.

`SetpointStream` is the part without threads and processes; `OffboardSession` runs it in a thread of its own, and hands
its end back to the event loop. When the end of the stream has been told to the session, no setpoint follows.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Awaitable, Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs.core.frames import heading_from_yaw, ned_from_enu, wrap_angle
from gcs.mavlink.command_protocol import Target
from gcs.mavlink.dialect import Message, mavlink
from gcs.mavlink.events import OffboardEnd
from gcs.mavlink.framing import FramePacker
from gcs.mavlink.link_base import Outlet, Peer
from gcs.mavlink.sender_process import SenderProcess
from gcs.mavlink.transaction import Clock

MAX_WALL_RATE_HZ = 400.0
AHEAD_S = 0.4
"""So far ahead of their time setpoints are encoded: for longer a busy machine hardly keeps this process from it."""
TOP_UP_S = 0.05
"""When none is written, further ones are queued all the same as often as this."""
COMPONENT = int(mavlink.MAV_COMP_ID_PATHPLANNER)
"""Setpoints come from a component of their own: its packets' numbers follow each other, whatever else the station sends
between the time when one is encoded and the time when it is due."""


@dataclass(frozen=True, eq=False)
class Setpoint:
    """Where the vehicle is to be now, in local ENU about the estimator's origin (GPS_GLOBAL_ORIGIN).

    Attributes:
        position_m: shape (3,).
        velocity_m_s: shape (3,).
        acceleration_m_s2: shape (3,), without gravity.
        yaw_rad: from east, counter-clockwise.
    """

    position_m: NDArray[np.float64]
    velocity_m_s: NDArray[np.float64]
    acceleration_m_s2: NDArray[np.float64]
    yaw_rad: float

    @staticmethod
    def hover(position_m: NDArray[np.float64], yaw_rad: float) -> Setpoint:
        """Stand still at a place."""
        return Setpoint(np.asarray(position_m, dtype=np.float64), np.zeros(3), np.zeros(3), yaw_rad)


SetpointSource = Callable[[float], Setpoint | None]
"""Setpoint at a time of the vehicle's clock (s since boot), None at the end; called in the stream's thread.

It is asked ahead, in order; and again from the present on, when what it said for later is not to be sent."""


def setpoint_message(setpoint: Setpoint, vehicle_s: float, target: Target) -> Message:
    """SET_POSITION_TARGET_LOCAL_NED with position, velocity, acceleration and yaw.

    Raises:
        ValueError: a number of the setpoint is not finite.
    """
    ned = [
        float(number)
        for vector in (setpoint.position_m, setpoint.velocity_m_s, setpoint.acceleration_m_s2)
        for number in ned_from_enu(vector)
    ]
    heading = wrap_angle(heading_from_yaw(setpoint.yaw_rad))
    if not all(math.isfinite(number) for number in (*ned, heading)):
        raise ValueError("a setpoint has a number that is not finite")
    return mavlink.MAVLink_set_position_target_local_ned_message(
        int(vehicle_s * 1e3) & 0xFFFFFFFF,
        *target,
        mavlink.MAV_FRAME_LOCAL_NED,
        mavlink.POSITION_TARGET_TYPEMASK_YAW_RATE_IGNORE,
        *ned,
        heading,
        0.0,
    )


@dataclass(frozen=True)
class Batch:
    """Setpoints that are to be queued.

    Attributes:
        messages: and when each is due (station s), in order.
        replaces: in place of all that were queued before and have not gone out.
    """

    messages: tuple[tuple[float, Message], ...] = ()
    replaces: bool = False


class SetpointStream:
    """Decides which setpoints may go out, and when, a little ahead.

    Safe to use from several threads, but for `next_batch`, which is for one.

    Args:
        target: system and component of the autopilot.
        clock: monotonic seconds.
        deadman_s: no setpoint goes out longer than this after a `feed`.
        source: of the first setpoints.

    Attributes:
        deadman_s: see above.
    """

    def __init__(self, *, target: Target, clock: Clock, deadman_s: float, source: SetpointSource) -> None:
        self._target = target
        self._clock = clock
        self.deadman_s = deadman_s
        self._source = source
        self._replaces = False
        self._lock = threading.Lock()
        self._fed_at = clock()
        self._asked_at: float | None = None
        self._queued_until: float | None = None
        self._finished_at = math.inf
        self._end: tuple[OffboardEnd, str] | None = None

    @property
    def end(self) -> tuple[OffboardEnd, str] | None:
        """Why it ended, in a word and a sentence; None while it runs."""
        return self._end

    def feed(self) -> None:
        """The owner is alive."""
        with self._lock:
            self._fed_at = self._clock()

    def follow(self, source: SetpointSource) -> None:
        """Take the setpoints from a source, or anew from the same, from now on: what is queued is not to go out."""
        with self._lock:
            self._source = source
            self._replaces = True

    def replace(self) -> None:
        """Take the setpoints anew from now on: what is queued is not to go out, or cannot."""
        with self._lock:
            self._replaces = True

    def stop(self, end: OffboardEnd, detail: str = "") -> bool:
        """End it: there is no further batch. False when it had ended before."""
        with self._lock:
            return self._stop(end, detail)

    def _stop(self, end: OffboardEnd, detail: str = "") -> bool:
        if self._end is not None:
            return False
        self._end = (end, detail or end.value)
        return True

    def next_batch(self, vehicle_at: Callable[[float], float], rate_hz: float) -> Batch:
        """The setpoints that are to be queued now; none, and `end` says why, when the stream has ended.

        Args:
            vehicle_at: the vehicle's clock at a time of the station's.
            rate_hz: setpoints per second of the station's clock.
        """
        with self._lock:
            now = self._clock()
            self._judge(now)
            if self._end is not None:
                return Batch()
            source, replaces, self._replaces = self._source, self._replaces, False
            until = min(now + AHEAD_S, self._fed_at + self.deadman_s)
        if replaces:
            self._finished_at = math.inf
        messages = []
        try:
            due = self._next_due(now, 1.0 / rate_hz, replaces=replaces)
            while due <= until and self._finished_at == math.inf:
                vehicle_s = vehicle_at(due)
                setpoint = source(vehicle_s)
                if setpoint is None:
                    self._finished_at = due
                else:
                    messages.append((due, setpoint_message(setpoint, vehicle_s, self._target)))
                    self._queued_until = due
                due += 1.0 / rate_hz
        except Exception as error:  # the source is foreign code: whatever it raises ends the stream
            self.stop(OffboardEnd.SOURCE_FAILED, f"the source of setpoints failed: {error}")
        with self._lock:
            self._interrupted(self._clock() - now)
            return Batch() if self._end is not None else Batch(tuple(messages), replaces)

    def _judge(self, now: float) -> None:
        silent_s = now - self._fed_at
        if silent_s > self.deadman_s:
            self._stop(OffboardEnd.DEADMAN, f"its owner did not feed it for {silent_s:.1f} s")
        # A process that stood still feeds again before the vehicle's change of mode is heard: no setpoint may make the
        # vehicle chase a plan that has run on.
        self._interrupted(0.0 if self._asked_at is None else now - self._asked_at)
        self._asked_at = now
        if now >= self._finished_at and not self._replaces:
            self._stop(OffboardEnd.FINISHED)

    def _interrupted(self, seconds: float) -> None:
        if seconds > self.deadman_s:
            self._stop(OffboardEnd.DEADMAN, f"it was interrupted for {seconds:.1f} s")

    def _next_due(self, now: float, period_s: float, *, replaces: bool) -> float:
        """When the first setpoint of a batch is due: in step with those before it that go out."""
        last = self._queued_until
        if last is None:
            return now
        if not replaces and last + period_s >= now:
            return last + period_s
        return last + (math.floor((now - last) / period_s) + 1) * period_s


class OffboardSession:
    """A lease on a vehicle's setpoints, the thread that encodes them, and the process that sends them.

    Made by `Vehicle.offboard`. The owner calls `feed` at least every `deadman_s` seconds of its own time.

    Args:
        owner: who holds the lease, for people.
        stream: what to send.
        own_system: this station's system id.
        peer: tells whom to send to now; from any thread.
        passed: told of each packet that went out; from any thread.
        vehicle_at: the vehicle's clock (s since boot) at a monotonic time, safe to call from any thread.
        clock_rate: vehicle seconds per station second, likewise.
        rate_hz: setpoints per second of the vehicle's clock.
        on_end: called once, in the stream's thread, when it ended.
        leave: commands the vehicle to hold, and halts this session when it does.
    """

    def __init__(
        self,
        owner: str,
        stream: SetpointStream,
        *,
        own_system: int,
        peer: Callable[[], Peer | None],
        passed: Callable[[bytes], None],
        vehicle_at: Callable[[float], float],
        clock_rate: Callable[[], float],
        rate_hz: float,
        on_end: Callable[[OffboardSession], None],
        leave: Callable[[OffboardSession], Awaitable[None]],
    ) -> None:
        self.owner = owner
        self._stream = stream
        self._peer = peer
        self._passed = passed
        self._vehicle_at = vehicle_at
        self._clock_rate = clock_rate
        self._rate_hz = rate_hz
        self._on_end = on_end
        self._leave = leave
        self._packer = FramePacker(own_system, COMPONENT)
        self._outlet: Outlet | None = None
        self._sender: SenderProcess | None = None
        self._sent = 0
        self._counting = threading.Lock()
        self._thread = threading.Thread(target=self._run, name=f"offboard {owner}", daemon=True)

    @property
    def active(self) -> bool:
        """Whether setpoints go out."""
        return self._stream.end is None

    @property
    def end(self) -> tuple[OffboardEnd, str] | None:
        """Why it ended, in a word and a sentence; None while it runs."""
        return self._stream.end

    @property
    def setpoints_sent(self) -> int:
        """How many setpoints went out."""
        return self._sent

    def vehicle_now(self) -> float:
        """The vehicle's clock (s since boot), on which the source is asked."""
        return self._vehicle_at(time.monotonic())

    def feed(self) -> None:
        """Say that the owner is alive."""
        self._stream.feed()

    def fly(self, source: SetpointSource) -> None:
        """Follow a source from now on, instead of hovering; or the same anew, when it has something else to say."""
        self._stream.follow(source)

    async def stop(self) -> None:
        """Have the vehicle hold, and end the stream; nothing to do when it has ended.

        Raises:
            RefusedError: the vehicle does not go into hold; the stream has ended all the same.
            LinkError: it does not answer; likewise.
        """
        if self.active:
            await self._leave(self)

    def start(self) -> None:
        """Begin to send.

        Raises:
            GcsError: the system does not start the process that sends.
        """
        self._sender = SenderProcess(self._stream.deadman_s)
        self._thread.start()

    def halt(self, end: OffboardEnd, detail: str = "") -> None:
        """End the stream at once; after the return no setpoint goes out."""
        self._stream.stop(end, detail)
        if self._sender is not None:
            self._sender.halt()
            while packet := self._sender.written():
                self._count(packet)

    def join(self, timeout_s: float) -> None:
        """Wait for the thread's end."""
        self._thread.join(timeout_s)

    def _run(self) -> None:
        sender = self._sender
        if sender is None:
            raise RuntimeError("the session was not started")
        try:
            while not sender.ended and self._stream.end is None:
                if sender.ready:
                    self._queue(sender)
                packet = sender.written(TOP_UP_S)
                if packet is not None:
                    self._count(packet)
        finally:
            if sender.stood_still:
                self.halt(OffboardEnd.DEADMAN, "the process that sends setpoints was interrupted")
            else:
                self.halt(OffboardEnd.SOURCE_FAILED, "the process or thread that sends setpoints failed")
            sender.close()
            self._on_end(self)

    def _queue(self, sender: SenderProcess) -> None:
        peer = self._peer()
        outlet = None if peer is None else peer.outlet()
        if outlet is not self._outlet:
            self._outlet = outlet
            self._stream.replace()  # what is queued was signed for another link
            sender.use(outlet)
        batch = self._stream.next_batch(self._vehicle_at, self._wall_rate_hz())
        if peer is not None and (batch.messages or batch.replaces):
            packets = [(due, peer.sign(self._packer.pack(m), m.target_system)) for due, m in batch.messages]
            sender.queue(packets, replaces=batch.replaces)

    def _wall_rate_hz(self) -> float:
        return min(self._rate_hz * max(self._clock_rate(), 0.1), MAX_WALL_RATE_HZ)

    def _count(self, packet: bytes) -> None:
        with self._counting:
            self._sent += 1
        self._passed(packet)
