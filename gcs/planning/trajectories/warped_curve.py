"""A trajectory that is flown by a time warp, as a curve of its own."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.trajectory import PiecewisePolynomial

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from gcs.planning.trajectories.retiming import TimeWarp

KNOT_S = 0.2
"""Between the points at which a warped curve is what it should be, with velocity and acceleration."""


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
        coefficients.append(hermite_pieces(*at, step_s=float(times[1] - times[0])))
        durations.append(np.diff(times))
    return PiecewisePolynomial(np.concatenate(coefficients), np.concatenate(durations))


def hermite_pieces(
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
