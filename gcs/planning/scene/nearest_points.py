"""Nearest points of segments and triangles (Ericson 2005, chapter 5)."""

from __future__ import annotations

import math

import numpy as np

from gcs.planning.numerics.compiled import compiled

Floats = np.ndarray[tuple[int, ...], np.dtype[np.float64]]


@compiled
def nearest_of_segment(p: Floats, a: Floats, b: Floats, q: Floats) -> None:
    """The point `q` of a segment that is nearest to a point."""
    along = 0.0
    square = 0.0
    for k in range(3):
        along += (p[k] - a[k]) * (b[k] - a[k])
        square += (b[k] - a[k]) ** 2
    share = min(max(along / square, 0.0), 1.0) if square > 0.0 else 0.0
    for k in range(3):
        q[k] = a[k] + share * (b[k] - a[k])


@compiled
def nearest_of_triangle(p: Floats, a: Floats, b: Floats, c: Floats, q: Floats) -> None:
    """The point `q` of a triangle that is nearest to a point: its foot where that lies inside, else on an edge."""
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    wx, wy, wz = p[0] - a[0], p[1] - a[1], p[2] - a[2]
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    nn = nx * nx + ny * ny + nz * nz
    if nn > 0.0:
        beta = ((wy * vz - wz * vy) * nx + (wz * vx - wx * vz) * ny + (wx * vy - wy * vx) * nz) / nn
        gamma = ((uy * wz - uz * wy) * nx + (uz * wx - ux * wz) * ny + (ux * wy - uy * wx) * nz) / nn
        if beta >= 0.0 and gamma >= 0.0 and beta + gamma <= 1.0:
            q[0] = a[0] + beta * ux + gamma * vx
            q[1] = a[1] + beta * uy + gamma * vy
            q[2] = a[2] + beta * uz + gamma * vz
            return
    best = math.inf
    tried = np.empty(3)
    for edge in range(3):
        if edge == 0:
            nearest_of_segment(p, a, b, tried)
        elif edge == 1:
            nearest_of_segment(p, b, c, tried)
        else:
            nearest_of_segment(p, c, a, tried)
        square = (tried[0] - p[0]) ** 2 + (tried[1] - p[1]) ** 2 + (tried[2] - p[2]) ** 2
        if square < best:
            best = square
            q[:] = tried


@compiled
def nearest_of_segments(a: Floats, b: Floats, c: Floats, d: Floats, p: Floats, q: Floats) -> float:
    """Squared distance of two segments; `p` of the first and `q` of the second are the nearest points."""
    aa = bb = ab = ac = bc = 0.0
    for k in range(3):
        u, v, w = b[k] - a[k], d[k] - c[k], a[k] - c[k]
        aa += u * u
        bb += v * v
        ab += u * v
        ac += u * w
        bc += v * w
    square = aa * bb - ab * ab
    s = min(max((ab * bc - ac * bb) / square, 0.0), 1.0) if square > 1e-14 * aa * bb else 0.0
    t = (ab * s + bc) / bb if bb > 0.0 else 0.0
    t = min(max(t, 0.0), 1.0)
    s = min(max((ab * t - ac) / aa, 0.0), 1.0) if aa > 0.0 else 0.0
    found = 0.0
    for k in range(3):
        p[k] = a[k] + s * (b[k] - a[k])
        q[k] = c[k] + t * (d[k] - c[k])
        found += (p[k] - q[k]) ** 2
    return found


@compiled
def nearest_of_segment_and_triangle(a: Floats, b: Floats, triangle: Floats, p: Floats, q: Floats) -> float:
    """Squared distance of a segment to a triangle (3, 3) that it does not cross; `p` and `q` are the nearest points."""
    best = math.inf
    tried, other = np.empty(3), np.empty(3)
    for end in (a, b):
        nearest_of_triangle(end, triangle[0], triangle[1], triangle[2], tried)
        square = 0.0
        for k in range(3):
            square += (tried[k] - end[k]) ** 2
        if square < best:
            best = square
            p[:], q[:] = end, tried
    for edge in range(3):
        square = nearest_of_segments(a, b, triangle[edge], triangle[(edge + 1) % 3], other, tried)
        if square < best:
            best = square
            p[:], q[:] = other, tried
    return best
