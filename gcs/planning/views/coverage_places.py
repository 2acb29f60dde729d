"""Places in front of sides, and what keeps a camera from being there or from showing the side from there."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gcs.planning.numerics.compiled import compiled
from gcs.planning.scene.fence import FenceVolume, fence_room
from gcs.planning.scene.outer_space import BLOCKED, ENCLOSED, OPEN, OuterSpace

Floats = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Longs = np.ndarray[tuple[int, ...], np.dtype[np.int64]]
Marks = np.ndarray[tuple[int, ...], np.dtype[np.bool_]]
Shorts = np.ndarray[tuple[int, ...], np.dtype[np.int16]]

LIMITS = 8
GIMBAL, INCIDENCE, TOO_FAR, NOT_SHARP, FENCE, GROUND, NOT_REACHABLE, TOO_CLOSE = (1 << k for k in range(LIMITS))
"""Limits that a place breaks, as bits in the order of the verdicts after `LEFT_OUT`."""

NOWHERE = -1
"""Instead of such bits: under the ground."""


class PlaceLimits(NamedTuple):
    """What a place has to keep (a named tuple, so that kernels can take it).

    Attributes:
        clearance: what the centre keeps from the structure and the ground (m).
        nearest: smallest distance from which a picture is sharp (m).
        furthest: largest distance that the GSD allows (m).
        steepest: largest incidence (rad).
        pitch_low: lowest pitch of the camera (rad).
        pitch_high: highest pitch (rad).
        ground: height of the ground; minus infinity when there is none.
    """

    clearance: float
    nearest: float
    furthest: float
    steepest: float
    pitch_low: float
    pitch_high: float
    ground: float


class Draws(NamedTuple):
    """How places are drawn: between two tilts (rad) from the normal and two distances (m).

    Attributes:
        least_tilt: smallest angle to the normal.
        most_tilt: largest angle.
        shortest: smallest distance.
        longest: largest distance.
        power: of the uniform draw that gives the distance: over 1 favours small ones; 0 spreads them by their
            logarithm.
        only_good: whether only places that break no limit are of interest.
    """

    least_tilt: float
    most_tilt: float
    shortest: float
    longest: float
    power: float
    only_good: bool = False


@compiled
def draw_places(
    points: Floats,
    normals: Floats,
    which: Longs,
    uniform: Floats,
    draws: Draws,
    limits: PlaceLimits,
    outer: OuterSpace,
    fence: FenceVolume,
) -> tuple[Floats, Shorts]:
    """A random place in front of each side, and the limits that it breaks.

    Cells stand for the places in them: what is not `TOO_CLOSE` has to be checked exactly.

    Args:
        points: shape (N, 3).
        normals: unit, shape (N, 3).
        which: the sides, shape (M,).
        uniform: random numbers from 0 to 1, shape (M, 3).
        draws: how places are drawn.
        limits: what they have to keep.
        outer: where a camera could be.
        fence: what to stay in.

    Returns:
        Places, shape (M, 3), and the bits of the limits that they break (`GIMBAL`, ...) or `NOWHERE`, shape (M,).
    """
    m = which.shape[0]
    places = np.empty((m, 3))
    broken = np.empty(m, np.int16)
    for i in range(m):
        p, n = points[which[i]], normals[which[i]]
        tilt = draws.least_tilt + (draws.most_tilt - draws.least_tilt) * math.sqrt(uniform[i, 0])
        azimuth = 2.0 * math.pi * uniform[i, 1]
        if draws.power > 0.0:
            length = draws.shortest + (draws.longest - draws.shortest) * uniform[i, 2] ** draws.power
        else:
            length = draws.shortest * (draws.longest / draws.shortest) ** uniform[i, 2]
        x, y, z = _tilted(n[0], n[1], n[2], tilt, azimuth)
        places[i, 0], places[i, 1], places[i, 2] = p[0] + length * x, p[1] + length * y, p[2] + length * z
        broken[i] = _broken(places[i], tilt, length, math.asin(min(max(-z, -1.0), 1.0)), limits, outer, fence)
    return places, broken


@compiled
def _tilted(nx: float, ny: float, nz: float, tilt: float, azimuth: float) -> tuple[float, float, float]:
    """The unit direction at a tilt from a unit normal."""
    if abs(nz) < 0.9:
        size = math.hypot(nx, ny)
        ux, uy, uz = ny / size, -nx / size, 0.0
    else:
        size = math.hypot(ny, nz)
        ux, uy, uz = 0.0, nz / size, -ny / size
    vx, vy, vz = ny * uz - nz * uy, nz * ux - nx * uz, nx * uy - ny * ux
    c, a, b = math.cos(tilt), math.sin(tilt) * math.cos(azimuth), math.sin(tilt) * math.sin(azimuth)
    return c * nx + a * ux + b * vx, c * ny + a * uy + b * vy, c * nz + a * uz + b * vz


@compiled
def _cell_state(x: float, y: float, z: float, outer: OuterSpace) -> int:
    """State of the cell that a point is in; `OPEN` outside the grid."""
    i = round((x - outer.low[0]) / outer.pitch)
    j = round((y - outer.low[1]) / outer.pitch)
    k = round((z - outer.low[2]) / outer.pitch)
    if not (0 <= i < outer.state.shape[0] and 0 <= j < outer.state.shape[1] and 0 <= k < outer.state.shape[2]):
        return OPEN
    return int(outer.state[i, j, k])


@compiled
def _broken(
    place: Floats,
    tilt: float,
    length: float,
    pitch: float,
    limits: PlaceLimits,
    outer: OuterSpace,
    fence: FenceVolume,
) -> int:
    if place[2] <= limits.ground:
        return NOWHERE
    state = _cell_state(place[0], place[1], place[2], outer)
    result = 0
    if pitch < limits.pitch_low or pitch > limits.pitch_high:
        result |= GIMBAL
    if tilt > limits.steepest:
        result |= INCIDENCE
    if length > limits.furthest:
        result |= TOO_FAR
    if length < limits.nearest:
        result |= NOT_SHARP
    if fence_room(place[0], place[1], place[2], fence) < 0.0:
        result |= FENCE
    if place[2] < limits.ground + limits.clearance:
        result |= GROUND
    if state == ENCLOSED:
        result |= NOT_REACHABLE
    if state == BLOCKED or length < limits.clearance:
        result |= TOO_CLOSE
    return result


@compiled
def in_open_cell(points: Floats, outer: OuterSpace) -> Marks:
    """Whether points are in cells of the open, shape (N, 3) -> (N,)."""
    result = np.empty(points.shape[0], np.bool_)
    for i in range(points.shape[0]):
        result[i] = _cell_state(points[i, 0], points[i, 1], points[i, 2], outer) == OPEN
    return result
