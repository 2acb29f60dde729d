"""A multirotor that follows moving setpoints through its position and velocity loops.

Both autopilots close the same cascade:

    v_t = v_ref + k_p (p_ref - p),  bounded
    a_t = a_ref + P (v_t - v) + I sum(v_t - v) dt + D (f v_t' - v'),  its level part bounded by the tilt

(f = 1 where the derivative acts on the error as in ArduPilot, 0 where it acts on the measured acceleration as in PX4).
The real acceleration follows a_t through two first-order lags across the vertical (leaning, motors) and one of half
that along it, less the air's drag: `v' = a - k v`. PX4 lets the correction of the position go before the velocity that
is fed forward where both together exceed the level speed; so does this.

A vehicle's state is a row of `STATE_SIZE` numbers: position, velocity, acceleration of it, lagging acceleration (two),
the integral and the last v_t, three each.
"""

from __future__ import annotations

import math

import numpy as np

from gcs.planning.numerics.compiled import compiled

Floats = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

GRAVITY_M_S2 = 9.80665
STATE_SIZE = 21
GAINS_SIZE = 15


def packed_gains(
    *,
    level: tuple[float, float, float, float],
    vertical: tuple[float, float, float, float],
    derivative_of_error: bool,
    max_speed_m_s: float,
    max_climb_m_s: float,
    max_descent_m_s: float,
    max_tilt_rad: float,
    tilt_lag_s: float,
    drag_1_s: float,
) -> Floats:
    """The numbers as the kernel takes them, shape (15,).

    Args:
        level: k_p, P, I and D across the vertical.
        vertical: the same along it.
        derivative_of_error: whether D acts on the error's derivative instead of on the measured acceleration.
        max_speed_m_s: bound of the level speed that is asked for.
        max_climb_m_s: bound upwards.
        max_descent_m_s: bound downwards.
        max_tilt_rad: bounds the level acceleration.
        tilt_lag_s: of each of the two lags.
        drag_1_s: drag per speed.
    """
    fed = 1.0 if derivative_of_error else 0.0
    limits = [max_speed_m_s, max_climb_m_s, max_descent_m_s, GRAVITY_M_S2 * math.tan(max_tilt_rad)]
    return np.array([*level, *vertical, fed, *limits, tilt_lag_s, drag_1_s], dtype=np.float64)


def hovering(position_m: Floats) -> Floats:
    """A state at rest, shape (21,)."""
    state = np.zeros(STATE_SIZE)
    state[:3] = position_m
    return state


@compiled
def _preferring(ax: float, ay: float, bx: float, by: float, most: float) -> tuple[float, float]:
    """The sum of two level vectors, the second shortened until it is no longer than `most`."""
    if math.hypot(ax + bx, ay + by) <= most:
        return ax + bx, ay + by
    size, other = math.hypot(ax, ay), math.hypot(bx, by)
    if size >= most or other < 1e-9:
        return ax / size * most, ay / size * most
    ux, uy = bx / other, by / other
    along = ax * ux + ay * uy
    share = math.sqrt(along * along + most * most - size * size) - along
    return ax + ux * share, ay + uy * share


@compiled
def follow(state: Floats, reference: Floats, gains: Floats, dt: float) -> None:
    """Advance a vehicle by one step of semi-implicit Euler.

    Args:
        state: shape (21,), changed in place.
        reference: position, velocity and acceleration to follow, shape (9,).
        gains: see `packed_gains`.
        dt: step, s; a tenth of the lag or less.
    """
    wanted = np.empty(3)
    kp = gains[0]
    wanted[0], wanted[1] = _preferring(
        kp * (reference[0] - state[0]), kp * (reference[1] - state[1]), reference[3], reference[4], gains[9]
    )
    wanted[2] = min(max(gains[4] * (reference[2] - state[2]) + reference[5], -gains[11]), gains[10])
    asked = np.empty(3)
    for k in range(3):
        row = 0 if k < 2 else 4
        error = wanted[k] - state[3 + k]
        derivative = gains[8] * (wanted[k] - state[18 + k]) / dt - state[6 + k]
        state[18 + k] = wanted[k]
        asked[k] = reference[6 + k] + gains[row + 1] * error + state[15 + k] + gains[row + 3] * derivative
        state[15 + k] += gains[row + 2] * error * dt
    level = math.hypot(asked[0], asked[1])
    if level > gains[12]:
        asked[0] *= gains[12] / level
        asked[1] *= gains[12] / level
    share = dt / gains[13]
    for k in range(2):
        state[9 + k] += (asked[k] - state[9 + k]) * share
        state[12 + k] += (state[9 + k] - state[12 + k]) * share
    state[14] += (asked[2] - state[14]) * min(2.0 * share, 1.0)
    for k in range(3):
        state[6 + k] = state[12 + k] - gains[14] * state[3 + k]
        state[3 + k] += state[6 + k] * dt
        state[k] += state[3 + k] * dt
