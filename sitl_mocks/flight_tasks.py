"""What a vehicle can be busy with, each as a small task: begun once, then asked at every tick whether it is done."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from sitl_mocks.airframe import Airframe, FlightLimits

Array = NDArray[np.float64]

ARRIVED_M = 0.15
ARRIVED_M_S = 0.2
_UNDERGROUND_M = 3.0
_TOUCHDOWN_S = 0.6


class FlightTask(Protocol):
    """Something to do in the air."""

    def begin(self) -> None:
        """Start it."""
        ...

    def tick(self, dt_s: float) -> bool:
        """Go on; True when it is done (it then holds what it reached)."""
        ...


@dataclass(frozen=True)
class DescentProfile:
    """How fast to come down: fast above a height, slowly below it."""

    slow_below_m: float
    slow_m_s: float


class Hold:
    """Brake and stay."""

    def __init__(self, airframe: Airframe) -> None:
        self._airframe = airframe

    def begin(self) -> None:
        """Start to brake."""
        self._airframe.stop()

    def tick(self, dt_s: float) -> bool:
        """A hold is never done."""
        del dt_s
        return False


class GoTo:
    """Fly straight to a point and stop there.

    Args:
        airframe: of the vehicle.
        target_m: scene ENU.
        yaw_rad: yaw to have there; None keeps the yaw.
    """

    def __init__(self, airframe: Airframe, target_m: Array, yaw_rad: float | None = None) -> None:
        self._airframe = airframe
        self.target_m = np.asarray(target_m, dtype=np.float64)
        self._yaw_rad = yaw_rad

    def begin(self) -> None:
        """Set out."""
        self._airframe.go_to(self.target_m, self._yaw_rad)

    def tick(self, dt_s: float) -> bool:
        """Whether the reference has come to rest at the point and the vehicle is near."""
        del dt_s
        return arrived(self._airframe, self.target_m)


class TakeOff(GoTo):
    """Climb straight up to a height.

    Args:
        airframe: of the vehicle.
        up_m: height in the scene.
    """

    def __init__(self, airframe: Airframe, up_m: float) -> None:
        x, y, z = airframe.position_m
        super().__init__(airframe, np.array([x, y, max(z, up_m)]))


class Land:
    """Come down to the ground and stop the motors' work there.

    Args:
        airframe: of the vehicle.
        limits: of the autopilot.
        descent: how fast to come down.
        over_m: where to land (the height is of no concern); None for straight below.
    """

    def __init__(
        self, airframe: Airframe, limits: FlightLimits, descent: DescentProfile, over_m: Array | None = None
    ) -> None:
        self._airframe = airframe
        self._limits = limits
        self._descent = descent
        self._over_m = over_m
        self._approach: GoTo | None = None
        self._touching_s = 0.0

    def begin(self) -> None:
        """Brake, or fly to above the place."""
        self._touching_s = 0.0
        if self._over_m is not None:
            height = max(float(self._airframe.position_m[2]), self._airframe.ground_m + 1.0)
            self._approach = GoTo(self._airframe, np.array([self._over_m[0], self._over_m[1], height]))
            self._approach.begin()
        else:
            self._airframe.stop()
            self._sink()

    def tick(self, dt_s: float) -> bool:
        """Whether it stands on the ground."""
        if self._approach is not None:
            if not self._approach.tick(dt_s):
                return False
            self._approach = None
            self._sink()
        slow = self._airframe.height_m < self._descent.slow_below_m
        speed = self._descent.slow_m_s if slow else self._limits.descent_m_s
        self._airframe.set_limits(replace(self._limits, descent_m_s=speed))
        below = self._airframe.reference_m[2] < self._airframe.ground_m - 0.05
        self._touching_s = self._touching_s + dt_s if self._airframe.on_ground and below else 0.0
        return self._touching_s >= _TOUCHDOWN_S

    def _sink(self) -> None:
        x, y, _ = self._airframe.target_m
        self._airframe.go_to(np.array([x, y, self._airframe.ground_m - _UNDERGROUND_M]))


class Stages:
    """One task after the other; they are in `_stages`, of which the first has begun."""

    _stages: list[FlightTask]

    def tick(self, dt_s: float) -> bool:
        """Whether the last one is done."""
        if self._stages[0].tick(dt_s):
            if len(self._stages) == 1:
                return True
            self._stages.pop(0)
            self._stages[0].begin()
        return False


class ReturnHome(Stages):
    """Climb straight up, fly straight to above home, come down.

    Args:
        airframe: of the vehicle.
        limits: of the autopilot.
        descent: how fast to come down.
        home_m: scene ENU.
        height_m: to have at least on the way, above home.
        loiter_s: how long to wait above home before the descent.
    """

    def __init__(
        self,
        airframe: Airframe,
        limits: FlightLimits,
        descent: DescentProfile,
        home_m: Array,
        height_m: float,
        loiter_s: float = 0.0,
    ) -> None:
        self._airframe = airframe
        self._home_m = home_m
        self._height_m = height_m
        self._loiter_s = loiter_s
        self._land = Land(airframe, limits, descent, home_m)
        self._stages: list[FlightTask] = []

    def begin(self) -> None:
        """Start to climb."""
        x, y, z = self._airframe.position_m
        up = max(float(z), float(self._home_m[2]) + self._height_m)
        climb = GoTo(self._airframe, np.array([x, y, up]))
        home = np.array([self._home_m[0], self._home_m[1], up])
        way = home[:2] - np.array([x, y])
        facing = math.atan2(way[1], way[0]) if np.hypot(*way) > 1.0 else None
        self._stages = [climb, GoTo(self._airframe, home, facing), Pause(self._loiter_s), self._land]
        self._stages[0].begin()


class ReturnAlong(Stages):
    """Fly to one point after the other, and land at the last.

    Args:
        airframe: of the vehicle.
        limits: of the autopilot.
        descent: how fast to come down.
        way_m: points, scene ENU; the last is home on the ground.
        loiter_s: how long to wait above home before the descent.
    """

    ABOVE_HOME_M = 2.0

    def __init__(
        self, airframe: Airframe, limits: FlightLimits, descent: DescentProfile, way_m: list[Array], loiter_s: float
    ) -> None:
        home = way_m[-1]
        points = [*way_m[:-1], home + np.array([0.0, 0.0, self.ABOVE_HOME_M])]
        self._stages: list[FlightTask] = [
            Brake(airframe),
            *(GoTo(airframe, point) for point in points),
            Pause(loiter_s),
            Land(airframe, limits, descent),
        ]

    def begin(self) -> None:
        """Brake."""
        self._stages[0].begin()


class Brake(Hold):
    """Brake until it stands still."""

    def tick(self, dt_s: float) -> bool:
        """Whether it does."""
        del dt_s
        return bool(np.linalg.norm(self._airframe.reference_velocity_m_s) < ARRIVED_M_S)


class Pause:
    """Stay for a while where the vehicle has been led."""

    def __init__(self, seconds: float) -> None:
        self._left_s = seconds

    def begin(self) -> None:
        """Nothing needs to be done."""

    def tick(self, dt_s: float) -> bool:
        """Whether the time is over."""
        self._left_s -= dt_s
        return self._left_s <= 0.0


class Sink:
    """Drift down slowly: a position mode without anybody at the sticks."""

    def __init__(self, airframe: Airframe, limits: FlightLimits, speed_m_s: float) -> None:
        self._land = Land(airframe, limits, DescentProfile(math.inf, speed_m_s))

    def begin(self) -> None:
        """Start to sink."""
        self._land.begin()

    def tick(self, dt_s: float) -> bool:
        """Whether it stands on the ground."""
        return self._land.tick(dt_s)


def arrived(airframe: Airframe, target_m: Array, within_m: float = 2.0) -> bool:
    """Whether the reference rests at a point and the vehicle is near it."""
    rests = bool(
        np.linalg.norm(airframe.reference_m - target_m) < ARRIVED_M
        and np.linalg.norm(airframe.reference_velocity_m_s) < ARRIVED_M_S
    )
    return rests and bool(np.linalg.norm(airframe.position_m - target_m) < within_m)
