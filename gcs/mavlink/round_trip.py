"""How long to wait for an answer: a smoothed round trip and its spread (Jacobson 1988, RFC 6298)."""

from __future__ import annotations

GROWTH = 1.15
"""Each further try waits longer by this factor: lost packets are commoner on radio links than long queues."""


class RoundTrip:
    """Estimate of the round trip.

    Args:
        shortest_s: an answer is never waited for shorter than this.
        longest_s: nor longer than this.
    """

    def __init__(self, shortest_s: float, longest_s: float) -> None:
        self._shortest_s, self._longest_s = shortest_s, longest_s
        self._mean_s: float | None = None
        self._spread_s = 0.0

    def measured(self, sample_s: float) -> None:
        """Take one round trip (s) of a request that was sent once: a repeated one says nothing (Karn's rule)."""
        if self._mean_s is None:
            self._mean_s, self._spread_s = sample_s, sample_s / 2
        else:
            self._spread_s = 0.75 * self._spread_s + 0.25 * abs(self._mean_s - sample_s)
            self._mean_s = 0.875 * self._mean_s + 0.125 * sample_s

    def timeout_s(self, tries: int = 0, patience: float = 1.0) -> float:
        """How long to wait (s) after so many unanswered tries; `patience` stretches both limits."""
        base = self._shortest_s * patience
        if self._mean_s is not None:
            base = max(base, self._mean_s + 4 * self._spread_s)
        return float(min(base * GROWTH**tries, self._longest_s * patience))
