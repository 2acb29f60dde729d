"""How ArduCopter flies spline waypoints (its AC_WPNav and SplineCurve, as documented and published).

Each leg is the cubic of Hermite from place to place whose tangent at a waypoint points from the one before to the one
after it, as long as they are apart; both tangents together are no longer than four times the leg. The speed is bounded
by that of the direction, by half the acceleration across the curve, and by half of it along the curve towards the
speed at the leg's end, where the next leg's bound counts too. No acceleration is fed forward, so the vehicle is carried
out of every bend.
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from gcs.planning.dynamics.position_control import STATE_SIZE, follow
from gcs.planning.dynamics.predicted_flight import SAMPLE_S
from gcs.planning.dynamics.s_curve import limit_along
from gcs.planning.numerics.compiled import compiled

Floats = np.ndarray[tuple[int, ...], np.dtype[np.float64]]

_STEP_S = 0.01
_STEPS_A_SAMPLE = round(SAMPLE_S / _STEP_S)
_TANGENT_SHARE = 4.0
_ACCELERATION_SHARE = 0.5

_SLOWEST_M_S = 0.2
_CLOCK_SLACK = 0.05
_SETTLE_S = 3.0


def fly_splines(points: Floats, limits: Floats, pacing: Floats, gains: Floats) -> tuple[Floats, bool]:
    """Fly through places on splines, from rest to rest.

    Args:
        points: shape (N, 3), no two neighbours the same.
        limits: level speed, climb, descent, level and vertical acceleration, shape (5,).
        pacing: see `target_pace`.
        gains: of the position control.

    Returns:
        Positions `SAMPLE_S` apart, shape (K, 3), and whether the end was reached.
    """
    tangents = np.zeros_like(points)
    tangents[1:-1] = points[2:] - points[:-2]
    cubics = np.empty((len(points) - 1, 4, 3))
    for k, (a, b) in enumerate(pairwise(points)):
        u, v = tangents[k], tangents[k + 1]
        size = float(np.linalg.norm(u) + np.linalg.norm(v))
        scale = min(_TANGENT_SHARE * float(np.linalg.norm(b - a)) / size, 1.0) if size > 0 else 1.0
        u, v = scale * u, scale * v
        cubics[k] = a, u, 3.0 * (b - a) - 2.0 * u - v, 2.0 * (a - b) + u + v
    length = float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
    samples = np.empty((math.ceil((length / _SLOWEST_M_S + 60.0) / SAMPLE_S), 3))
    used, finished = _fly(cubics, limits, pacing, gains, samples)
    return samples[:used].copy(), finished


@compiled
def target_pace(state: Floats, reference: Floats, pacing: Floats, pace: float, dt: float) -> float:
    """How fast the target's clock runs, 0 to 1: slower for a vehicle that is behind.

    Args:
        state: the vehicle's.
        reference: place, velocity and acceleration of the target, shape (9,).
        pacing: time constant (s) of the pace, and the position gain (1/s).
        pace: until now.
        dt: step, s.
    """
    wanted = 1.0
    speed = math.sqrt(reference[3] ** 2 + reference[4] ** 2 + reference[5] ** 2)
    if speed > 1e-6:
        behind, made = 0.0, 0.0
        for k in range(3):
            behind += (reference[k] - state[k]) * reference[3 + k] / speed
            made += state[3 + k] * reference[3 + k] / speed
        wanted = min(max(_CLOCK_SLACK + (made - pacing[1] * behind) / speed, 0.0), 1.0)
    return float(pace + (wanted - pace) * min(dt / pacing[0], 1.0))


@compiled
def _at(cubic: Floats, u: float, place: Floats, along: Floats, limits: Floats, end: Floats, end_speed: float) -> Floats:
    """Place and unit direction on a leg; returns its rate (m per unit), speed bound and acceleration bound.

    At a leg's first point, where it starts from rest, the rate is zero and the direction that of the acceleration.
    """
    bend, tangent = np.empty(3), np.empty(3)
    rate, pull = 0.0, 0.0
    for k in range(3):
        place[k] = cubic[0, k] + u * (cubic[1, k] + u * (cubic[2, k] + u * cubic[3, k]))
        tangent[k] = cubic[1, k] + u * (2.0 * cubic[2, k] + 3.0 * u * cubic[3, k])
        bend[k] = 2.0 * cubic[2, k] + 6.0 * u * cubic[3, k]
        rate += tangent[k] ** 2
        pull += bend[k] ** 2
    rate, pull = math.sqrt(rate), math.sqrt(pull)
    out = np.zeros(4)
    if rate < 1e-9 and pull < 1e-9:
        return out
    for k in range(3):
        along[k] = tangent[k] / rate if rate >= 1e-9 else bend[k] / pull
    inline, across = 0.0, 0.0
    for k in range(3):
        inline += bend[k] * along[k]
    for k in range(3):
        bend[k] -= inline * along[k]
        across += bend[k] ** 2
    across = math.sqrt(across)
    speed = limit_along(along[0], along[1], along[2], limits[0], limits[1], limits[2])
    if across > 1e-9 and rate >= 1e-9:
        most = _ACCELERATION_SHARE * limit_along(bend[0], bend[1], bend[2], limits[3], limits[4], limits[4])
        speed = min(speed, rate / math.sqrt(across / most))
    acceleration = _ACCELERATION_SHARE * limit_along(along[0], along[1], along[2], limits[3], limits[4], limits[4])
    left = 0.0
    for k in range(3):
        left += (end[k] - place[k]) ** 2
    speed = min(speed, math.sqrt(2.0 * acceleration * math.sqrt(left) + end_speed**2))
    out[0], out[1], out[2], out[3] = rate, speed, acceleration, pull
    return out


@compiled
def _fly(cubics: Floats, limits: Floats, pacing: Floats, gains: Floats, samples: Floats) -> tuple[int, bool]:
    legs = cubics.shape[0]
    ends, place, along = np.empty((legs, 3)), np.empty(3), np.zeros(3)
    end_speed = np.zeros(legs)
    for leg in range(legs):
        ends[leg] = cubics[leg, 0] + cubics[leg, 1] + cubics[leg, 2] + cubics[leg, 3]
    for leg in range(legs - 1):
        here = _at(cubics[leg], 1.0, place, along, limits, ends[leg], math.inf)
        onward = _at(cubics[leg + 1], 0.0, place, along, limits, ends[leg + 1], math.inf)
        end_speed[leg] = min(here[1], onward[1])
    state = np.zeros(STATE_SIZE)
    state[:3] = cubics[0, 0]
    reference = np.zeros(9)
    reference[:3] = cubics[0, 0]
    leg, u, speed, pace, settled = 0, 0.0, 0.0, 1.0, 0.0
    for step in range((samples.shape[0] - 1) * _STEPS_A_SAMPLE):
        if step % _STEPS_A_SAMPLE == 0:
            samples[step // _STEPS_A_SAMPLE] = state[:3]
            if settled > _SETTLE_S:
                return step // _STEPS_A_SAMPLE + 1, True
        pace = target_pace(state, reference, pacing, pace, _STEP_S)
        dt = _STEP_S * pace
        if leg < legs:
            on = _at(cubics[leg], u, place, along, limits, ends[leg], end_speed[leg])
            speed = min(max(on[1], speed - on[2] * dt), speed + on[2] * dt)
            for k in range(3):
                reference[k], reference[3 + k] = place[k], along[k] * speed
            way = speed * dt
            u += way / on[0] if on[0] >= 1e-9 else math.sqrt(2.0 * way / max(on[3], 1e-9))
            if u >= 1.0 or (leg == legs - 1 and speed < 1e-3 and u > 0.5):
                leg, u = leg + 1, 0.0
        else:
            settled += _STEP_S
            reference[3:6] = 0.0
        follow(state, reference, gains, _STEP_S)
    return samples.shape[0] - 1, False
