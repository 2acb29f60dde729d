"""Case `flights` of benchmark `local`: companions fly a plan among random obstacles, over links that lose packets."""

from __future__ import annotations

import multiprocessing
import resource
from collections import Counter
from concurrent.futures import ProcessPoolExecutor

from gcs.services.benchmarks.companion_flights import FlightOutcome, fly_once
from gcs.services.benchmarks.lockstep_worlds import LockstepWorlds
from gcs.services.benchmarks.row import Row

FLIGHTS = 200
QUICK_SEEDS = [106, 7]
"""Short flights: in the second one something has to be flown round."""

PROCESSES = 2
ASKED = "asked"


def flight_rows(quick: bool) -> list[Row]:
    """Measure.

    Args:
        quick: one flight with each autopilot.
    """
    begin_s = _cpu_s()
    if quick:
        return rows_of(fly_all(QUICK_SEEDS), _cpu_s() - begin_s)
    seeds = [list(range(first, FLIGHTS, PROCESSES)) for first in range(PROCESSES)]
    with ProcessPoolExecutor(PROCESSES, multiprocessing.get_context("spawn")) as pool:
        outcomes = [outcome for part in pool.map(fly_all, seeds) for outcome in part]
    return rows_of(outcomes, _cpu_s() - begin_s)


def fly_all(seeds: list[int]) -> list[FlightOutcome]:
    """Fly once for each seed, many at a time in this process."""
    with LockstepWorlds() as worlds:
        return list(worlds.run_all(fly_once(seed) for seed in seeds))


def rows_of(outcomes: list[FlightOutcome], cpu_s: float) -> list[Row]:
    """The figures of some flights.

    Args:
        outcomes: what became of each.
        cpu_s: time of the processor that all of them took.
    """
    case, count = f"flights-{len(outcomes)}", len(outcomes)
    made = sum(outcome.reports_made for outcome in outcomes)
    reasons = Counter(reason for outcome in outcomes for reason in outcome.skipped)
    figures = [
        ("collisions", sum(bool(outcome.touched) for outcome in outcomes), 0.0),
        ("viewpoints", sum(outcome.viewpoints for outcome in outcomes), None),
        ("photographed", sum(outcome.photographed for outcome in outcomes), None),
        ("moved_and_photographed", sum(outcome.moved for outcome in outcomes), None),
        ("skipped_and_reported", sum(reasons.values()), None),
        *((f"skipped.{reason.name.lower()}", number, None) for reason, number in sorted(reasons.items())),
        ("skipped_though_reachable", sum(outcome.reachable for outcome in outcomes), None),
        ("unaccounted", sum(outcome.unaccounted for outcome in outcomes), 0.0),
        ("reports", made, None),
        ("reports_not_once", made - sum(outcome.reports_once for outcome in outcomes), 0.0),
        ("ended_by_hand", sum(outcome.by_hand is not None for outcome in outcomes), None),
    ]
    rows = [
        Row(case, name, float(value), "1", None if asked is None else ASKED, asked) for name, value, asked in figures
    ]
    return [
        *rows,
        Row(case, "least_distance_m", min(outcome.least_m for outcome in outcomes), "m"),
        Row(case, "flown_s", sum(outcome.flown_s for outcome in outcomes) / count, "s"),
        Row(case, "cpu_s_per_flight", cpu_s / count, "s"),
    ]


def _cpu_s() -> float:
    """Time of the processor that this process and those that it waited for have taken."""
    used = [resource.getrusage(whose) for whose in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(one.ru_utime + one.ru_stime for one in used)
