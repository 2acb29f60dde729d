"""OMPL's planners on the yard paper's query, run beside ours where OMPL is installed."""

from __future__ import annotations

import time
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Sequence

REFERENCES = ("RRTstar", "InformedRRTstar", "BITstar")
"""OMPL's names of RRT*, Informed RRT* and BIT*."""

LONGEST_S = 10.0


def seconds_until(
    name: str,
    start_m: Sequence[float],
    goal_m: Sequence[float],
    box_m: Sequence[Sequence[float]],
    side_m: float,
    length_m: float,
    runs: int,
) -> list[float] | None:
    """How long a planner of OMPL takes until its way round a box is short enough.

    Args:
        name: one of `REFERENCES`.
        start_m: (2,).
        goal_m: (2,).
        box_m: low and high corner of the obstacle.
        side_m: the square map reaches from 0 to here on both axes.
        length_m: what is short enough.
        runs: how many.

    Returns:
        Seconds of each run, at most `LONGEST_S`; None when OMPL is not installed.
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

    seconds = []
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
        seconds.append(time.thread_time() - begin)
    return seconds


def _state(space: Any, point_m: Sequence[float]) -> Any:
    state = space.allocState()
    state[0], state[1] = point_m
    return state
