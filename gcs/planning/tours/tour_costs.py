"""Costs between the nodes of a tour: a matrix, or points whose distances are computed where they are needed."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

import numpy as np

from gcs.planning.numerics.compiled import compiled

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

Floats = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Ints = np.ndarray[tuple[int, ...], np.dtype[np.int64]]


@dataclass(frozen=True, eq=False)
class TourCosts:
    """Symmetric costs between n nodes.

    Attributes:
        data: costs, shape (n, n); or a row `x, y, z, weight` for each node, shape (n, 4), where the cost of a pair is
            its distance times both weights.
        from_points: whether `data` are points.
    """

    data: NDArray[np.float64]
    from_points: bool

    @classmethod
    def of_matrix(cls, costs: ArrayLike) -> Self:
        """Costs that are known for all pairs, shape (n, n), symmetric and not negative."""
        return cls(np.ascontiguousarray(costs, dtype=np.float64), from_points=False)

    @classmethod
    def of_points(cls, points: ArrayLike, *, free_node: bool = False) -> Self:
        """Distances between points.

        Args:
            points: in a space where distance is cost, shape (n, 3).
            free_node: put a node 0 before them that costs nothing to reach.
        """
        given = np.asarray(points, dtype=np.float64).reshape(-1, 3)
        weighted = np.column_stack([given, np.ones(len(given))])
        if free_node:
            weighted = np.concatenate([np.zeros((1, 4)), weighted])
        return cls(np.ascontiguousarray(weighted), from_points=True)

    def __len__(self) -> int:
        return len(self.data)

    def of_tour(self, order: NDArray[np.int64], *, closed: bool = True) -> float:
        """Cost of visiting nodes in an order, with the way back when it is closed."""
        order = np.asarray(order, dtype=np.int64)
        return float(_cost_of_order(self.data, self.from_points, order, closed))

    def matrix(self) -> NDArray[np.float64]:
        """Costs of all pairs, shape (n, n)."""
        if not self.from_points:
            return self.data
        points, weight = self.data[:, :3], self.data[:, 3]
        apart = np.linalg.norm(points[:, None] - points[None], axis=-1)
        return np.asarray(apart * weight[:, None] * weight[None])

    def nearest(self, count: int, nodes: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """The cheapest others of each of some nodes, among the same.

        Args:
            count: how many are wanted; less than the number of nodes.
            nodes: which ones, shape (m,); among points, without one that costs nothing to reach.

        Returns:
            The others, shape (m, count), and their costs, ascending in each row.
        """
        rows = np.arange(len(nodes))
        if self.from_points:
            from scipy.spatial import KDTree

            points = self.data[nodes, :3]
            found = KDTree(points).query(points, count + 1)
            costs, others = np.asarray(found[0]), np.asarray(found[1])
            mine = others == rows[:, None]
            mine[~mine.any(axis=1), -1] = True  # many nodes in one place: it was not among the nearest itself
            others, costs = others[~mine].reshape(-1, count), costs[~mine].reshape(-1, count)
        else:
            among = self.data[np.ix_(nodes, nodes)]
            among[rows, rows] = math.inf
            others = np.argpartition(among, count - 1, axis=1)[:, :count]
            costs = among[rows[:, None], others]
            by_cost = np.argsort(costs, axis=1, kind="stable")
            others, costs = others[rows[:, None], by_cost], costs[rows[:, None], by_cost]
        return nodes[others], np.asarray(costs, dtype=np.float64)


@compiled
def pair_cost(data: Floats, from_points: bool, a: int, b: int) -> float:
    """Cost between two nodes."""
    if from_points:
        dx = data[a, 0] - data[b, 0]
        dy = data[a, 1] - data[b, 1]
        dz = data[a, 2] - data[b, 2]
        return float(data[a, 3] * data[b, 3] * math.sqrt(dx * dx + dy * dy + dz * dz))
    return float(data[a, b])


@compiled
def _cost_of_order(data: Floats, from_points: bool, order: Ints, closed: bool) -> float:
    total = 0.0
    for i in range(1, len(order)):
        total += pair_cost(data, from_points, order[i - 1], order[i])
    if closed:
        total += pair_cost(data, from_points, order[-1], order[0])
    return total
