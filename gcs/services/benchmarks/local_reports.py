"""Case `reports`: how long replanning reports need to the station, and what a break of the link does to them."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING

import numpy as np

from gcs.services.benchmarks.report_world import ReportWorld, sample_report
from gcs.services.benchmarks.row import Row

if TYPE_CHECKING:
    from collections.abc import Sequence

    from gcs.core.replanning import ReplanReport

CASE = "reports"
LOSS = 0.1
REPORTS = 1000
LIMIT_S = 1.0
BREAK_S = 120.0
MADE_IN_BREAK = 40
PATIENCE_S = 60.0


def run(quick: bool) -> list[Row]:
    """Measure.

    Args:
        quick: few reports.
    """
    return [*_delays(100 if quick else REPORTS), *_after_a_break()]


def _delays(count: int) -> list[Row]:
    """Of reports with 30 points and 3 viewpoints, at 10 % loss each way and 50 ms from question to answer."""
    delays = []
    for seed in range(count):
        world = ReportWorld(seed, loss=LOSS)
        world.outbox.add(sample_report())
        world.run(PATIENCE_S)
        delays.append(world.stored[0][0] if world.stored else PATIENCE_S)
    rows = [Row(CASE, f"delay_p{p}", float(np.percentile(delays, p)), "s", "limit", LIMIT_S) for p in (50, 95, 99)]
    return [*rows, Row(CASE, "delay_worst", max(delays), "s", "limit", LIMIT_S)]


def _after_a_break() -> list[Row]:
    """Of reports that were made while nothing came through for two minutes; then at 10 % loss again."""
    world = ReportWorld(1, loss=LOSS)
    world.broken = True
    for _ in range(MADE_IN_BREAK):
        world.outbox.add(sample_report())
        world.run(BREAK_S / MADE_IN_BREAK)
    world.broken = False
    back_s = world.now_s
    world.run(PATIENCE_S)
    reports = [report for _, report in world.stored]
    return [
        Row(CASE, "after_break_missing", float(MADE_IN_BREAK - len({r.number for r in reports})), "1", "limit", 0.0),
        Row(CASE, "after_break_twice_or_out_of_order", float(_misplaced(reports)), "1", "limit", 0.0),
        Row(CASE, "after_break_all_there", max(at_s for at_s, _ in world.stored) - back_s, "s"),
    ]


def _misplaced(reports: Sequence[ReplanReport]) -> int:
    numbers = [report.number for report in reports]
    return sum(later <= earlier for earlier, later in itertools.pairwise(numbers))
