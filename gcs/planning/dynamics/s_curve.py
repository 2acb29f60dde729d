"""The speed profile of one straight leg of an ArduPilot mission: from rest to rest with bounded snap.

The jerk rises and falls as a raised cosine of the duration t_j = pi J / (2 S) (J the greatest jerk, S the greatest
snap), stays at J for t_2, and the acceleration A = J (t_j + t_2) stays for t_4. With q = 2 t_j + t_2 that gives

    speed V = A (q + t_4),   duration T_a = 2 q + t_4,   length P_a = V T_a / 2

of the acceleration; the deceleration mirrors it, and what is left of the leg is flown at V. Each is at most half the
leg. Where the bounds do not leave room for the whole jerk, t_2 = 0 and t_j shrinks, J = 2 S t_j / pi with it:
`t_j = min((pi L / 16 S)^(1/4), (pi V / 4 S)^(1/3), (pi A / 2 S)^(1/2))`. So short legs are slow: V grows with about the
power 2/3 of the length.

A profile is a row of `PROFILE_SIZE` numbers: t_j, t_2, t_4, J, V, T_a, P_a, time at V, whole duration, length.
"""

from __future__ import annotations

import math

import numpy as np

from gcs.planning.numerics.compiled import compiled

Floats = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

PROFILE_SIZE = 10
_HALVINGS = 60


@compiled
def leg_profile(length: float, snap: float, jerk: float, acceleration: float, speed: float, out: Floats) -> None:
    """The profile of a leg of positive length under positive limits; `out` receives it, shape (10,)."""
    half = length / 2.0
    ramp = math.pi * jerk / (2.0 * snap)
    held = 0.0
    if min(acceleration, speed / (2.0 * ramp), half / (4.0 * ramp * ramp)) < jerk * ramp:
        by_length = (half * math.pi / (8.0 * snap)) ** 0.25
        by_speed = (speed * math.pi / (4.0 * snap)) ** (1.0 / 3.0)
        ramp = min(ramp, by_length, by_speed, math.sqrt(acceleration * math.pi / (2.0 * snap)))
        jerk = 2.0 * snap * ramp / math.pi
        peak = jerk * ramp
    else:
        # The greatest acceleration with which neither the speed nor half the length is exceeded.
        low, high = jerk * ramp, acceleration
        for _ in range(_HALVINGS):
            middle = (low + high) / 2.0
            quick = ramp + middle / jerk
            if middle * quick > speed or middle * quick * quick > half:
                high = middle
            else:
                low = middle
        peak = low
        held = peak / jerk - ramp
    rise = 2.0 * ramp + held
    until_speed = speed / peak - rise
    until_half = (math.sqrt(max(rise * rise + 8.0 * half / peak, 0.0)) - 3.0 * rise) / 2.0
    steady = max(min(until_speed, until_half), 0.0)
    out[0], out[1], out[2], out[3] = ramp, held, steady, jerk
    out[4] = peak * (rise + steady)
    out[5] = 2.0 * rise + steady
    out[6] = out[4] * out[5] / 2.0
    out[7] = max(length - 2.0 * out[6], 0.0) / out[4]
    out[8] = 2.0 * out[5] + out[7]
    out[9] = length


@compiled
def _rising(profile: Floats, t: float) -> tuple[float, float, float]:
    """Acceleration, speed and way in the first half of the acceleration."""
    ramp, held, jerk = profile[0], profile[1], profile[3]
    rate = math.pi / ramp
    square = rate * rate
    if t <= ramp:
        s, c = math.sin(rate * t), math.cos(rate * t)
        a = jerk / 2.0 * (t - s / rate)
        v = jerk / 2.0 * (t * t / 2.0 + (c - 1.0) / square)
        return a, v, jerk / 2.0 * (t**3 / 6.0 - t / square + s / (square * rate))
    a = jerk * ramp / 2.0
    v = jerk / 2.0 * (ramp * ramp / 2.0 - 2.0 / square)
    p = jerk / 2.0 * (ramp**3 / 6.0 - ramp / square)
    u = min(t - ramp, held)
    p += v * u + a * u * u / 2.0 + jerk * u**3 / 6.0
    v += a * u + jerk * u * u / 2.0
    a += jerk * u
    u = min(max(t - ramp - held, 0.0), ramp)
    s, c = math.sin(rate * u), math.cos(rate * u)
    p += v * u + a * u * u / 2.0 + jerk / 2.0 * (u**3 / 6.0 + u / square - s / (square * rate))
    v += a * u + jerk / 2.0 * (u * u / 2.0 - (c - 1.0) / square)
    a += jerk / 2.0 * (u + s / rate)
    u = max(t - 2.0 * ramp - held, 0.0)
    return a, v + a * u, p + v * u + a * u * u / 2.0


@compiled
def _accelerating(profile: Floats, t: float) -> tuple[float, float, float]:
    speed, duration, way = profile[4], profile[5], profile[6]
    if t >= duration:
        return 0.0, speed, way + speed * (t - duration)
    if t <= duration / 2.0:
        return _rising(profile, t)
    left = duration - t
    a, v, p = _rising(profile, left)
    return a, speed - v, way - speed * left + p


@compiled
def leg_state(profile: Floats, t: float) -> tuple[float, float, float]:
    """Acceleration (m/s^2), speed (m/s) and way (m) along a leg at a time (s) since its start."""
    duration = profile[8]
    if t <= 0.0 or duration <= 0.0:
        return 0.0, 0.0, 0.0
    if t >= duration:
        return 0.0, 0.0, profile[9]
    if t < profile[5] + profile[7]:
        return _accelerating(profile, t)
    a, v, p = _accelerating(profile, duration - t)
    return -a, v, profile[9] - p


@compiled
def limit_along(x: float, y: float, z: float, level: float, up: float, down: float) -> float:
    """How much a vector along a direction may have when its parts are limited (level, upwards, downwards)."""
    size = math.sqrt(x * x + y * y + z * z)
    most = math.inf
    across = math.hypot(x, y) / size
    if across > 1e-9:
        most = level / across
    if z / size > 1e-9:
        most = min(most, up * size / z)
    elif z / size < -1e-9:
        most = min(most, -down * size / z)
    return most
