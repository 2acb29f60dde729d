"""What a path costs a tour: its length, the time it takes, or the tower paper's energy."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

from gcs.core.errors import InputError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from gcs.core.scenario import PlannerOptions


class LegTime(Protocol):
    """Time of legs from rest to rest."""

    def __call__(self, length_m: NDArray[np.float64], /) -> NDArray[np.float64]:
        """Times (s) of legs of the given lengths (m), any shape; grows with the length."""
        ...


class TourMetric(ABC):
    """A cost of paths that no path between two points undercuts on the straight line.

    Attributes:
        name: as in the scenario.
        unit: of the cost.
    """

    name: str
    unit: str

    @abstractmethod
    def of_path(self, corners_m: ArrayLike) -> float:
        """Cost of a path of straight legs from stop to stop; corners, shape (K, 3), K >= 1."""

    @abstractmethod
    def of_steps(self, *steps_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Cost of paths of one straight leg each or of several in a row.

        Args:
            steps_m: displacements along the first leg, the second, ..., shape (..., 3) each.

        Returns:
            Shape (...).
        """


@dataclass(frozen=True)
class LengthMetric(TourMetric):
    """Length of the path (m)."""

    name = "length"
    unit = "m"

    def of_path(self, corners_m: ArrayLike) -> float:  # noqa: D102
        return float(np.linalg.norm(np.diff(np.asarray(corners_m, dtype=np.float64), axis=0), axis=1).sum())

    def of_steps(self, *steps_m: NDArray[np.float64]) -> NDArray[np.float64]:  # noqa: D102
        return np.asarray(sum(np.linalg.norm(step, axis=-1) for step in steps_m), dtype=np.float64)


@dataclass(frozen=True)
class TimeMetric(TourMetric):
    """Time from rest to rest over a path's length (s).

    Attributes:
        leg_time: of the vehicle with its limits.
    """

    leg_time: LegTime
    name = "time"
    unit = "s"

    def of_path(self, corners_m: ArrayLike) -> float:  # noqa: D102
        return float(self.leg_time(np.array(LengthMetric().of_path(corners_m))))

    def of_steps(self, *steps_m: NDArray[np.float64]) -> NDArray[np.float64]:  # noqa: D102
        return np.asarray(self.leg_time(LengthMetric().of_steps(*steps_m)), dtype=np.float64)


@dataclass(frozen=True)
class EnergyMetric(TourMetric):
    """The tower paper's energy `W = K sqrt(dx^2 + dy^2 + mu dz^2)`, summed over a path's straight legs.

    Source: W. Xu et al., "Trajectory planning of rotor UAV for inspection of cable-stayed bridge tower", 2019, eq. 3.
    Climbing and sinking cost the same.

    Attributes:
        k: energy of a horizontal metre, > 0.
        mu: weight of a climb, >= 0: a vertical metre costs `sqrt(mu)` horizontal ones.

    Raises:
        InputError: K is not positive or mu is negative.
    """

    k: float = 1.0
    mu: float = 3.0
    name = "energy"
    unit = "1"

    def __post_init__(self) -> None:
        if not self.k > 0:
            raise InputError(f"the energy of a metre must be above 0, not {self.k:g}", field="planner.k")
        if not self.mu >= 0:
            raise InputError(f"the weight of a climb must be 0 or more, not {self.mu:g}", field="planner.mu")

    def stretched(self, points_m: ArrayLike) -> NDArray[np.float64]:
        """Points of a space where distance is energy, shape (n, 3)."""
        return np.asarray(points_m, dtype=np.float64) * [self.k, self.k, self.k * math.sqrt(self.mu)]

    def of_path(self, corners_m: ArrayLike) -> float:  # noqa: D102
        return LengthMetric().of_path(self.stretched(corners_m))

    def of_steps(self, *steps_m: NDArray[np.float64]) -> NDArray[np.float64]:  # noqa: D102
        return LengthMetric().of_steps(*(self.stretched(step) for step in steps_m))


def tour_metric(options: PlannerOptions, leg_time: LegTime) -> TourMetric:
    """The metric that the scenario asks for."""
    if options.metric == "energy":
        return EnergyMetric(options.k, options.mu)
    return TimeMetric(leg_time) if options.metric == "time" else LengthMetric()
