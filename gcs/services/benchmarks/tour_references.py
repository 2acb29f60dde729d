"""Other tour solvers, run beside ours where they are installed; none of them is needed."""

from __future__ import annotations

from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

OR_TOOLS, FAST_TSP, LKH = "ortools", "fast-tsp", "elkai"
REFERENCES = (OR_TOOLS, FAST_TSP, LKH)
"""Names in the rows; elkai wraps LKH-3."""

LARGEST_INTEGER = 65535
FINE = 10_000
"""Integer steps of a unit of cost."""

MUST_VISIT = 10**12
"""Penalty for a target that is left out."""


def reference_tour(name: str, costs: NDArray[np.float64], seconds: float) -> NDArray[np.int64] | None:
    """A closed tour by another solver.

    Args:
        name: one of `REFERENCES`.
        costs: symmetric, shape (n, n).
        seconds: what it may take; LKH makes one run instead.

    Returns:
        The nodes in visiting order, or None when it is not installed.
    """
    if find_spec(name.replace("-", "_")) is None:
        return None
    solvers: dict[str, Callable[[NDArray[np.float64], float], Any]] = {
        OR_TOOLS: _or_tools,
        FAST_TSP: _fast_tsp,
        LKH: _lkh,
    }
    return np.asarray(solvers[name](costs, seconds), dtype=np.int64)


def reference_generalised_tour(
    costs: NDArray[np.float64], targets: NDArray[np.int64], seconds: float
) -> NDArray[np.int64] | None:
    """A closed tour through one candidate of each target by OR-Tools, or None when it is not installed.

    Args:
        costs: between candidates, shape (n, n).
        targets: which target each is for, shape (n,); candidate 0 is the only one of target 0.
        seconds: what it may take.
    """
    if find_spec(OR_TOOLS) is None:
        return None
    return np.asarray(_routing(costs, seconds, targets), dtype=np.int64)


def _fast_tsp(costs: NDArray[np.float64], seconds: float) -> Any:
    import fast_tsp

    scaled = np.rint(costs * (LARGEST_INTEGER / max(float(costs.max()), 1e-300))).astype(np.int64)
    return fast_tsp.find_tour(scaled, seconds)


def _lkh(costs: NDArray[np.float64], seconds: float) -> Any:  # noqa: ARG001 - it takes no limit
    import elkai  # type: ignore[import-not-found, unused-ignore]

    return elkai.DistanceMatrix(np.rint(costs * FINE).astype(np.int64).tolist()).solve_tsp(runs=1)[:-1]


def _or_tools(costs: NDArray[np.float64], seconds: float) -> Any:
    return _routing(costs, seconds, None)


def _routing(costs: NDArray[np.float64], seconds: float, targets: NDArray[np.int64] | None) -> list[int]:
    from ortools.constraint_solver import (  # type: ignore[import-not-found, unused-ignore]
        pywrapcp,
        routing_enums_pb2,
    )

    manager = pywrapcp.RoutingIndexManager(len(costs), 1, 0)
    model = pywrapcp.RoutingModel(manager)
    model.SetArcCostEvaluatorOfAllVehicles(model.RegisterTransitMatrix(np.rint(costs * FINE).astype(np.int64).tolist()))
    if targets is not None:
        for target in range(1, int(targets.max()) + 1):
            group = [manager.NodeToIndex(int(c)) for c in np.flatnonzero(targets == target)]
            model.AddDisjunction(group, MUST_VISIT, 1)
    parameters = pywrapcp.DefaultRoutingSearchParameters()
    parameters.first_solution_strategy = routing_enums_pb2.FirstSolutionStrategy.PATH_CHEAPEST_ARC
    parameters.local_search_metaheuristic = routing_enums_pb2.LocalSearchMetaheuristic.GUIDED_LOCAL_SEARCH
    parameters.time_limit.FromMilliseconds(int(1000 * seconds))
    solution = model.SolveWithParameters(parameters)
    order, index = [], model.Start(0)
    while not model.IsEnd(index):
        order.append(manager.IndexToNode(index))
        index = solution.Value(model.NextVar(index))
    return order
