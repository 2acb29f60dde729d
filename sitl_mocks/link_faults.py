"""Faults of a link by name: what it does to packets, and when that changes."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from random import Random

from sitl_mocks.channel import LinkFaults

Change = tuple[float, Mapping[str, float]]
"""Seconds after the start, and fields of `LinkFaults` to set then."""

_57600_BAUD_BYTES_PER_S = 5760.0
_OTHER_TRAFFIC = 0.8


def _from_the_start(**fields: float) -> list[Change]:
    return [(0.0, fields)]


def _link_changes(rng: Random) -> list[Change]:
    lost_s = rng.uniform(0.0, 0.5)
    return [(lost_s, {"cut": True}), (lost_s + rng.uniform(0.5, 6.0), {"cut": False, "latency_s": 0.25})]


def _link_gone(rng: Random) -> list[Change]:
    return [(rng.uniform(0.0, 0.6), {"cut": True})]


LINK_FAULTS: dict[str, Callable[[Random], list[Change]]] = {
    "doubled": lambda _: _from_the_start(duplicate=1.0),
    "reordered": lambda _: _from_the_start(delay_s=2.0),
    "corrupt": lambda _: _from_the_start(corrupt=0.15),
    "cut-frames": lambda _: _from_the_start(shortened=0.15),
    "mavlink-1": lambda _: _from_the_start(mavlink_1=True),
    "baud-57600": lambda _: _from_the_start(
        bytes_per_s=_57600_BAUD_BYTES_PER_S * (1.0 - _OTHER_TRAFFIC), latency_s=0.1
    ),
    "link-change": _link_changes,
    "link-gone": _link_gone,
}
"""By name, from a random number generator to the changes."""


def link_changes(names: Iterable[str], rng: Random) -> list[Change]:
    """What those of some faults that are of links do to one."""
    return sorted(
        (change for name in names if name in LINK_FAULTS for change in LINK_FAULTS[name](rng)), key=lambda c: c[0]
    )


SEVERING = frozenset({"link-gone"})
"""Those after which nothing passes any more."""


class ChangingLink:
    """Lets the faults of a link change with time.

    Args:
        faults: of the link.
        changes: in the order of their times.
        start_s: wall time of the start.
    """

    def __init__(self, faults: LinkFaults, changes: list[Change], start_s: float) -> None:
        self._faults = faults
        self._left = [(start_s + after_s, fields) for after_s, fields in changes]

    @property
    def next_s(self) -> float:
        """Wall time of the next change."""
        return self._left[0][0] if self._left else math.inf

    def step(self, wall_s: float) -> None:
        """Make the changes whose time has come."""
        while self._left and self._left[0][0] <= wall_s:
            for name, value in self._left.pop(0)[1].items():
                setattr(self._faults, name, value)
