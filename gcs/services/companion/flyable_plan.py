"""A plan as the companion flies it: slowed for the loss of the stream, with the room that its local paths may use."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.trajectory import PiecewisePolynomial
from gcs.planning.local.binary_map import BinaryMap
from gcs.planning.scene.distance_field import build_distance_field
from gcs.planning.scene.fence import fence_volume, room_in_fence
from gcs.planning.scene.point_distance import SceneDistance
from gcs.planning.trajectories.flight_limits import limits_of
from gcs.planning.trajectories.retiming import TimeWarp, identity_warp
from gcs.planning.trajectories.stream_loss import slow_for_stream_loss
from gcs.services.home_column import column_times

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from gcs.core.plan import Plan
    from gcs.core.structure import Structure
    from gcs.planning.trajectories.flight_limits import FlightLimits

BRAKING_SHARE = 0.8
"""Share of the plan's acceleration limit that braking after a lost stream is counted with."""

KNOT_S = 0.2
"""Between the points at which a slowed curve is what it should be, with velocity and acceleration."""

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
    """

    plan_hash: str
    plan: Plan
    curve: PiecewisePolynomial
    warp: TimeWarp
    known: BinaryMap | None
    leave_s: float
    enter_s: float

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
    if structure is not None:
        scenario, safety = plan.scenario, plan.scenario.safety
        acceleration = scenario.vehicle.max_acceleration_m_s2
        warp = slow_for_stream_loss(
            plan.trajectory,
            SceneDistance(structure, scenario.ground_m),
            timeout_s=offboard_timeout_s,
            deceleration_m_s2=BRAKING_SHARE * acceleration,
            acceleration_m_s2=acceleration * 1.001,
            keep_m=scenario.vehicle.radius_m + safety.position_m + safety.model_m,
            home_m=scenario.home_m,
        )
        known = known_map(plan, structure)
    leave, enter = column_times(plan)
    curve = slowed_curve(plan.trajectory, warp)
    return FlyablePlan(plan_hash, plan, curve, warp, known, warp.time_of(leave), warp.time_of(enter))


def slowed_curve(trajectory: PiecewisePolynomial, warp: TimeWarp) -> PiecewisePolynomial:
    """A warped trajectory as a curve of its own.

    Pieces that the warp leaves at their own pace stay as they are. The others are cut into short ones, which have
    place, velocity and acceleration of the warped motion at both ends (quintic Hermite pieces), so that the whole stays
    twice continuously differentiable; the velocity at every end of theirs is the warped one, so the rule about lost
    streams holds there as it was proved.
    """
    coefficients, durations = [], []
    for piece, (start, end) in enumerate(zip(trajectory.starts_s[:-1], trajectory.starts_s[1:], strict=True)):
        begin_s, until_s = warp.time_of(float(start)), warp.time_of(float(end))
        count = max(2, math.ceil((until_s - begin_s) / KNOT_S))
        times = np.linspace(begin_s, until_s, count + 1)
        if np.allclose(warp.rate(times[1:-1]), 1.0, rtol=0.0, atol=1e-9):
            coefficients.append(trajectory.coefficients[piece][None])
            durations.append(trajectory.durations_s[piece][None])
            continue
        at = warp.setpoint(trajectory, times)
        coefficients.append(_hermite_pieces(*at, step_s=float(times[1] - times[0])))
        durations.append(np.diff(times))
    return PiecewisePolynomial(np.concatenate(coefficients), np.concatenate(durations))


def _hermite_pieces(
    position: NDArray[np.float64], velocity: NDArray[np.float64], acceleration: NDArray[np.float64], step_s: float
) -> NDArray[np.float64]:
    """Coefficients (N, 8, 3) on normalised time of quintic pieces between N + 1 states, evenly spaced."""
    p0, p1 = position[:-1], position[1:]
    v0, v1 = velocity[:-1] * step_s, velocity[1:] * step_s
    a0, a1 = acceleration[:-1] * step_s**2, acceleration[1:] * step_s**2
    zero = np.zeros_like(p0)
    cubic = 10 * (p1 - p0) - 6 * v0 - 4 * v1 - 1.5 * a0 + 0.5 * a1
    quartic = -15 * (p1 - p0) + 8 * v0 + 7 * v1 + 1.5 * a0 - a1
    quintic = 6 * (p1 - p0) - 3 * (v0 + v1) - 0.5 * (a0 - a1)
    return np.stack([p0, v0, a0 / 2, cubic, quartic, quintic, zero, zero], axis=1)


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
