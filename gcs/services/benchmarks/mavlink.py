"""Benchmark `mavlink`: transfers, gateway, setpoint stream and images over good and bad links."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gcs.services.benchmarks import (
    mavlink_faults,
    mavlink_fuzz,
    mavlink_gateway,
    mavlink_image,
    mavlink_links,
    mavlink_offboard,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from gcs.services.benchmarks.row import Row

CASES: tuple[Callable[[bool], list[Row]], ...] = (
    mavlink_faults.run,
    mavlink_links.run,
    mavlink_image.run,
    mavlink_gateway.run,
    mavlink_offboard.run,
    mavlink_fuzz.run,
)
"""Each takes `quick` and returns its rows; they run one after the other, so that none disturbs another's times."""


def run(quick: bool) -> list[Row]:
    """Measure.

    Args:
        quick: a small version of every case, in seconds.
    """
    return [row for case in CASES for row in case(quick)]
