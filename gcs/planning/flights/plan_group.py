"""Several flights of one inspection that have no curve in common, because each has a home of its own."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from gcs.core.plan import Plan
    from gcs.core.surface_coverage import SurfaceCoverage


@dataclass(frozen=True, eq=False)
class PlanGroup:
    """Plans that are flown together or one after the other.

    Attributes:
        plans: complete, each on its own time from take-off.
        starts_s: when each takes off, on the clock of all; the first at 0.
        coverage: what all of them see together, when a surface was asked for.
    """

    plans: tuple[Plan, ...]
    starts_s: tuple[float, ...]
    coverage: SurfaceCoverage | None

    @property
    def end_s(self) -> float:
        """When the last one has landed."""
        return max(s + p.trajectory.duration_s for s, p in zip(self.starts_s, self.plans, strict=True))


@dataclass(frozen=True, eq=False)
class SortieSeries(PlanGroup):
    """Sorties one after the other, on a battery each, some of them from rally points.

    Attributes:
        rally: which rally point each takes off from and lands at, from 1; None for home.
        tour_cost: of all tours together, in the metric.
        tour_lower_bound: no sorties from home and these rally points cost less.
    """

    rally: tuple[int | None, ...]
    tour_cost: float
    tour_lower_bound: float
