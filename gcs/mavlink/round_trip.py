"""How long to wait for an answer: a smoothed round trip and its spread (Jacobson 1988, RFC 6298)."""

from __future__ import annotations

GROWTH = 1.15
"""Each further try waits longer by this factor: lost packets are commoner on radio links than long queues."""
_MOST_GROWTH = 40
_LEAST_MARGIN_S = 0.02


class RoundTrip:
    """Estimate of the round trip.

    Args:
        first_s: how long an answer is waited for before anything was measured.
        longest_s: an answer is never waited for longer than this.
        shortest_s: nor shorter than this; `first_s` by default.
    """

    def __init__(self, first_s: float, longest_s: float, shortest_s: float | None = None) -> None:
        self._first_s, self._longest_s = first_s, longest_s
        self._shortest_s = first_s if shortest_s is None else shortest_s
        self._mean_s: float | None = None
        self._spread_s = 0.0

    @property
    def known(self) -> bool:
        """Whether a round trip was measured."""
        return self._mean_s is not None

    def measured(self, sample_s: float) -> None:
        """Take one round trip (s) of a request that was sent once: a repeated one says nothing (Karn's rule)."""
        if self._mean_s is None:
            self._mean_s, self._spread_s = sample_s, sample_s / 2
        else:
            self._spread_s = 0.75 * self._spread_s + 0.25 * abs(self._mean_s - sample_s)
            self._mean_s = 0.875 * self._mean_s + 0.125 * sample_s

    def timeout_s(self, tries: int = 0, patience: float = 1.0) -> float:
        """How long to wait (s) after so many unanswered tries; `patience` stretches both limits."""
        base = self._first_s
        if self._mean_s is not None:
            base = max(self._shortest_s, self._mean_s + max(4 * self._spread_s, _LEAST_MARGIN_S))
        base *= patience
        return float(min(base * GROWTH ** min(tries, _MOST_GROWTH), self._longest_s * patience))
