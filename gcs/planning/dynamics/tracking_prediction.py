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
_CHUNK = 10_000
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
    state, parts, times = None, [], []
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
        parts.append(_figures(reference, flown, parameters))
        times.append(len(t))
    share = np.array(times) / sum(times)
    east, north, up = (max(p.axes_m[i] for p in parts) for i in range(3))
    return TrackingPrediction(
        axes_m=(east, north, up),
        distance_m=max(p.distance_m for p in parts),
        deviation_m=max(p.deviation_m for p in parts),
        mean_deviation_m=float(share @ [p.mean_deviation_m for p in parts]),
        yaw_rad=max(p.yaw_rad for p in parts),
        thrust_n=(min(p.thrust_n[0] for p in parts), max(p.thrust_n[1] for p in parts)),
        saturated_share=float(share @ [p.saturated_share for p in parts]),
    )


def _figures(
    reference: NDArray[np.float64], flown: NDArray[np.float64], parameters: QuadrotorParameters
) -> TrackingPrediction:
    error = flown[:, :3] - reference[:, :3]
    east, north, up = (float(number) for number in np.abs(error).max(axis=0))
    tangent = reference[:, 3:6] / np.maximum(np.linalg.norm(reference[:, 3:6], axis=1), 1e-6)[:, None]
    aside = np.linalg.norm(error - np.sum(error * tangent, axis=1)[:, None] * tangent, axis=1)
    rotation = rotation_of(flown)
    # The heading is what the body's y axis is level and across to; the x axis itself leans.
    heading = np.arctan2(-rotation[:, 0, 1], rotation[:, 1, 1]) - reference[:, 12]
    thrust = flown[:, 13:17]
    return TrackingPrediction(
        axes_m=(east, north, up),
        distance_m=float(np.linalg.norm(error, axis=1).max()),
        deviation_m=float(aside.max()),
        mean_deviation_m=float(aside.mean()),
        yaw_rad=float(np.abs((heading + np.pi) % (2 * np.pi) - np.pi).max()),
        thrust_n=(float(thrust.min()), float(thrust.max())),
        saturated_share=float(np.mean(np.any(thrust > _SATURATED * parameters.max_motor_thrust_n, axis=1))),
    )
