"""A speed brought to a wanted one with bounded acceleration and jerk, one axis (PX4's way to smooth velocities).

The acceleration rises with the greatest jerk (T1), stays (T2) and falls to zero (T3 = a0 / j + T1). Without T2 a change
of speed v takes `T1 = (-a0 + sqrt(a0^2 / 2 + j v)) / j`; T1 is cut where the acceleration would exceed its bound, and
T2 makes up for what is then missing. Axes that would be ready earlier than the slowest are stretched to its time: with
T = T1 + T2 + T3 given, `2 j T1 = j T - a0 -+ sqrt((j T)^2 + 2 j T a0 - a0^2 - 4 j v)`.
"""

from __future__ import annotations

import math

import numpy as np

from gcs.planning.numerics.compiled import compiled

Floats = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

_TINY = 1e-7


@compiled
def _bounded(a0: float, jerk: float, t1: float, most: float) -> float:
    """T1 cut so that the acceleration stays within its bound."""
    reached = a0 + jerk * t1
    if reached > most:
        return (most - a0) / jerk
    if reached < -most:
        return (-most - a0) / jerk
    return t1


@compiled
def quickest(a0: float, v0: float, wanted: float, jerk: float, most: float, out: Floats) -> None:
    """Direction and T1, T2, T3 that reach a speed soonest.

    Args:
        a0: acceleration now.
        v0: speed now.
        wanted: speed to reach.
        jerk: greatest jerk, positive.
        most: greatest acceleration, positive.
        out: receives direction (-1, 0, 1) and the three durations, shape (4,).
    """
    at_rest = v0 + (a0 * abs(a0) / (2.0 * jerk) if abs(a0) > _TINY else 0.0)
    direction = float(np.sign(wanted - at_rest))
    if direction == 0.0:
        direction = float(np.sign(a0))
    out[0], out[1], out[2], out[3] = direction, 0.0, 0.0, 0.0
    if direction == 0.0:
        return
    j, change = direction * jerk, wanted - v0
    square = a0 * a0 / 2.0 + j * change
    t1 = 0.0
    if square >= 0.0:
        root = math.sqrt(square)
        plus, minus = (-a0 + root) / j, (-a0 - root) / j
        if plus >= 0.0 and a0 / j + plus >= 0.0:
            t1 = plus
        elif minus >= 0.0 and a0 / j + minus >= 0.0:
            t1 = minus
        t1 = max(_bounded(a0, j, t1, most), 0.0)
    t3 = max(a0 / j + t1, 0.0)
    peak = a0 + j * t1
    if abs(peak) > _TINY:
        made = a0 * t1 + j * t1 * t1 / 2.0 + peak * t3 - j * t3 * t3 / 2.0
        out[2] = max((change - made) / peak, 0.0)
    out[1], out[3] = t1, t3


@compiled
def in_time(a0: float, v0: float, wanted: float, jerk: float, most: float, total: float, out: Floats) -> None:
    """T1, T2, T3 that reach a speed at a given time; `out` has the direction already (see `quickest`)."""
    j = out[0] * jerk
    if abs(j) < _TINY:
        out[1], out[2], out[3] = 0.0, 0.0, 0.0
        return
    linear = j * total - a0
    square = (total * j) ** 2 + 2.0 * total * a0 * j - a0 * a0 - 4.0 * j * (wanted - v0)
    t1 = 0.0
    if square >= 0.0:
        root = math.sqrt(square)
        first, second = max((linear - root) / (2.0 * j), 0.0), max((linear + root) / (2.0 * j), 0.0)
        if a0 / j + first >= 0.0 and first + a0 / j + first <= total:
            t1 = first
        elif a0 / j + second >= 0.0 and second + a0 / j + second <= total:
            t1 = second
        t1 = _bounded(a0, j, t1, most)
    t3 = max(a0 / j + t1, 0.0)
    out[1], out[2], out[3] = t1, max(total - t1 - t3, 0.0), t3


@compiled
def advance(axis: Floats, plan: Floats, jerk: float, dt: float) -> None:
    """Move an axis (position, speed, acceleration; shape (3,)) along its plan for a time, in place."""
    left = dt
    for part in range(3):
        u = min(left, plan[1 + part])
        j = plan[0] * jerk * (1 - part)
        axis[0] += axis[1] * u + axis[2] * u * u / 2.0 + j * u**3 / 6.0
        axis[1] += axis[2] * u + j * u * u / 2.0
        axis[2] += j * u
        left -= u
    if left > 0.0:
        axis[0] += axis[1] * left
        axis[2] = 0.0


@compiled
def brakable_speed(jerk: float, acceleration: float, distance: float, final: float) -> float:
    """Speed from which a speed `final` is still reached within a distance (m).

    The acceleration counts as constant after a delay of 2 a / j, which reversing it takes:
    `final^2 = v^2 - 2 a (distance - 2 v a / j)`.
    """
    b = 4.0 * acceleration * acceleration / jerk
    c = 2.0 * acceleration * distance + final * final
    return max((-b + math.sqrt(b * b + 4.0 * c)) / 2.0, final)
