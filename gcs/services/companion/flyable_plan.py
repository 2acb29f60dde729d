"""A plan as the companion flies it: slowed for the loss of the stream, with the room that its local paths may use."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from gcs.planning.local.binary_map import BinaryMap
from gcs.planning.scene.distance_field import build_distance_field
from gcs.planning.scene.fence import fence_volume, room_in_fence
from gcs.planning.scene.point_distance import SceneDistance
from gcs.planning.trajectories.flight_limits import limits_of
from gcs.planning.trajectories.retiming import TimeWarp, identity_warp
from gcs.planning.trajectories.stream_loss import StreamLoss, slow_for_stream_loss
from gcs.planning.trajectories.warped_curve import slowed_curve
from gcs.services.companion.moved_pictures import moved_views
from gcs.services.home_column import column_times

if TYPE_CHECKING:
    from gcs.core.plan import Plan
    from gcs.core.structure import Structure
    from gcs.core.trajectory import PiecewisePolynomial
    from gcs.planning.local.moved_view import MovedViews
    from gcs.planning.trajectories.flight_limits import FlightLimits

BRAKING_SHARE = 0.8
"""Share of the plan's acceleration limit that braking after a lost stream is counted with."""

CELL_M = 0.3
ROOM_ASIDE_M = 12.0
"""Local paths may go so far beyond the box about the plan."""

MOST_CELLS = 30_000_000


@dataclass(frozen=True, eq=False)
class FlyablePlan:
    """What the companion needs of a plan. Its own times are those of `curve`, flown as it is.

    Attributes:
        plan_hash: SHA-256 of its plan.json, 64 hex digits.
        plan: as the station wrote it.
        curve: the plan's trajectory, slower where losing the stream would not be survivable (safety rule 6).
        warp: from times of `curve` to the plan's.
        known: where the vehicle's centre must not be because of structure, ground or fence; None for no scene.
        leave_s: time on `curve` at which the take-off column over home is left.
        enter_s: time on `curve` at which the landing column is entered.
        stream_loss: what the vehicle does when its setpoints stop.
        others: by viewpoint id, places from which its picture can be taken instead.
    """

    plan_hash: str
    plan: Plan
    curve: PiecewisePolynomial
    warp: TimeWarp
    known: BinaryMap | None
    leave_s: float
    enter_s: float
    stream_loss: StreamLoss
    others: dict[int, MovedViews] = field(default_factory=dict)

    @property
    def swept_m(self) -> float:
        """How far the vehicle gets at most by itself when its setpoints stop."""
        return float(self.stream_loss.swept_m(np.asarray(self.limits.speed_m_s)))

    @property
    def limits(self) -> FlightLimits:
        """What may be flown."""
        return limits_of(self.plan.scenario.vehicle)

    def time_of(self, plan_s: float) -> float:
        """Time on `curve` of a time of the plan."""
        return float(self.warp.time_of(plan_s))

    def plan_time(self, curve_s: float) -> float:
        """Time of the plan of a time on `curve`."""
        return float(self.warp.plan_time(curve_s))


def flyable_plan(plan: Plan, plan_hash: str, structure: Structure | None, offboard_timeout_s: float) -> FlyablePlan:
    """Make a plan ready to be flown; takes seconds.

    Args:
        plan: as read.
        plan_hash: of its plan.json.
        structure: what stands in its scene; None for an empty one without ground.
        offboard_timeout_s: for how long the vehicle flies on at its last velocity when setpoints stop.

    Raises:
        InfeasibleError: it cannot be slowed enough for the loss of the stream.
    """
    warp = identity_warp(plan.trajectory.duration_s)
    known = None
    scenario, safety = plan.scenario, plan.scenario.safety
    acceleration = scenario.vehicle.max_acceleration_m_s2
    loss = StreamLoss(offboard_timeout_s, BRAKING_SHARE * acceleration)
    if structure is not None:
        warp = slow_for_stream_loss(
            plan.trajectory,
            SceneDistance(structure, scenario.ground_m),
            timeout_s=loss.timeout_s,
            deceleration_m_s2=loss.deceleration_m_s2,
            acceleration_m_s2=acceleration * 1.001,
            keep_m=scenario.vehicle.radius_m + safety.position_m + safety.model_m,
            home_m=scenario.home_m,
        )
        known = known_map(plan, structure)
    leave, enter = column_times(plan)
    curve = slowed_curve(plan.trajectory, warp)
    times = warp.time_of(leave), warp.time_of(enter)
    return FlyablePlan(plan_hash, plan, curve, warp, known, *times, loss, moved_views(plan, structure))


def known_map(plan: Plan, structure: Structure) -> BinaryMap:
    """Cells about a plan in which the vehicle's centre would not keep the plan's clearance and all its budgets.

    A cell is free only when every point of it is.
    """
    scenario = plan.scenario
    flown = np.concatenate([plan.path_m, [v.position_m for v in plan.viewpoints]])
    low, high = flown.min(axis=0) - ROOM_ASIDE_M, flown.max(axis=0) + ROOM_ASIDE_M
    bounds = structure.bounds_m
    low, high = np.minimum(low, bounds[0] - 1.0), np.maximum(high, bounds[1] + 1.0)
    pitch = max(CELL_M, math.cbrt(float(np.prod(high - low)) / MOST_CELLS))
    field = build_distance_field(structure, low, high, pitch)
    half_diagonal = pitch * math.sqrt(3.0) / 2.0
    keep_m = scenario.centre_clearance_m
    needed_m = keep_m + half_diagonal
    blocked = field.distance_m < needed_m
    unsure = np.argwhere(blocked & (field.distance_m + field.looseness_m >= needed_m))
    exact_m = SceneDistance(structure, None).distance(low + pitch * (unsure + 0.5), limit=needed_m)
    blocked[tuple(unsure.T)] = exact_m < needed_m
    if scenario.ground_m is not None:
        floors = low[2] + pitch * np.arange(blocked.shape[2]) - scenario.ground_m
        blocked |= (floors < keep_m)[None, None, :]
    if scenario.fence is not None:
        fence = fence_volume(scenario.fence, scenario.vehicle, scenario.safety)
        centres = low[:2] + pitch * (np.argwhere(np.ones(blocked.shape[:2], dtype=np.bool_)) + 0.5)
        for layer in range(blocked.shape[2]):
            points = np.column_stack([centres, np.full(len(centres), low[2] + pitch * (layer + 0.5))])
            outside = room_in_fence(points, fence) < half_diagonal
            blocked[:, :, layer] |= outside.reshape(blocked.shape[:2])
    return BinaryMap(blocked, low, pitch)
