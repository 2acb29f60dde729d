"""The offboard stream: setpoints at a fixed rate of the vehicle's clock, with a lease, a dead-man's switch and a lock.

`SetpointStream` is the part without threads and sockets; `OffboardSession` runs it in a thread of its own, so that a
busy event loop does not delay setpoints, and hands its end back to the loop. Whether a setpoint may go out is decided
and done under one lock: when a mode change has been told to the stream, no setpoint follows.
"""

from __future__ import annotations

import math
import sys
import threading
from collections.abc import Awaitable, Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs.core.frames import heading_from_yaw, ned_from_enu, wrap_angle
from gcs.mavlink.command_protocol import Target
from gcs.mavlink.dialect import Message, mavlink
from gcs.mavlink.events import OffboardEnd
from gcs.mavlink.transaction import Clock, Send

MAX_WALL_RATE_HZ = 400.0
SWITCH_S = 5e-4
"""For so long the interpreter lets another thread go on while this one waits; its own 5 ms would show in the rate."""


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
"""Setpoint at a time of the vehicle's clock (s since boot), None at the end; called in the stream's thread."""


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


class SetpointStream:
    """Decides for each setpoint whether it may still go out, and sends it.

    Safe to use from several threads.

    Args:
        target: system and component of the autopilot.
        send: puts a message on the link, from any thread.
        clock: monotonic seconds.
        deadman_s: for how long it goes on without `feed`.
        source: of the first setpoints.
    """

    def __init__(self, *, target: Target, send: Send, clock: Clock, deadman_s: float, source: SetpointSource) -> None:
        self._target = target
        self._send = send
        self._clock = clock
        self._deadman_s = deadman_s
        self._source = source
        self._lock = threading.Lock()
        self._fed_at = clock()
        self._stepped_at: float | None = None
        self._end: tuple[OffboardEnd, str] | None = None
        self.sent = 0

    @property
    def end(self) -> tuple[OffboardEnd, str] | None:
        """Why it ended, in a word and a sentence; None while it runs."""
        return self._end

    def feed(self) -> None:
        """The owner is alive."""
        with self._lock:
            self._fed_at = self._clock()

    def follow(self, source: SetpointSource) -> None:
        """Take the setpoints from another source from now on."""
        with self._lock:
            self._source = source

    def stop(self, end: OffboardEnd, detail: str = "") -> bool:
        """End it; after the return no setpoint goes out. False when it had ended before."""
        with self._lock:
            return self._stop(end, detail)

    def _stop(self, end: OffboardEnd, detail: str = "") -> bool:
        if self._end is not None:
            return False
        self._end = (end, detail or end.value)
        return True

    def step(self, vehicle_s: float) -> bool:
        """Send the setpoint of a time of the vehicle's clock; False when the stream has ended."""
        with self._lock:
            now = self._clock()
            silent_s = now - self._fed_at
            # A process that stood still feeds again before the vehicle's change of mode is heard: no setpoint may
            # make the vehicle chase a plan that has run on.
            gap_s = 0.0 if self._stepped_at is None else now - self._stepped_at
            self._stepped_at = now
            if silent_s > self._deadman_s:
                self._stop(OffboardEnd.DEADMAN, f"its owner did not feed it for {silent_s:.1f} s")
            elif gap_s > self._deadman_s:
                self._stop(OffboardEnd.DEADMAN, f"it was interrupted for {gap_s:.1f} s")
            if self._end is not None:
                return False
            source = self._source
        try:
            setpoint = source(vehicle_s)
            message = None if setpoint is None else setpoint_message(setpoint, vehicle_s, self._target)
        except Exception as error:  # the source is foreign code: whatever it raises ends the stream
            self.stop(OffboardEnd.SOURCE_FAILED, f"the source of setpoints failed: {error}")
            return False
        with self._lock:
            took_s = self._clock() - now
            if message is None:
                self._stop(OffboardEnd.FINISHED)
            elif took_s > self._deadman_s:
                self._stop(OffboardEnd.DEADMAN, f"it was interrupted for {took_s:.1f} s")
            if self._end is not None:
                return False
            self._send(message)
            self.sent += 1
            return True


class OffboardSession:
    """A lease on a vehicle's setpoints, and the thread that sends them.

    Made by `Vehicle.offboard`. The owner calls `feed` at least every `deadman_s` seconds of its own time.

    Args:
        owner: who holds the lease, for people.
        stream: what to send.
        clock: monotonic seconds.
        vehicle_now: the vehicle's clock (s since boot), safe to call from any thread.
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
        clock: Clock,
        vehicle_now: Callable[[], float],
        clock_rate: Callable[[], float],
        rate_hz: float,
        on_end: Callable[[OffboardSession], None],
        leave: Callable[[OffboardSession], Awaitable[None]],
    ) -> None:
        self.owner = owner
        self._stream = stream
        self._clock = clock
        self._vehicle_now = vehicle_now
        self._clock_rate = clock_rate
        self._rate_hz = rate_hz
        self._on_end = on_end
        self._wake = threading.Event()
        self._thread = threading.Thread(target=self._run, name=f"offboard {owner}", daemon=True)
        self._leave = leave

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
        return self._stream.sent

    def vehicle_now(self) -> float:
        """The vehicle's clock (s since boot), on which the source is asked."""
        return self._vehicle_now()

    def feed(self) -> None:
        """Say that the owner is alive."""
        self._stream.feed()

    def fly(self, source: SetpointSource) -> None:
        """Follow a source from now on, instead of hovering."""
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
        """Begin to send."""
        sys.setswitchinterval(min(sys.getswitchinterval(), SWITCH_S))
        self._thread.start()

    def halt(self, end: OffboardEnd, detail: str = "") -> None:
        """End the stream at once; after the return no setpoint goes out."""
        self._stream.stop(end, detail)
        self._wake.set()

    def join(self, timeout_s: float) -> None:
        """Wait for the thread's end."""
        self._thread.join(timeout_s)

    def _run(self) -> None:
        clock = self._clock
        due = clock()
        try:
            while self._stream.step(self._vehicle_now()):
                wall_rate = min(self._rate_hz * max(self._clock_rate(), 0.1), MAX_WALL_RATE_HZ)
                due = max(due + 1.0 / wall_rate, clock() - 1.0 / wall_rate)
                if self._wake.wait(max(0.0, due - clock())):
                    break
        finally:
            self._stream.stop(OffboardEnd.SOURCE_FAILED, "the thread that sends setpoints failed")
            self._on_end(self)
