"""What an autopilot is given to fly, and what it is predicted to make of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, TypeVar

import numpy as np

from gcs.core.errors import InputError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from gcs.core.flight_law import Airframe

SAMPLE_S = 0.05
"""Spacing of a predicted flight's samples."""

Law_contra = TypeVar("Law_contra", contravariant=True)


@dataclass(frozen=True, eq=False)
class MissionRoute:
    """A mission between take-off and landing: places, and what is done there.

    Attributes:
        points_m: where it starts (at rest) and its waypoints, scene ENU, shape (N, 3), N >= 2.
        radius_m: acceptance radius of each as PX4 takes it, 0 for the vehicle's own, shape (N,).
        hold_s: how long it stays at each, shape (N,); it stops where that is positive, and at the last.
        speed_m_s: ground speed that the mission commands; None when it commands none.
        climb_m_s: likewise upwards (ArduPilot only).
        descent_m_s: likewise downwards (ArduPilot only).
        curved: spline waypoints instead of straight legs (ArduPilot only).
    """

    points_m: NDArray[np.float64]
    radius_m: NDArray[np.float64]
    hold_s: NDArray[np.float64]
    speed_m_s: float | None = None
    climb_m_s: float | None = None
    descent_m_s: float | None = None
    curved: bool = False

    def __post_init__(self) -> None:
        count = len(self.points_m)
        if self.points_m.shape != (count, 3) or count < 2:
            raise InputError("a mission needs two places at least", field="points_m")
        if self.radius_m.shape != (count,) or self.hold_s.shape != (count,):
            raise InputError("one radius and one hold for each place are needed", field="radius_m")
        numbers = np.concatenate([self.points_m.ravel(), self.radius_m, self.hold_s])
        if not np.isfinite(numbers).all() or (self.radius_m < 0).any() or (self.hold_s < 0).any():
            raise InputError("places, radii and holds must be finite, the latter two not negative", field="points_m")


@dataclass(frozen=True, eq=False)
class SetpointStream:
    """Setpoints as they are sent; each counts until the next comes.

    Attributes:
        time_s: when each is sent, increasing, shape (K,).
        position_m: shape (K, 3).
        velocity_m_s: shape (K, 3).
        acceleration_m_s2: shape (K, 3); zeros where none is sent.
    """

    time_s: NDArray[np.float64]
    position_m: NDArray[np.float64]
    velocity_m_s: NDArray[np.float64]
    acceleration_m_s2: NDArray[np.float64]

    def __post_init__(self) -> None:
        count = len(self.time_s)
        if count < 2 or not (np.diff(self.time_s) > 0).all():
            raise InputError("two setpoints at least are needed, in the order of time", field="time_s")
        for name in ("position_m", "velocity_m_s", "acceleration_m_s2"):
            values: NDArray[np.float64] = getattr(self, name)
            if values.shape != (count, 3) or not np.isfinite(values).all():
                raise InputError("three finite numbers for each setpoint are needed", field=name)

    def packed(self) -> NDArray[np.float64]:
        """Position, velocity and acceleration of each, shape (K, 9)."""
        return np.ascontiguousarray(np.hstack([self.position_m, self.velocity_m_s, self.acceleration_m_s2]))


@dataclass(frozen=True, eq=False)
class PredictedFlight:
    """Where a vehicle is predicted to be.

    Attributes:
        time_s: multiples of `SAMPLE_S` from the start, shape (K,).
        position_m: scene ENU, shape (K, 3).
        finished: False when the mission was not flown to its end (the vehicle circles about a waypoint, or crawls).
    """

    time_s: NDArray[np.float64]
    position_m: NDArray[np.float64]
    finished: bool = True

    @property
    def duration_s(self) -> float:
        """How long it takes."""
        return float(self.time_s[-1])


class MissionModel(Protocol[Law_contra]):
    """How one autopilot flies a mission."""

    def __call__(self, route: MissionRoute, law: Law_contra, airframe: Airframe) -> PredictedFlight:
        """Predict the flight from the route's first place to its last.

        Raises:
            InputError: a limit of the law is not positive.
        """
        ...


class StreamModel(Protocol[Law_contra]):
    """How one autopilot follows setpoints."""

    def __call__(self, stream: SetpointStream, law: Law_contra, airframe: Airframe) -> PredictedFlight:
        """Predict the flight from rest on the first setpoint to the last.

        Raises:
            InputError: a limit of the law is not positive.
        """
        ...


def sample_times(count: int) -> NDArray[np.float64]:
    """Times (s) of that many samples, shape (count,)."""
    return np.arange(count, dtype=np.float64) * SAMPLE_S


def require_positive(values: dict[str, float]) -> None:
    """Refuse limits that are not positive numbers.

    Raises:
        InputError: naming the first of them.
    """
    for name, value in values.items():
        if not 0.0 < value < np.inf:
            raise InputError(f"must be a positive number, not {value:g}", field=name)
