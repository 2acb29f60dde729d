"""OMPL's planners on the yard paper's query, run beside ours where OMPL is installed."""

from __future__ import annotations

import math
import time
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Sequence

REFERENCES = {"RRTstar": "rrt_star", "InformedRRTstar": "informed_rrt_star", "BITstar": "bit_star"}
"""OMPL's names of RRT*, Informed RRT* and BIT*, and ours."""

LONGEST_S = 10.0


class ReferenceRun(NamedTuple):
    """A run of a planner.

    Attributes:
        seconds: until its way was short enough; infinity when it never was.
        length_m: of its way in the end.
    """

    seconds: float
    length_m: float


def reference_runs(
    name: str,
    start_m: Sequence[float],
    goal_m: Sequence[float],
    box_m: Sequence[Sequence[float]],
    side_m: float,
    length_m: float,
    runs: int,
) -> list[ReferenceRun] | None:
    """Have a planner of OMPL look for a way round a box that is short enough.

    Args:
        name: one of `REFERENCES`.
        start_m: (2,).
        goal_m: (2,).
        box_m: low and high corner of the obstacle.
        side_m: the square map reaches from 0 to here on both axes.
        length_m: what is short enough.
        runs: how many.

    Returns:
        Each run, of at most `LONGEST_S`; None when OMPL is not installed.
    """
    if find_spec("ompl") is None:
        return None
    from ompl import base, geometric, util  # type: ignore[import-not-found, unused-ignore]

    util.setLogLevel(util.LogLevel.LOG_NONE)
    space = base.RealVectorStateSpace(2)
    bounds = base.RealVectorBounds(2)
    bounds.setLow(0.0)
    bounds.setHigh(side_m)
    space.setBounds(bounds)
    (west, south), (east, north) = box_m

    def free(state: Any) -> bool:
        return not (west < state[0] < east and south < state[1] < north)

    found = []
    for _ in range(runs):
        setup = geometric.SimpleSetup(space)
        information = setup.getSpaceInformation()
        setup.setStateValidityChecker(free)
        # Steps of a cell's edge: the resolution is a share of the map's diagonal.
        information.setStateValidityCheckingResolution(0.1 / space.getMaximumExtent())
        setup.setStartAndGoalStates(_state(space, start_m), _state(space, goal_m))
        objective = base.PathLengthOptimizationObjective(information)
        objective.setCostThreshold(base.Cost(length_m))
        setup.setOptimizationObjective(objective)
        setup.setPlanner(getattr(geometric, name)(information))
        setup.setup()
        begin = time.thread_time()
        setup.solve(LONGEST_S)
        seconds = time.thread_time() - begin
        way_m = setup.getSolutionPath().length() if setup.haveExactSolutionPath() else math.inf
        found.append(ReferenceRun(seconds if way_m <= length_m else math.inf, way_m))
    return found


def _state(space: Any, point_m: Sequence[float]) -> Any:
    state = space.allocState()
    state[0], state[1] = point_m
    return state
