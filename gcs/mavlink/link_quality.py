"""Link quality: messages per second, the share lost (from the gaps in sequence numbers), the round trip (TIMESYNC)."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from statistics import median

WINDOW_S = 10.0
SLICE_S = 0.5
RESTART_GAP = 128
QUESTIONS_OPEN = 16
ROUND_TRIPS_KEPT = 16
"""A question is asked once a second, so these are more than a window has."""


@dataclass(frozen=True)
class LinkQuality:
    """What the last `WINDOW_S` seconds were like.

    Attributes:
        messages_per_s: heard.
        loss: share of the sent messages that did not arrive, 0 to 1; None when nothing was heard.
        round_trip_s: median time from a question to its answer; None when none was answered.
    """

    messages_per_s: float
    loss: float | None
    round_trip_s: float | None = None


class SequenceMeter:
    """Counts messages and gaps of any number of senders; every component numbers its messages itself, modulo 256."""

    __slots__ = ("_heard", "_lost", "_next", "_since_s", "_slices")

    def __init__(self) -> None:
        self._next: dict[int, int] = {}
        self._heard = 0
        self._lost = 0
        self._since_s = float("-inf")
        self._slices: deque[tuple[float, int, int]] = deque()
        """When the slices of the window began (`_since_s`: the newest), and the counts of heard and lost until then."""

    def count(self, component_id: int, sequence: int, now_s: float) -> None:
        """Take the sequence number of a message.

        A message that comes twice or late (a gap of more than half the circle) counts as heard and ends no gap.
        """
        gap = (sequence - self._next.get(component_id, sequence)) % 256
        if now_s - self._since_s >= SLICE_S:
            self._since_s = now_s
            self._slices.append((now_s, self._heard, self._lost))
            self._forget(now_s)
        self._heard += 1
        if gap < RESTART_GAP:
            self._next[component_id] = sequence + 1
            if gap:
                self._lost += gap

    def restart(self) -> None:
        """The messages come another way from now on, on which they have other numbers."""
        self._next.clear()

    def quality(self, now_s: float) -> LinkQuality:
        """The quality over the window that ends now."""
        self._forget(now_s)
        if not self._slices:
            return LinkQuality(0.0, None)
        since_s, heard_before, lost_before = self._slices[0]
        heard, lost = self._heard - heard_before, self._lost - lost_before
        return LinkQuality(heard / max(now_s - since_s, 1.0), lost / (heard + lost))

    def _forget(self, now_s: float) -> None:
        while self._slices and self._slices[0][0] < now_s - WINDOW_S:
            self._slices.popleft()


class RoundTripMeter:
    """Times TIMESYNC questions.

    Only an answer to a question that was asked here counts, and once: on a shared link the answers to other stations
    are heard too, and what they carry is their clock.
    """

    def __init__(self) -> None:
        self._asked: deque[int] = deque(maxlen=QUESTIONS_OPEN)
        self._taken: deque[tuple[float, float]] = deque(maxlen=ROUND_TRIPS_KEPT)

    def ask(self, now_s: float) -> int:
        """A question is sent now: the time stamp (ns of the station's clock) that it carries."""
        stamp = int(now_s * 1e9)
        self._asked.append(stamp)
        return stamp

    def answered(self, stamp: int, now_s: float) -> float | None:
        """An answer with this time stamp was heard: its round trip (s); None when it answers no open question."""
        if stamp not in self._asked:
            return None
        self._asked.remove(stamp)
        round_trip_s = max(now_s - stamp * 1e-9, 0.0)
        self._taken.append((now_s, round_trip_s))
        return round_trip_s

    def median_s(self, now_s: float) -> float | None:
        """The median of the round trips that ended in the last `WINDOW_S` seconds; None when there was none."""
        fresh = [seconds for at, seconds in self._taken if at >= now_s - WINDOW_S]
        return median(fresh) if fresh else None
