"""Link quality: messages per second and the share that was lost, from the gaps in sequence numbers."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

WINDOW_S = 10.0
RESTART_GAP = 128


@dataclass(frozen=True)
class LinkQuality:
    """What the last `WINDOW_S` seconds were like.

    Attributes:
        messages_per_s: heard.
        loss: share of the sent messages that did not arrive, 0 to 1; None when nothing was heard.
    """

    messages_per_s: float
    loss: float | None


class SequenceMeter:
    """Counts messages and gaps of any number of senders; every component numbers its messages itself, modulo 256."""

    def __init__(self) -> None:
        self._last: dict[int, int] = {}
        self._heard: deque[tuple[float, int]] = deque()
        self._lost = 0
        self._since: float | None = None

    def count(self, component_id: int, sequence: int, now_s: float) -> None:
        """Take the sequence number of a message.

        A message that comes twice or late (a gap of more than half the circle) counts as heard and ends no gap.
        """
        if self._since is None:
            self._since = now_s
        last = self._last.get(component_id)
        gap = 0 if last is None else (sequence - last - 1) % 256
        if gap >= RESTART_GAP:
            gap = 0
        else:
            self._last[component_id] = sequence
        self._heard.append((now_s, gap))
        self._lost += gap
        self._forget(now_s)

    def quality(self, now_s: float) -> LinkQuality:
        """The quality over the window that ends now."""
        self._forget(now_s)
        heard = len(self._heard)
        if self._since is None or heard == 0:
            return LinkQuality(0.0, None)
        span = min(WINDOW_S, max(now_s - self._since, 1.0))
        return LinkQuality(heard / span, self._lost / (heard + self._lost))

    def _forget(self, now_s: float) -> None:
        while self._heard and self._heard[0][0] < now_s - WINDOW_S:
            self._lost -= self._heard.popleft()[1]
