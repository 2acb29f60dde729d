"""The ways home that a vehicle has by itself, without its ground station: what its failsafes can make it do."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray


class OwnAction(Enum):
    """What a vehicle does by itself."""

    CONTINUE = "continue"
    """Flies its mission on to the end."""
    HOLD = "hold"
    """Brakes and stays."""
    LAND = "land"
    """Brakes and comes straight down."""
    RETURN = "return"
    """Brakes, climbs, flies straight home and comes down there."""
    RETRACE = "retrace"
    """Brakes and flies home along the path that it came."""
    NOTHING = "nothing"
    """Does nothing about it."""
    FALL = "fall"
    """Stops its motors."""


@dataclass(frozen=True)
class ReturnFlight:
    """How high a vehicle's own return flies. Heights are metres above home, distances are from home, seen from above.

    Attributes:
        altitude_m: it climbs to this; one that is higher stays as high as it is.
        least_climb_m: it climbs at least by this.
        cone_slope: close to home it climbs no higher than this times the distance from home; None without such a cone.
        cone_reach_m: the cone counts within this distance.
        cone_climb_m: inside the cone it may still climb by this.
        cone_floor_m: the cone asks for no less than this height.
        no_cone: what to set so that there is no cone, in words.
    """

    altitude_m: float
    least_climb_m: float = 0.0
    cone_slope: float | None = None
    cone_reach_m: float = float("inf")
    cone_climb_m: float = 0.0
    cone_floor_m: float = 0.0
    no_cone: str = ""

    def level_m(self, height_m: NDArray[np.float64], aside_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Height (m above home) at which it flies home.

        Args:
            height_m: where it sets out, above home, shape (N,).
            aside_m: its distance from home, seen from above, shape (N,).

        Returns:
            Shape (N,), never below `height_m`.
        """
        target = np.maximum(self.altitude_m, height_m + self.least_climb_m)
        if self.cone_slope is not None:
            cone = np.maximum(self.cone_slope * aside_m, self.cone_floor_m)
            cone = np.maximum(cone, height_m + self.cone_climb_m)
            target = np.where(aside_m <= self.cone_reach_m, np.minimum(target, cone), target)
        return np.maximum(height_m, target)


@dataclass(frozen=True)
class RetraceMemory:
    """How a vehicle remembers the path that it came.

    Attributes:
        accuracy_m: points closer than this to each other are not kept; straight pieces and loops are cut by as much.
        points: how many it can keep; with more it forgets the way altogether.
        accuracy_name: the parameter with the accuracy (m).
        points_name: the parameter with the number of points.
    """

    accuracy_m: float
    points: int
    accuracy_name: str = ""
    points_name: str = ""
