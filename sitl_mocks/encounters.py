"""The truth about how near a flying vehicle comes to obstacles: at every step of the simulation, exactly."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

from sitl_mocks.airframe import Airframe
from sitl_mocks.flight_kernel import STEP_S
from sitl_mocks.obstacles import Obstacles

HULL_RADIUS_M = 0.5
"""Of the sphere about the vehicle that counts as its hull."""


@dataclass
class Encounters:
    """Watches a vehicle among obstacles.

    Attributes:
        obstacles: they.
        least_m: least distance between hull and obstacle so far, negative when they overlapped; infinite before.
        nearest: which obstacle that was.
        least_at_s: when.
        touched: names of obstacles that were touched, with the times at which that began.
    """

    obstacles: Obstacles
    least_m: float = math.inf
    nearest: str | None = None
    least_at_s: float | None = None
    touched: dict[str, float] = field(default_factory=dict)

    def fly(self, airframe: Airframe, steps: int, time_s: float, watched: bool) -> None:
        """Let steps of simulated time pass for a vehicle, from a time of its clock on.

        Args:
            airframe: of the vehicle.
            steps: how many, of `STEP_S`.
            time_s: vehicle's clock at their beginning.
            watched: whether what happens counts; what stands on the ground flies into nothing.
        """
        if not watched or not len(self.obstacles):
            airframe.step(steps)
            return
        for step in range(1, steps + 1):
            airframe.step(1)
            self._look(airframe, time_s + step * STEP_S)

    def _look(self, airframe: Airframe, now_s: float) -> None:
        distance, which = self.obstacles.nearest(airframe.true_position_m, now_s)
        distance -= HULL_RADIUS_M
        if distance < self.least_m:
            self.least_m, self.nearest, self.least_at_s = distance, self.obstacles.names[which], now_s
        if distance <= 0.0:
            self.touched.setdefault(self.obstacles.names[which], now_s)

    def state(self) -> dict[str, Any]:
        """For tests, in plain JSON types."""
        return {
            "count": len(self.obstacles),
            "least_distance_m": None if self.nearest is None else round(self.least_m, 4),
            "nearest": self.nearest,
            "nearest_at_s": self.least_at_s,
            "touched": dict(self.touched),
        }
