"""Two vehicles that use one system id: noticed by what a single vehicle cannot do.

- Its clock goes back again and again (`RETURNS` times within `WATCHED_S`): two clocks are heard in turns. A reboot sets
  it back once.
- Its packets on one way are numbered by two counters in turns. Loss leaves gaps, a late packet steps back a little; but
  none goes on exactly where another count was left, again and again.
- It gives two unit numbers (AUTOPILOT_VERSION) on two ways.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Hashable

WATCHED_S = 5.0
RETURNS = 3
CLOCK_BACK_S = 2.0
COUNTER_RETURNS = 8
FAR_APART = 16
"""Packet numbers this close may be one count, with packets lost or late."""
MAX_WAYS = 64
"""Ways that are kept apart; whoever makes up more of them makes the watch begin anew."""
KEPT_S = 15.0
"""For so long after its last sign a clash is taken to go on."""


class IdClashWatch:
    """Watches the autopilot of one system id, over all ways on which it is heard."""

    def __init__(self) -> None:
        self._newest_boot_s: float | None = None
        self._clock_returns: deque[float] = deque(maxlen=RETURNS)
        self._counters: dict[Hashable, _TwoCounters] = {}
        self._units: dict[Hashable, tuple[str, float]] = {}
        self._reason: str | None = None
        self._seen_at = float("-inf")

    def reason(self, now_s: float) -> str | None:
        """How two vehicles were told apart, in words for people; None when there is but one."""
        return self._reason if now_s - self._seen_at < KEPT_S else None

    def clock(self, boot_s: float, now_s: float, rate: float = 1.0) -> None:
        """Take the vehicle's clock (s since boot) as one of its messages has it.

        Args:
            boot_s: of the message.
            now_s: the station's monotonic time.
            rate: vehicle seconds per station second.
        """
        newest, self._newest_boot_s = self._newest_boot_s, boot_s
        if newest is None or boot_s >= newest - CLOCK_BACK_S * max(rate, 1.0):
            return
        self._clock_returns.append(now_s)
        if len(self._clock_returns) == RETURNS and now_s - self._clock_returns[0] < WATCHED_S:
            self._found(f"clocks {newest - boot_s:.0f} s apart are heard in turns", now_s)

    def jump(self, way: Hashable, earlier: int, sequence: int, now_s: float) -> None:
        """Take the numbers of two packets, one after the other on a way, that do not follow each other."""
        counters = self._counters.get(way)
        if counters is None:
            if len(self._counters) >= MAX_WAYS:
                self._counters.clear()
                self._units.clear()
            counters = self._counters[way] = _TwoCounters()
        if counters.returns(earlier, sequence, now_s):
            self._found("packets are numbered by two counters in turns", now_s)

    def unit(self, way: Hashable, unit: str, now_s: float) -> None:
        """Take the unit number that was told on a way."""
        self._units[way] = (unit, now_s)
        others = [other for other, at in self._units.values() if other != unit and now_s - at < KEPT_S]
        if others:
            self._found(f"units {others[0]} and {unit} answer", now_s)

    def _found(self, reason: str, now_s: float) -> None:
        self._reason, self._seen_at = reason, now_s


class _TwoCounters:
    """The packet numbers of one way: where a count was left."""

    def __init__(self) -> None:
        self._left: int | None = None
        self._returned = False
        self._returns: deque[float] = deque(maxlen=COUNTER_RETURNS)

    def returns(self, here: int, sequence: int, now_s: float) -> bool:
        """Whether, with this number, it has gone to and fro between two counts too often for one vehicle."""
        left, step = self._left, (sequence - here) % 256
        if step <= FAR_APART or step >= 256 - FAR_APART:
            return False
        self._left = here
        returned_before, self._returned = self._returned, left is not None and sequence == (left + 1) % 256
        if not (returned_before and self._returned):  # both must go on: a stranger's numbers that stand still do not
            return False
        self._returns.append(now_s)
        return len(self._returns) == COUNTER_RETURNS and now_s - self._returns[0] < WATCHED_S
