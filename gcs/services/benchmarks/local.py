"""Benchmark `local`: the yard paper's query by every planner (its Table 3), and random fields against the optimum."""

from __future__ import annotations

import itertools
import logging
import math
import time
from typing import TYPE_CHECKING

import numpy as np

from gcs.planning.local.bidirectional_rrt_star import BidirectionalRrtStar
from gcs.planning.local.binary_map import BinaryMap
from gcs.planning.local.convex_obstacles import ConvexObstacles
from gcs.planning.local.intelligent_bidirectional_rrt_star import IntelligentBidirectionalRrtStar
from gcs.planning.local.rrt import Rrt
from gcs.planning.local.rrt_star import RrtStar
from gcs.planning.local.sampling_planner import SamplingOptions, search_path
from gcs.planning.local.tangent_path import shortest_path
from gcs.services.benchmarks import companion_latency, local_cooperative, local_reports
from gcs.services.benchmarks.local_fields import Field, collides, exact_length, random_field
from gcs.services.benchmarks.local_flights import flight_rows
from gcs.services.benchmarks.local_references import REFERENCES, reference_runs
from gcs.services.benchmarks.row import Row

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from gcs.planning.local.sampling_planner import SamplingPlanner
    from gcs.planning.local.tangent_path import LocalPath

log = logging.getLogger(__name__)

START_M, GOAL_M = (6.7, 29.6), (39.9, 29.6)
BOX_M = ((19.8, 24.7), (26.8, 34.9))
"""The obstacle, grown by the safe distance: the paper shows its own in a figure alone."""

CELL_M, CELLS = 0.1, 460
OPTIMUM_M = 2 * math.hypot(BOX_M[0][0] - START_M[0], START_M[1] - BOX_M[0][1]) + BOX_M[1][0] - BOX_M[0][0]
NEAR_OPTIMUM = 1.01

PAPER = "yard paper, table 3"
TABLE_3: dict[type[SamplingPlanner], tuple[str, float, float]] = {
    Rrt: ("rrt", 2.352, 45.155),
    RrtStar: ("rrt_star", 5.218, 35.619),
    BidirectionalRrtStar: ("bi_rrt_star", 2.421, 35.355),
    IntelligentBidirectionalRrtStar: ("ib_rrt_star", 1.080, 35.286),
}
"""Our name of each planner, and the paper's mean seconds and metres in ten runs."""

ASKED_S = 0.054
"""A twentieth of the paper's time, for the planner that it proposes."""

RUNS = 10
PATIENCE = 20_000
"""Samples of an anytime planner before it counts as never near the optimum."""

BETWEEN_LOOKS = 50
FIELD_SEED = 1


def run(quick: bool) -> list[Row]:
    """Measure.

    Args:
        quick: few runs and fields.
    """
    return [
        *_paper_query(2 if quick else RUNS),
        *_random_fields(20 if quick else 1000),
        *local_cooperative.run(quick),
        *local_reports.run(quick),
        *companion_latency.run(quick),
        *flight_rows(quick),
    ]


def paper_map() -> BinaryMap:
    """The paper's query as a binarised map that is already grown."""
    blocked = np.zeros((CELLS, CELLS), dtype=np.bool_)
    (west, south), (east, north) = np.rint(np.array(BOX_M) / CELL_M).astype(int)
    blocked[west:east, south:north] = True
    return BinaryMap(blocked, np.zeros(2), CELL_M)


def _paper_query(runs: int) -> list[Row]:
    case, area = "paper-query", paper_map()
    flown = shortest_path(START_M, GOAL_M, area=area)
    times = [_cpu_seconds(lambda: shortest_path(START_M, GOAL_M, area=area)) for _ in range(10 * runs)]
    rows = [
        Row(case, "median_ms", 1e3 * float(np.median(times)), "ms"),
        Row(case, "worst_ms", 1e3 * max(times), "ms"),
        Row(case, "excess_length", flown.length_m / OPTIMUM_M - 1, "1", "closed form", 0.0),
    ]
    for planner, (name, paper_s, paper_m) in TABLE_3.items():
        search_path(planner(area, START_M, GOAL_M))  # loads the compiled kernels
        seconds, lengths = zip(*[_table_run(planner, area, seed) for seed in range(runs)], strict=True)
        rows.append(Row(case, f"{name}.seconds", float(np.mean(seconds)), "s", PAPER, paper_s))
        rows.append(Row(case, f"{name}.length_m", float(np.mean(lengths)), "m", PAPER, paper_m))
        if planner is not Rrt:
            until = [_seconds_to_near_optimum(planner, area, seed) for seed in range(runs)]
            asked = ("asked", ASKED_S) if planner is IntelligentBidirectionalRrtStar else (PAPER, paper_s)
            rows.append(Row(case, f"{name}.seconds_to_1_percent", float(np.mean(until)), "s", *asked))
    for theirs, name in REFERENCES.items():
        found = reference_runs(theirs, START_M, GOAL_M, BOX_M, CELLS * CELL_M, NEAR_OPTIMUM * OPTIMUM_M, runs)
        if found is None:
            log.warning("OMPL is not installed: its %s is left out", theirs)
            continue
        seconds, lengths = zip(*found, strict=True)
        rows.append(Row(case, f"ompl.{name}.seconds_to_1_percent", float(np.mean(seconds)), "s"))
        rows.append(Row(case, f"ompl.{name}.length_m", float(np.mean(lengths)), "m", "closed form", OPTIMUM_M))
    return rows


def _table_run(planner: type[SamplingPlanner], area: BinaryMap, seed: int) -> tuple[float, float]:
    """Seconds and length of a run with the paper's number of samples."""
    ways: list[NDArray[np.float64]] = []
    search = planner(area, START_M, GOAL_M, SamplingOptions(seed=seed))
    seconds = _cpu_seconds(lambda: ways.append(search_path(search)))
    return seconds, _length_m(ways[0])


def _seconds_to_near_optimum(planner: type[SamplingPlanner], area: BinaryMap, seed: int) -> float:
    """Until the best way is within 1 % of the optimum; infinity when it never is."""
    search = planner(area, START_M, GOAL_M, SamplingOptions(iterations=PATIENCE, seed=seed))
    begin = time.thread_time()
    while not search.finished:
        search.grow(BETWEEN_LOOKS)
        way = search.best()
        if way is not None and _length_m(way) <= NEAR_OPTIMUM * OPTIMUM_M:
            return time.thread_time() - begin
    return math.inf


def _random_fields(fields: int) -> list[Row]:
    rng = np.random.default_rng(FIELD_SEED)
    seconds, excess, collisions = [], [], 0
    shortest_path(START_M, GOAL_M, ConvexObstacles.of(random_field(np.random.default_rng(0)).polygons_m))  # is loaded
    for _ in range(fields):
        field = random_field(rng)
        paths: list[LocalPath] = []

        def plan(field: Field = field, paths: list[LocalPath] = paths) -> None:
            paths.append(shortest_path(field.start_m, field.goal_m, ConvexObstacles.of(field.polygons_m)))

        seconds.append(_cpu_seconds(plan))
        excess.append(paths[0].length_m / exact_length(field) - 1)
        collisions += collides(paths[0].points_m, field.polygons_m)
    case, oracle = f"random-{fields}", "visibility graph"
    return [
        Row(case, "median_ms", 1e3 * float(np.median(seconds)), "ms"),
        Row(case, "worst_ms", 1e3 * max(seconds), "ms"),
        Row(case, "excess_length", float(max(excess)), "1", oracle, 0.0),
        Row(case, "collisions", float(collisions), "1", oracle, 0.0),
    ]


def _cpu_seconds(action: Callable[[], object]) -> float:
    """Time of the processor that this thread takes for an action."""
    begin = time.thread_time()
    action()
    return time.thread_time() - begin


def _length_m(points: NDArray[np.float64]) -> float:
    return sum(math.dist(a, b) for a, b in itertools.pairwise(points))
