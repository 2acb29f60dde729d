"""The clock an offboard flight is flown by: it follows the vehicle's time, halts at gates, slows down and goes on.

It is read ahead of the vehicle's time by the stream that encodes setpoints, and may be read again from an earlier time
on, when a gate has moved or a pause begun; everybody else asks where it stands now.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

MAX_STEP_S = 1.0
"""A jump of the vehicle's clock beyond this (a stall, a reboot) does not move the plan."""

KEPT = 256
"""Readings that are remembered: more than are ahead of the vehicle's time."""


@dataclass(frozen=True)
class ClockReading:
    """Plan time (s), its rate against vehicle time (0 to 1) and the rate's rate of change (1/s)."""

    time_s: float
    rate: float
    rate_change: float


@dataclass(frozen=True)
class _Read:
    """A reading, the vehicle time (s) that it is of, and the rate beside which a gate may hold the clock."""

    vehicle_s: float
    pace: float
    reading: ClockReading


class PlanClock:
    """Plan time as a function of vehicle time.

    Plan time runs at rate 1, except that it never passes `gate_s` (where the plan rests and somebody has to say "go
    on") and that a pause brings the rate to 0, and the end of a pause back to 1, at no more than `slew` per second, so
    that the vehicle is never asked to stop or start at once.

    Args:
        start_s: plan time to begin at.
        slew: largest change of the rate per second of vehicle time.
        paused: begin at a standstill, and wait for `resume`.
        vehicle_now: tells the vehicle's time now; by default, that of the last reading.
    """

    def __init__(
        self,
        start_s: float = 0.0,
        *,
        slew: float = 0.4,
        paused: bool = False,
        vehicle_now: Callable[[], float] = lambda: math.inf,
    ) -> None:
        pace = 0.0 if paused else 1.0
        self._reads: tuple[_Read, ...] = (_Read(-math.inf, pace, ClockReading(start_s, pace, 0.0)),)
        self._slew = slew
        self._paused = paused
        self._vehicle_now = vehicle_now
        self.gate_s = math.inf

    @property
    def now(self) -> ClockReading:
        """What was read for the vehicle's time now."""
        return self._now().reading

    @property
    def time_s(self) -> float:
        """The plan time now."""
        return self.now.time_s

    @property
    def stopped(self) -> bool:
        """Whether plan time stands still, at a gate or in a pause."""
        now = self._now()
        return now.pace == 0.0 or now.reading.time_s >= self.gate_s

    def pause(self) -> None:
        """Slow down to a stop."""
        self._paused = True

    def resume(self) -> None:
        """Go on."""
        self._paused = False

    def read(self, vehicle_s: float) -> ClockReading:
        """Advance to a vehicle time (s) and tell the plan time there; readings of later times are forgotten."""
        last = self._before(vehicle_s)
        step = 0.0 if last.vehicle_s == -math.inf else min(max(vehicle_s - last.vehicle_s, 0.0), MAX_STEP_S)
        target = 0.0 if self._paused else 1.0
        change = min(max(target - last.pace, -self._slew * step), self._slew * step)
        time, pace = last.reading.time_s + (last.pace + change / 2) * step, last.pace + change
        if time >= self.gate_s:
            reading = ClockReading(max(last.reading.time_s, self.gate_s), 0.0, 0.0)
        else:
            reading = ClockReading(time, pace, change / step if step > 0 else 0.0)
        kept = tuple(read for read in self._reads[-KEPT:] if -math.inf < read.vehicle_s < vehicle_s)
        self._reads = (*kept, _Read(vehicle_s, pace, reading))
        return reading

    def _before(self, vehicle_s: float) -> _Read:
        """The reading to go on from: the last one, when the vehicle's clock went back further than is remembered."""
        reads = self._reads
        return next((read for read in reversed(reads) if read.vehicle_s < vehicle_s), reads[-1])

    def _now(self) -> _Read:
        reads, vehicle_s = self._reads, self._vehicle_now()
        return next((read for read in reversed(reads) if read.vehicle_s <= vehicle_s), reads[0])
