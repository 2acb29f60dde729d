"""What a flight has done so far: how far it is off the planned curve, and which viewpoints it has been at."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from gcs.core.plan import Plan
    from gcs.core.trajectory import PiecewisePolynomial

REACHED_M = 0.5
"""A viewpoint is reached when the vehicle was this near to it."""

SAMPLE_S = 0.1


@dataclass(frozen=True)
class Observation:
    """What one position tells.

    Attributes:
        cross_track_m: distance from the nearest point of the planned curve.
        visits: viewpoint id -> how near it was missed, for those that are newly reached or were missed by less.
    """

    cross_track_m: float
    visits: dict[int, float]


class FlightTracker:
    """Compares positions of the vehicle with a plan.

    Args:
        plan: what is being flown.
        visits: viewpoints that were reached before (after a restart), with their misses.
    """

    def __init__(self, plan: Plan, visits: dict[int, float] | None = None) -> None:
        self.follow(plan.trajectory)
        self._viewpoints = np.array([v.position_m for v in plan.viewpoints]).reshape(-1, 3)
        self._ids = [v.id for v in plan.viewpoints]
        self.visits: dict[int, float] = dict(visits or {})

    def follow(self, trajectory: PiecewisePolynomial) -> None:
        """Compare with another curve from now on, such as one from where the vehicle was held."""
        from scipy.spatial import KDTree

        count = max(2, int(np.ceil(trajectory.duration_s / SAMPLE_S)) + 1)
        self._curve = trajectory.value(np.linspace(0.0, trajectory.duration_s, count))
        self._tree = KDTree(self._curve)

    def observe(self, position_m: NDArray[np.float64]) -> Observation:
        """Take a position of the vehicle, scene ENU, shape (3,)."""
        cross_track = self._distance_from_curve(position_m)
        news: dict[int, float] = {}
        for k in np.flatnonzero(np.linalg.norm(self._viewpoints - position_m, axis=1) <= REACHED_M):
            viewpoint, miss = self._ids[k], float(np.linalg.norm(self._viewpoints[k] - position_m))
            if miss < self.visits.get(viewpoint, np.inf) - 0.02:
                self.visits[viewpoint] = news[viewpoint] = miss
        return Observation(cross_track, news)

    def _distance_from_curve(self, position_m: NDArray[np.float64]) -> float:
        _, nearest = self._tree.query(position_m)
        low, high = max(int(nearest) - 1, 0), min(int(nearest) + 1, len(self._curve) - 1)
        a, b = self._curve[low:high], self._curve[low + 1 : high + 1]
        step = b - a
        length2 = np.maximum((step**2).sum(axis=1), 1e-18)
        along = np.clip(((position_m - a) * step).sum(axis=1) / length2, 0.0, 1.0)
        return float(np.linalg.norm(position_m - a - along[:, None] * step, axis=1).min())
