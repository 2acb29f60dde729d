"""The vehicle's clock as seen from the station's: rate and offset from time stamps that arrive late by a random delay.

A stamp `v` heard at station time `w` means `v <= vehicle_clock(w)`: it can be late, never early. So with the rate
known, the vehicle's clock is the upper envelope of the stamps, plus the smallest one-way delay, for which half the
shortest TIMESYNC round trip stands. The rate is the median of the slopes between early and late stamps of the window
(a Theil-Sen estimate), which a few late messages do not move.
"""

from __future__ import annotations

from array import array
from bisect import bisect_left
from collections import deque
from statistics import median

WINDOW_S = 8.0
SPACING_S = 0.05
ESTIMATE_EVERY_S = 0.5
FEW_SAMPLES = 20
MIN_SPAN_S = 0.5
REBOOT_S = 2.0
STEP_COUNT = 10
STEP_S = 0.5
ROUND_TRIPS = 20


class VehicleClock:
    """Estimates the vehicle's clock (s since boot) at station times; the rate is not 1 in a sped-up simulation.

    Attributes:
        reboots: how often the vehicle's clock went back to the start.
    """

    __slots__ = ("_estimated_at", "_fit", "_heard_s", "_newest_s", "_off_count", "_round_trips", "_told_s", "reboots")

    def __init__(self) -> None:
        self._newest_s = float("-inf")
        """When the newest stamp was heard."""
        self._heard_s, self._told_s = array("d"), array("d")
        """The stamps of the window: when each was heard, and what it said."""
        self._round_trips: deque[float] = deque(maxlen=ROUND_TRIPS)
        self._fit: tuple[float, float, float] | None = None
        self._estimated_at = float("-inf")
        self._off_count = 0
        self.reboots = 0

    @property
    def known(self) -> bool:
        """Whether there is an estimate."""
        return self._fit is not None

    @property
    def rate(self) -> float:
        """Vehicle seconds per station second; 1 until known."""
        return 1.0 if self._fit is None else self._fit[2]

    def at(self, station_s: float) -> float | None:
        """The vehicle's clock at a station time; None until known."""
        fit = self._fit
        if fit is None:
            return None
        at_s, vehicle_s, rate = fit
        return vehicle_s + rate * (station_s - at_s)

    def stamped_lately(self, station_s: float) -> bool:
        """Whether a further stamp would only be passed over."""
        return station_s - self._newest_s < SPACING_S

    def stamp(self, station_s: float, vehicle_s: float) -> None:
        """Take a time stamp of the vehicle and when it was heard."""
        if self._told_s:
            if vehicle_s < self._told_s[-1] - REBOOT_S * max(1.0, self.rate):
                self.reboots += 1
                self._restart()
            elif self.stamped_lately(station_s):
                return
        predicted = self.at(station_s)
        if predicted is not None and abs(vehicle_s - predicted) > STEP_S * max(1.0, self.rate):
            self._off_count += 1
            if self._off_count >= STEP_COUNT:
                self._restart()
        else:
            self._off_count = 0
        self._heard_s.append(station_s)
        self._told_s.append(vehicle_s)
        self._newest_s = station_s
        if station_s - self._estimated_at >= ESTIMATE_EVERY_S or len(self._heard_s) < FEW_SAMPLES:
            self._estimated_at = station_s
            self._estimate()

    def round_trip(self, seconds: float) -> None:
        """Take the time between a TIMESYNC request and its answer."""
        if 0 <= seconds < 2.0:
            self._round_trips.append(seconds)

    def _restart(self) -> None:
        del self._heard_s[:], self._told_s[:]
        self._newest_s = float("-inf")
        self._off_count = 0
        self._fit = None

    def _estimate(self) -> None:
        heard, told, now = self._heard_s, self._told_s, self._newest_s
        old = bisect_left(heard, now - WINDOW_S)
        del heard[:old], told[:old]
        if len(heard) < 4 or now - heard[0] < MIN_SPAN_S:
            return
        half = len(heard) // 2
        pairs = zip(heard, told, heard[half:], told[half:], strict=False)
        rate = median((v1 - v0) / (w1 - w0) for w0, v0, w1, v1 in pairs)
        if rate <= 0:
            return
        delay = min(self._round_trips, default=0.0) / 2
        envelope = max(v - rate * (w - now) for w, v in zip(heard, told, strict=True))
        self._fit = (now, envelope + rate * delay, rate)
