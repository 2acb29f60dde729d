"""What flights have shown of their vehicles, in the database."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gcs.core.clock import utc_now
from gcs.core.learned_dynamics import NOTHING_LEARNED, Estimate, LearnedDynamics
from gcs.storage.tables import LearnedDynamicsRow

if TYPE_CHECKING:
    from gcs.storage.database import Database


class DynamicsRepository:
    """Drag and lags of vehicles by their names; of each what its last flight knew."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def of(self, vehicle: str) -> LearnedDynamics:
        """What is known of a vehicle; nothing when none of its flights has shown anything."""
        with self._database.transaction() as session:
            row = session.get(LearnedDynamicsRow, vehicle)
            if row is None:
                return NOTHING_LEARNED
            return LearnedDynamics(
                _estimate(row.drag_s, row.drag_sigma_s),
                _estimate(row.lag_s, row.lag_sigma_s),
                _estimate(row.tilt_lag_s, row.tilt_lag_sigma_s),
            )

    def keep(self, vehicle: str, flight_id: str, learned: LearnedDynamics) -> None:
        """Put what a flight has shown in the place of what earlier ones had."""
        drag, lag, tilt_lag = learned.drag, learned.lag, learned.tilt_lag
        row = LearnedDynamicsRow(
            vehicle=vehicle,
            flight_id=flight_id,
            learned_at=utc_now(),
            drag_s=drag and drag.value,
            drag_sigma_s=drag and drag.sigma,
            lag_s=lag and lag.value,
            lag_sigma_s=lag and lag.sigma,
            tilt_lag_s=tilt_lag and tilt_lag.value,
            tilt_lag_sigma_s=tilt_lag and tilt_lag.sigma,
        )
        with self._database.transaction() as session:
            session.merge(row)


def _estimate(value: float | None, sigma: float | None) -> Estimate | None:
    return None if value is None or sigma is None else Estimate(value, sigma)
