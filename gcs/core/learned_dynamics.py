"""What a vehicle's own flights have shown of it, beyond its parameters."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Estimate:
    """A number that was learned, and its standard deviation."""

    value: float
    sigma: float


@dataclass(frozen=True)
class LearnedDynamics:
    """Drag and lags of a vehicle; None where its flights have not shown it.

    Attributes:
        drag: over mass, 1/s: what it leans against at a speed.
        lag: delay behind its setpoints, s.
        tilt_lag: delay of its tilt behind what its position controller asks for, s.
    """

    drag: Estimate | None = None
    lag: Estimate | None = None
    tilt_lag: Estimate | None = None


NOTHING_LEARNED = LearnedDynamics()
