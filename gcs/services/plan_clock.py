"""The clock an offboard flight is flown by: it follows the vehicle's time, halts at gates, slows down and goes on."""

from __future__ import annotations

import math
from dataclasses import dataclass

MAX_STEP_S = 1.0
"""A jump of the vehicle's clock beyond this (a stall, a reboot) does not move the plan."""


@dataclass(frozen=True)
class ClockReading:
    """Plan time (s), its rate against vehicle time (0 to 1) and the rate's rate of change (1/s)."""

    time_s: float
    rate: float
    rate_change: float


class PlanClock:
    """Plan time as a function of vehicle time.

    Plan time runs at rate 1, except that it never passes `gate_s` (where the plan rests and somebody has to say "go
    on") and that a pause brings the rate to 0, and the end of a pause back to 1, at no more than `slew` per second, so
    that the vehicle is never asked to stop or start at once.

    Args:
        start_s: plan time to begin at.
        slew: largest change of the rate per second of vehicle time.
        paused: begin at a standstill, and wait for `resume`.
    """

    def __init__(self, start_s: float = 0.0, *, slew: float = 0.4, paused: bool = False) -> None:
        self._time = start_s
        self._rate = 0.0 if paused else 1.0
        self._slew = slew
        self._paused = paused
        self._vehicle_s: float | None = None
        self.gate_s = math.inf

    @property
    def time_s(self) -> float:
        """The plan time last read."""
        return self._time

    @property
    def stopped(self) -> bool:
        """Whether plan time stands still, at a gate or in a pause."""
        return self._rate == 0.0 or self._time >= self.gate_s

    def pause(self) -> None:
        """Slow down to a stop."""
        self._paused = True

    def resume(self) -> None:
        """Go on."""
        self._paused = False

    def read(self, vehicle_s: float) -> ClockReading:
        """Advance to a vehicle time (s) and tell the plan time there."""
        step = 0.0 if self._vehicle_s is None else min(max(vehicle_s - self._vehicle_s, 0.0), MAX_STEP_S)
        self._vehicle_s = vehicle_s
        target = 0.0 if self._paused else 1.0
        change = min(max(target - self._rate, -self._slew * step), self._slew * step)
        time = self._time + (self._rate + change / 2) * step
        self._rate += change
        if time >= self.gate_s:
            self._time = max(self._time, self.gate_s)
            return ClockReading(self._time, 0.0, 0.0)
        self._time = time
        return ClockReading(time, self._rate, change / step if step > 0 else 0.0)
