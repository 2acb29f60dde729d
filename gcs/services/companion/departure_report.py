"""A departure from the plan, as the navigator tells it, as the report that goes to the station."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from gcs.core.frames import GeoPoint, geodetic_from_enu
from gcs.core.replanning import ReplanReport, SeenObstacle, ViewpointChange, ViewpointFate

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from gcs.core.plan import Plan
    from gcs.planning.local.local_replan import LocalReplan

IN_OFFBOARD = -1


def departure_report(replan: LocalReplan, plan: Plan, plan_hash: str, boot_id: int) -> ReplanReport:
    """The report; its number and the hash after it are for whoever sends it.

    Args:
        replan: scene ENU, times on the vehicle's clock.
        plan: that was left.
        plan_hash: SHA-256 of its plan.json.
        boot_id: of this start of the companion.
    """
    anchor = plan.scenario.anchor.point

    def geo(places_m: ArrayLike) -> tuple[GeoPoint, ...]:
        columns = geodetic_from_enu(np.atleast_2d(places_m), anchor)
        return tuple(GeoPoint(*(float(value) for value in row)) for row in zip(*columns, strict=True))

    obstacle = None
    if replan.obstacle is not None:
        x, y, radius_m, east, north = replan.obstacle
        obstacle = SeenObstacle(geo([x, y, replan.path_m[0, 2]])[0], radius_m, (east, north))
    changes = [ViewpointChange(viewpoint, ViewpointFate.SKIPPED, None) for viewpoint in replan.skipped]
    changes += [ViewpointChange(v, ViewpointFate.MOVED, geo(place)[0]) for v, place in replan.moved]
    return ReplanReport(
        boot_id=boot_id,
        number=0,
        plan_hash=plan_hash,
        plan_hash_after="",
        reason=replan.reason,
        mission_item=IN_OFFBOARD,
        left_at_s=replan.left_clock_s,
        rejoined_at_s=replan.rejoined_clock_s,
        obstacle=obstacle,
        path=geo(replan.path_m),
        viewpoints=tuple(changes),
    )
