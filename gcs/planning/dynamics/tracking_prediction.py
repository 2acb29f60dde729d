"""How far from a planned curve a rigid body under a good controller would be, and what its motors would give.

The geometric tracking controller flies the quadrotor along the curve and its yaw, in still air or in seeded gusts. It
is the best that may be hoped for: an autopilot's own controllers are what `setpoint_following` and the mission models
are about.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from gcs.planning.dynamics.geometric_controller import ControllerGains, track_reference
from gcs.planning.dynamics.quadrotor import QuadrotorParameters, rotation_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from gcs.core.trajectory import AngleProfile, PiecewisePolynomial
    from gcs.planning.dynamics.wind_gusts import WindGusts

STEP_S = 0.004
_BIN = 250
"""Steps of one row of a history: a second."""

_CHUNK = 40 * _BIN
_SATURATED = 0.999


@dataclass(frozen=True)
class TrackingPrediction:
    """Errors and motor thrusts of one predicted flight.

    Attributes:
        axes_m: largest position error east, north and up.
        distance_m: largest distance from where the vehicle is to be at that moment.
        deviation_m: largest distance from the curve, its tangent at that moment taken for it.
        mean_deviation_m: the same in the mean over time.
        yaw_rad: largest error of the heading.
        thrust_n: least and largest thrust of a motor.
        saturated_share: share of the time in which a motor gives all that it can.
    """

    axes_m: tuple[float, float, float]
    distance_m: float
    deviation_m: float
    mean_deviation_m: float
    yaw_rad: float
    thrust_n: tuple[float, float]
    saturated_share: float


@dataclass(frozen=True, eq=False)
class TrackingHistory:
    """Errors and motor thrusts of a predicted flight, second by second; of each second the extremes.

    Attributes:
        time_s: middle of each second, shape (K,).
        axes_m: largest position error east, north and up, shape (K, 3).
        distance_m: largest distance from where the vehicle is to be, shape (K,).
        deviation_m: largest distance from the curve, shape (K,).
        mean_deviation_m: the same in the mean, shape (K,).
        yaw_rad: largest error of the heading, shape (K,).
        thrust_n: least and largest thrust of a motor, shape (K, 2).
        saturated_share: share in which a motor gives all that it can, shape (K,).
        weight: share of the whole flight, shape (K,); the last second may be short.
    """

    time_s: NDArray[np.float64]
    axes_m: NDArray[np.float64]
    distance_m: NDArray[np.float64]
    deviation_m: NDArray[np.float64]
    mean_deviation_m: NDArray[np.float64]
    yaw_rad: NDArray[np.float64]
    thrust_n: NDArray[np.float64]
    saturated_share: NDArray[np.float64]
    weight: NDArray[np.float64]

    @property
    def figures(self) -> TrackingPrediction:
        """Of the whole flight."""
        east, north, up = (float(error) for error in self.axes_m.max(axis=0))
        return TrackingPrediction(
            axes_m=(east, north, up),
            distance_m=float(self.distance_m.max()),
            deviation_m=float(self.deviation_m.max()),
            mean_deviation_m=float(self.weight @ self.mean_deviation_m),
            yaw_rad=float(self.yaw_rad.max()),
            thrust_n=(float(self.thrust_n[:, 0].min()), float(self.thrust_n[:, 1].max())),
            saturated_share=float(self.weight @ self.saturated_share),
        )


def usual_quadrotor(mass_kg: float) -> QuadrotorParameters:
    """A quadrotor of the usual build, grown to a mass: lengths with its cube root, drag with the area."""
    usual = QuadrotorParameters()
    share = mass_kg / usual.mass_kg
    ixx, iyy, izz = (share ** (5 / 3) * moment for moment in usual.inertia_kg_m2)
    dx, dy, dz = (share ** (2 / 3) * drag for drag in usual.drag_n_s_m)
    return replace(
        usual,
        mass_kg=mass_kg,
        inertia_kg_m2=(ixx, iyy, izz),
        arm_m=share ** (1 / 3) * usual.arm_m,
        torque_per_thrust_m=share ** (1 / 3) * usual.torque_per_thrust_m,
        max_motor_thrust_n=share * usual.max_motor_thrust_n,
        drag_n_s_m=(dx, dy, dz),
    )


def predict_tracking(
    trajectory: PiecewisePolynomial,
    yaw: AngleProfile,
    *,
    parameters: QuadrotorParameters,
    gains: ControllerGains | None = None,
    gusts: WindGusts | None = None,
    seed: int = 0,
) -> TrackingPrediction:
    """Fly a curve from its start to its end: the figures of `track_curve`, which says what the arguments are."""
    return track_curve(trajectory, yaw, parameters=parameters, gains=gains, gusts=gusts, seed=seed).figures


def track_curve(
    trajectory: PiecewisePolynomial,
    yaw: AngleProfile,
    *,
    parameters: QuadrotorParameters,
    gains: ControllerGains | None = None,
    gusts: WindGusts | None = None,
    seed: int = 0,
) -> TrackingHistory:
    """Fly a curve from its start to its end.

    Args:
        trajectory: planned curve, ENU; the vehicle starts at rest on it, hovering.
        yaw: planned heading.
        parameters: of the vehicle.
        gains: of the controller; its own when None.
        gusts: wind; still air when None.
        seed: of the gusts.
    """
    rng = np.random.default_rng(seed)
    steps = max(1, math.ceil(trajectory.duration_s / STEP_S))
    wind = np.zeros((steps + 1, 3)) if gusts is None else gusts.sampled(steps + 1, STEP_S, rng)
    state, parts = None, []
    for first in range(0, steps, _CHUNK):
        # The last sample of a part is the first of the next: its state is where that one begins.
        t = STEP_S * np.arange(first, min(first + _CHUNK, steps) + 1)
        angles = np.stack([yaw.value(t), yaw.rate(t)], axis=1)
        reference = np.concatenate([*(trajectory.value(t, order) for order in range(4)), angles], axis=1)
        flown = track_reference(
            reference,
            STEP_S,
            parameters=parameters,
            gains=gains or ControllerGains(),
            wind_m_s=wind[first : first + len(t)],
            start=state,
        )
        state = flown[-1]
        # The sample that the next part begins with is counted there.
        last = first + _CHUNK >= steps
        kept = len(t) if last else len(t) - 1
        parts.append(_by_seconds(first, reference[:kept], flown[:kept], parameters))
    columns = np.concatenate(parts)
    return TrackingHistory(
        time_s=columns[:, 0],
        axes_m=columns[:, 1:4],
        distance_m=columns[:, 4],
        deviation_m=columns[:, 5],
        mean_deviation_m=columns[:, 6],
        yaw_rad=columns[:, 7],
        thrust_n=columns[:, 8:10],
        saturated_share=columns[:, 10],
        weight=columns[:, 11] / columns[:, 11].sum(),
    )


def _by_seconds(
    first: int, reference: NDArray[np.float64], flown: NDArray[np.float64], parameters: QuadrotorParameters
) -> NDArray[np.float64]:
    """Rows of a history, with the number of steps as the last column, shape (K, 12)."""
    error = flown[:, :3] - reference[:, :3]
    tangent = reference[:, 3:6] / np.maximum(np.linalg.norm(reference[:, 3:6], axis=1), 1e-6)[:, None]
    aside = np.linalg.norm(error - np.sum(error * tangent, axis=1)[:, None] * tangent, axis=1)
    rotation = rotation_of(flown)
    # The heading is what the body's y axis is level and across to; the x axis itself leans.
    heading = np.arctan2(-rotation[:, 0, 1], rotation[:, 1, 1]) - reference[:, 12]
    thrust = flown[:, 13:17]
    starts = np.arange(0, len(flown), _BIN)
    count = np.diff(np.append(starts, len(flown)))
    largest = np.column_stack(
        [np.abs(error), np.linalg.norm(error, axis=1), aside, np.abs((heading + np.pi) % (2 * np.pi) - np.pi)]
    )
    largest = np.maximum.reduceat(largest, starts)
    saturated = np.any(thrust > _SATURATED * parameters.max_motor_thrust_n, axis=1).astype(np.float64)
    return np.column_stack(
        [
            STEP_S * (first + starts + count / 2),
            largest[:, :5],
            np.add.reduceat(aside, starts) / count,
            largest[:, 5],
            np.minimum.reduceat(thrust.min(axis=1), starts),
            np.maximum.reduceat(thrust.max(axis=1), starts),
            np.add.reduceat(saturated, starts) / count,
            count,
        ]
    )
