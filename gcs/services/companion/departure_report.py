"""A departure from the plan, as the navigator tells it, as the report that goes to the station."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.frames import GeoPoint, geodetic_from_enu
from gcs.core.replanning import ReplanReport, SeenObstacle, ViewpointChange, ViewpointFate
from gcs.mavlink.replan_messages import MOST_VIEWPOINTS
from gcs.planning.local.local_replan import LocalReplan

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from gcs.core.plan import Plan
    from gcs.core.replanning import ReplanReason

IN_OFFBOARD = -1


def unreached(reason: ReplanReason, viewpoints: tuple[int, ...], clock_s: float, plan_time_s: float) -> LocalReplan:
    """Not a departure: viewpoints that are left when a lease is over."""
    return LocalReplan(reason, clock_s, None, np.empty((0, 3)), None, viewpoints, plan_time_s)


def departure_reports(replan: LocalReplan, plan: Plan, plan_hash: str, boot_id: int) -> list[ReplanReport]:
    """The report, and more of them for viewpoints that do not fit into one.

    Their numbers and the hashes after them are for whoever sends them.

    Args:
        replan: scene ENU, times on the vehicle's clock.
        plan: that was left.
        plan_hash: SHA-256 of its plan.json.
        boot_id: of this start of the companion.
    """
    anchor = plan.scenario.anchor.point

    def geo(places_m: ArrayLike) -> tuple[GeoPoint, ...]:
        columns = geodetic_from_enu(np.reshape(places_m, (-1, 3)), anchor)
        return tuple(GeoPoint(*(float(value) for value in row)) for row in zip(*columns, strict=True))

    obstacle = None
    if replan.obstacle is not None:
        x, y, radius_m, east, north = replan.obstacle
        obstacle = SeenObstacle(geo([x, y, replan.path_m[0, 2]])[0], radius_m, (east, north))
    changes = [ViewpointChange(viewpoint, ViewpointFate.SKIPPED, None) for viewpoint in replan.skipped]
    changes += [ViewpointChange(v, ViewpointFate.MOVED, geo(place)[0]) for v, place in replan.moved]
    report = ReplanReport(
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
        viewpoints=tuple(changes[:MOST_VIEWPOINTS]),
    )
    more = [tuple(changes[k : k + MOST_VIEWPOINTS]) for k in range(MOST_VIEWPOINTS, len(changes), MOST_VIEWPOINTS)]
    return [report, *(replace(report, path=(), viewpoints=part) for part in more)]
