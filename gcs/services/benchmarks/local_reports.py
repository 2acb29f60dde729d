"""Case `reports`: how long replanning reports need to the station, and what a break of the link does to them."""

from __future__ import annotations

import itertools
import math
from typing import TYPE_CHECKING

import numpy as np

from gcs.planning.local.local_replan import MOST_POINTS
from gcs.services.benchmarks.report_world import ReportWorld, sample_report
from gcs.services.benchmarks.row import Row

if TYPE_CHECKING:
    from collections.abc import Sequence

    from gcs.core.replanning import ReplanReport

CASE = "reports"
LOSS = 0.1
REPORTS = 1000
USUAL, LARGEST = (30, 3), (MOST_POINTS, 8)
"""Points and viewpoints of a report: a usual one, and the largest that a navigator makes of a departure."""

IN_A_ROW = 3
ASKED, ASKED_S = "asked", 1.0
BREAK_S = 120.0
MADE_IN_BREAK = 40
PATIENCE_S = 60.0


def run(quick: bool) -> list[Row]:
    """Measure.

    Args:
        quick: few reports.
    """
    count = 100 if quick else REPORTS
    return [
        *_delays("", count, 1, USUAL),
        *_delays("largest.", count, 1, LARGEST),
        *_delays(f"{IN_A_ROW}_at_once.", count, IN_A_ROW, USUAL),
        *_delays(f"{IN_A_ROW}_largest_at_once.", count, IN_A_ROW, LARGEST),
        *_after_a_break(),
    ]


def _delays(name: str, count: int, in_a_row: int, size: tuple[int, int]) -> list[Row]:
    """Until the last of some reports is there, at 10 % loss each way and 50 ms from question to answer.

    Args:
        name: put before the figures'.
        count: how often.
        in_a_row: reports that are made at once.
        size: points and viewpoints of each.
    """
    delays = []
    for seed in range(count):
        world = ReportWorld(seed, loss=LOSS)
        for _ in range(in_a_row):
            world.outbox.add(sample_report(*size))
        world.run(PATIENCE_S)
        delays.append(world.stored[-1][0] if len(world.stored) == in_a_row else math.inf)
    rows = [Row(CASE, f"{name}delay_p{p}", float(np.percentile(delays, p)), "s", ASKED, ASKED_S) for p in (50, 95, 99)]
    return [*rows, Row(CASE, f"{name}delay_worst", max(delays), "s", ASKED, ASKED_S)]


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
        Row(CASE, "after_break_missing", float(MADE_IN_BREAK - len({r.number for r in reports})), "1", ASKED, 0.0),
        Row(CASE, "after_break_twice_or_out_of_order", float(_misplaced(reports)), "1", ASKED, 0.0),
        Row(CASE, "after_break_all_there", max(at_s for at_s, _ in world.stored) - back_s, "s"),
    ]


def _misplaced(reports: Sequence[ReplanReport]) -> int:
    numbers = [report.number for report in reports]
    return sum(later <= earlier for earlier, later in itertools.pairwise(numbers))
