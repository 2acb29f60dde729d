"""Safety rule 6: losing the stream of setpoints must be survivable at every instant.

A vehicle whose setpoints stop flies on at its last velocity for its timeout and then brakes. What it sweeps is a
straight segment from where it is along its velocity v, of length `|v| timeout + |v|^2 / (2 deceleration)`. Where that
segment does not stay clear, the plan is flown slower: the segment only gets shorter, so a cap on the rate of the plan's
time is all it takes. Over home, where the curve is to reach the ground, the segment may end on the ground or touch it
at landing speed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.errors import InfeasibleError
from gcs.core.progress import SilentProgress
from gcs.planning.scene.free_length import free_lengths
from gcs.planning.scene.room import HOME_COLUMN_RADIUS_M
from gcs.planning.trajectories.retiming import STEP_S, TimeWarp, warp_under_caps

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from gcs.core.progress import Progress
    from gcs.core.trajectory import PiecewisePolynomial
    from gcs.planning.scene.point_distance import SceneDistance

SLOWEST_M_S = 0.1
"""A plan that would have to be flown slower than this where it moves is refused."""

TOUCHDOWN_M_S = 0.5
"""Speed at which touching the ground over home does no harm."""

_CLOSE_M = 0.01
"""Free lengths end where this much or less is left between the clearance kept and the clearance asked."""

_COARSE = 8
"""Fine intervals that are first judged together."""

_CHUNK = 4096


@dataclass(frozen=True)
class StreamLoss:
    """What the vehicle does when its setpoints stop.

    Attributes:
        timeout_s: how long it flies on at its last velocity.
        deceleration_m_s2: how hard it brakes then.
    """

    timeout_s: float
    deceleration_m_s2: float

    def swept_m(self, speed_m_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Length (m) of the straight segment flown after the loss, for speeds of any shape."""
        return np.asarray(speed_m_s * self.timeout_s + speed_m_s**2 / (2 * self.deceleration_m_s2))

    def speed_for(self, length_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Largest speed (m/s) whose segment is no longer than lengths (m) of any shape; 0 for negative ones."""
        b, tau = self.deceleration_m_s2, self.timeout_s
        return np.asarray(b * (np.sqrt(tau**2 + 2 * np.maximum(length_m, 0.0) / b) - tau))


@dataclass(frozen=True, eq=False)
class _Scene:
    distance: SceneDistance
    keep_m: float
    home_m: NDArray[np.float64]


def slow_for_stream_loss(
    trajectory: PiecewisePolynomial,
    distance: SceneDistance,
    *,
    timeout_s: float,
    deceleration_m_s2: float,
    acceleration_m_s2: float,
    keep_m: float,
    home_m: ArrayLike,
    progress: Progress | None = None,
) -> TimeWarp:
    """Slow a plan down where losing the stream would bring the vehicle too near to something.

    Args:
        trajectory: the plan.
        distance: exact distance to the scene.
        timeout_s: the vehicle flies on at its last velocity for this long.
        deceleration_m_s2: it then brakes with this.
        acceleration_m_s2: limit of the warped motion's acceleration; the plan itself keeps it.
        keep_m: distance that the vehicle's centre keeps from surfaces, cables and the ground on the swept segment: its
            radius and the errors of position and model.
        home_m: the column over it is exempt from the ground's distance, shape (3,).
        progress: reports the stage `stream_loss`.

    Returns:
        The warp; flown by it, the rule holds at every instant.

    Raises:
        InfeasibleError: somewhere the plan would have to be slower than `SLOWEST_M_S`; it says where.
        OperationCancelled: the progress said so.
    """
    loss = StreamLoss(timeout_s, deceleration_m_s2)
    scene = _Scene(distance, keep_m, np.asarray(home_m, dtype=np.float64))
    caps = rate_caps(trajectory, loss, scene, progress or SilentProgress())
    return warp_under_caps(trajectory, caps, acceleration_m_s2)


def rate_caps(
    trajectory: PiecewisePolynomial, loss: StreamLoss, scene: _Scene, progress: Progress
) -> NDArray[np.float64]:
    """Largest rate, in (0, 1], on each of N equal intervals of plan time, shape (N,).

    Intervals are judged by the segment at their middle; how far other segments of the same interval lie from it is
    bounded and added to what is kept. Groups of intervals that are clear as a whole are not looked into.

    Raises:
        InfeasibleError: a cap means less than `SLOWEST_M_S`.
    """
    coarse = max(1, math.ceil(trajectory.duration_s / (STEP_S * _COARSE)))
    caps = np.ones(coarse)
    width = trajectory.duration_s / coarse
    middles = np.asarray((np.arange(coarse) + 0.5) * width, dtype=np.float64)
    _judge(trajectory, loss, scene, middles, width, caps, progress, (0.0, 0.5))
    fine = np.ones((coarse, _COARSE))
    tight = np.flatnonzero(caps < 1.0)
    if len(tight):
        middles = np.asarray((tight[:, None] + (np.arange(_COARSE) + 0.5) / _COARSE) * width, dtype=np.float64)
        found = np.ones(middles.size)
        _judge(trajectory, loss, scene, middles.ravel(), width / _COARSE, found, progress, (0.5, 1.0))
        fine[tight] = found.reshape(middles.shape)
        _refuse_standstill(trajectory, middles.ravel(), found)
    return fine.ravel()


def _refuse_standstill(
    trajectory: PiecewisePolynomial, times_s: NDArray[np.float64], caps: NDArray[np.float64]
) -> None:
    speeds = np.linalg.norm(trajectory.value(times_s, 1), axis=1)
    stuck = (speeds > SLOWEST_M_S) & (caps * speeds < SLOWEST_M_S)
    if stuck.any():
        time = float(times_s[np.argmax(stuck)])
        x, y, z = trajectory.value(time)
        raise InfeasibleError(
            f"losing the stream at t = {time:.1f} s, at ({x:.1f}, {y:.1f}, {z:.1f}) m, would bring the vehicle "
            f"too near to the scene unless it flew slower than {SLOWEST_M_S} m/s there: fly this plan as a mission, or "
            "with a shorter stream timeout or a larger clearance"
        )


def _judge(
    trajectory: PiecewisePolynomial,
    loss: StreamLoss,
    scene: _Scene,
    times_s: NDArray[np.float64],
    width_s: float,
    caps: NDArray[np.float64],
    progress: Progress,
    share: tuple[float, float],
) -> None:
    """Put into `caps` the largest rate on the intervals of a width about times."""
    for first in range(0, len(times_s), _CHUNK):
        progress.report("stream_loss", share[0] + (share[1] - share[0]) * first / len(times_s))
        chunk = slice(first, first + _CHUNK)
        caps[chunk] = _caps(trajectory, loss, scene, times_s[chunk], width_s)


def _caps(
    trajectory: PiecewisePolynomial, loss: StreamLoss, scene: _Scene, times_s: NDArray[np.float64], width_s: float
) -> NDArray[np.float64]:
    position = trajectory.value(times_s)
    velocity = trajectory.value(times_s, 1)
    middle_speed = np.linalg.norm(velocity, axis=1)
    speed, motion, turn = _spread(trajectory, times_s, width_s)
    # A segment of the interval, whatever the rate, starts within `motion` of the one at the middle and its end is
    # displaced by the change of velocity times (timeout + braking time) besides.
    slack = motion + turn * (loss.timeout_s + speed / loss.deceleration_m_s2)
    caps = np.ones(len(times_s))
    moving = np.flatnonzero(speed > 1e-3)
    if not len(moving):
        return caps
    direction = velocity[moving] / np.maximum(middle_speed[moving], 1e-9)[:, None]
    needed = loss.swept_m(speed[moving])
    keep = scene.keep_m + slack[moving]
    free = free_lengths(
        position[moving], direction, needed, keep, lambda p: scene.distance.distance(p, ground=False), _CLOSE_M
    )
    free = np.minimum(free, _above_ground(position[moving], direction, keep, slack[moving], scene))
    allowed = np.where(free >= needed, speed[moving], loss.speed_for(free))
    height = (position[:, 2] - scene.home_m[2] - slack)[moving]
    aside = np.linalg.norm(position[moving, :2] - scene.home_m[:2], axis=1) - slack[moving]
    sinking = (aside <= HOME_COLUMN_RADIUS_M) & (direction[:, 2] < 0)
    landing = np.maximum(loss.speed_for(height), TOUCHDOWN_M_S)
    allowed = np.where(sinking, np.minimum(allowed, landing), allowed)
    caps[moving] = np.minimum(1.0, allowed / speed[moving])
    return caps


def _spread(
    trajectory: PiecewisePolynomial, times_s: NDArray[np.float64], width_s: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Largest speed on each interval, and how far position and velocity get from those at its middle.

    Velocities are looked at in nine places; between them the acceleration is taken as the largest of those places,
    with a tenth more.
    """
    offsets = np.linspace(-0.5, 0.5, 9) * width_s
    around = times_s[:, None] + offsets
    middle = trajectory.value(times_s, 1)[:, None]
    acceleration = 1.1 * np.linalg.norm(trajectory.value(around, 2), axis=2).max(axis=1)
    between = acceleration * width_s / 16
    velocity = trajectory.value(around, 1)
    speed = np.linalg.norm(velocity, axis=2).max(axis=1) + between
    turn = np.linalg.norm(velocity - middle, axis=2).max(axis=1) + between
    return speed, speed * width_s / 2, turn


def _above_ground(
    position: NDArray[np.float64],
    direction: NDArray[np.float64],
    keep_m: NDArray[np.float64],
    slack_m: NDArray[np.float64],
    scene: _Scene,
) -> NDArray[np.float64]:
    """Lengths for which rays keep their distance from the ground wherever they are outside the column over home."""
    ground = scene.distance.ground_m
    if ground is None:
        return np.full(len(position), math.inf)
    room = position[:, 2] - ground - keep_m
    sinking = -direction[:, 2]
    inside = _length_in_column(position[:, :2] - scene.home_m[:2], direction[:, :2], HOME_COLUMN_RADIUS_M - slack_m)
    with np.errstate(divide="ignore", invalid="ignore"):
        down = np.where(sinking > 0, np.maximum(room / sinking, inside), math.inf)
    leaves = np.isfinite(inside)
    high_enough = room - sinking * np.where(leaves, inside, 0.0) >= 0
    return np.where(sinking > 0, down, np.where(leaves & ~high_enough, inside, math.inf))


def _length_in_column(
    offset: NDArray[np.float64], direction: NDArray[np.float64], radius_m: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Length of rays inside a vertical cylinder about the origin: 0 from outside, infinite for vertical ones."""
    square = (direction**2).sum(axis=1)
    along = (offset * direction).sum(axis=1)
    rest = (offset**2).sum(axis=1) - np.maximum(radius_m, 0.0) ** 2
    inside = (rest <= 0) & (radius_m > 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        exit_ = (-along + np.sqrt(np.maximum(along**2 - square * rest, 0.0))) / square
    return np.where(inside, np.where(square > 1e-12, exit_, math.inf), 0.0)
