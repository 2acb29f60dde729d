"""From what a companion tells of its lease to what the API says."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from gcs.api.schemas.leases import LeaseInfo

if TYPE_CHECKING:
    from gcs.services.flight_types import LeaseView


def lease_info(view: LeaseView) -> LeaseInfo:
    """Where a lease stands, with its age."""
    status = view.status
    return LeaseInfo.model_validate(
        {
            "flight_id": view.flight_id,
            "lease": f"{status.lease:08x}",
            "state": status.state.name.lower(),
            "text": status.text,
            "away": status.away_words,
            "plan_time_s": status.plan_time_s,
            "reports_pending": status.reports_pending,
            "lidar_age_s": status.lidar_age_s,
            "odometry_quality": status.odometry_quality if status.odometry_quality >= 0 else None,
            "age_s": round(max(time.monotonic() - view.heard_s, 0.0), 3),
        }
    )
