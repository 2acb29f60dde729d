"""Kernels that say what pictures show: from places, along axes, within limits; all about the structure's middle.

Axes of a camera are nine numbers: its right, its up and its view direction. Targets are sides of surface points.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gcs.planning.numerics.compiled import compiled
from gcs.planning.scene.visibility import LAST_PIECE_M

LIFT_M = 0.002
"""Targets are looked at this far above their side, so that their own triangle does not hide them."""

LEAST_KEPT = 0.5
"""Share of the image's width and height that the position error leaves at least."""

STRAIGHT = 1e-9

Floats = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
SingleFloats = np.ndarray[tuple[int, ...], np.dtype[np.float32]]
Ints = np.ndarray[tuple[int, ...], np.dtype[np.int64]]
ShortInts = np.ndarray[tuple[int, ...], np.dtype[np.int32]]
Marks = np.ndarray[tuple[int, ...], np.dtype[np.bool_]]


class PictureLimits(NamedTuple):
    """What a picture shows well enough (a named tuple, so that kernels can take it).

    Attributes:
        half_width: tangent of half the horizontal field of view.
        half_height: the same, vertical.
        core: share of the image's width and height, about its middle, that counts.
        nearest: smallest depth along the axis (m).
        furthest: largest depth (m).
        error: how far the camera may be from where it should be (m).
        depth_error: how much of that is allowed for in the largest depth (m).
        focal: focal length (m).
        hyperfocal: hyperfocal distance (m); 0 when the depth of field has no limits.
        nearest_focus: smallest depth that the lens can be focused on (m).
        least_cosine: cosine of the largest incidence.
        pitch_low: lowest pitch of the camera (rad).
        pitch_high: highest pitch (rad).
    """

    half_width: float
    half_height: float
    core: float
    nearest: float
    furthest: float
    error: float
    depth_error: float
    focal: float
    hyperfocal: float
    nearest_focus: float
    least_cosine: float
    pitch_low: float
    pitch_high: float


@compiled
def point_camera(x: float, y: float, z: float, limits: PictureLimits, axes: Floats) -> None:
    """Axes of a camera that looks along (x, y, z), or as near to it as its pitch range lets it; it does not roll."""
    level = math.hypot(x, y)
    yaw = math.atan2(y, x) if level > STRAIGHT else 0.0
    pitch = min(max(math.atan2(z, level), limits.pitch_low), limits.pitch_high)
    cp, sp, cy, sy = math.cos(pitch), math.sin(pitch), math.cos(yaw), math.sin(yaw)
    axes[0], axes[1], axes[2] = sy, -cy, 0.0
    axes[3], axes[4], axes[5] = -sp * cy, -sp * sy, cp
    axes[6], axes[7], axes[8] = cp * cy, cp * sy, sp


@compiled
def sharp_depths(focus: float, limits: PictureLimits) -> tuple[float, float]:
    """Nearest and furthest depth (m) that count, with the depth of field about a focus in them."""
    near, far = limits.nearest, limits.furthest
    if limits.hyperfocal > 0.0:
        s = max(focus, limits.nearest_focus)
        near = max(near, s * (limits.hyperfocal - limits.focal) / (limits.hyperfocal + s - 2 * limits.focal))
        if s < limits.hyperfocal:
            far = min(far, s * (limits.hyperfocal - limits.focal) / (limits.hyperfocal - s))
    return near, far


@compiled
def depth_shown(
    x: float, y: float, z: float, axes: Floats, limits: PictureLimits, near: float, far: float, tolerant: bool
) -> float:
    """Depth of what lies at (x, y, z) from the camera if its picture shows it well enough, else 0.

    Args:
        x: from the camera to the target, east.
        y: the same, north.
        z: the same, up.
        axes: of the camera.
        limits: what is well enough.
        near: smallest depth.
        far: largest depth.
        tolerant: whether it has to be shown as well with the camera off by the position error.
    """
    depth = axes[6] * x + axes[7] * y + axes[8] * z
    error = limits.error if tolerant else 0.0
    if depth <= 0.0 or depth < near or depth > far - (limits.depth_error if tolerant else 0.0):
        return 0.0
    width, height = limits.half_width * depth, limits.half_height * depth
    across = abs(axes[0] * x + axes[1] * y + axes[2] * z)
    if across > limits.core * width or across > max(width - error, LEAST_KEPT * width):
        return 0.0
    above = abs(axes[3] * x + axes[4] * y + axes[5] * z)
    if above > limits.core * height or above > max(height - error, LEAST_KEPT * height):
        return 0.0
    return float(depth)


@compiled
def faces(x: float, y: float, z: float, normal: SingleFloats, least_cosine: float) -> bool:
    """Whether a side with a normal is seen within the incidence limit along (x, y, z), from the camera to it."""
    along = -(x * normal[0] + y * normal[1] + z * normal[2])
    if along <= 0.0:
        return False
    return bool(along * along >= least_cosine * least_cosine * (x * x + y * y + z * z))


@compiled
def grown(array: ShortInts, size: int) -> ShortInts:
    """The array itself if it is that long, else a longer one that begins like it."""
    if size <= array.shape[0]:
        return array
    result = np.empty(max(size, 2 * array.shape[0]), np.int32)
    result[: array.shape[0]] = array
    return result


@compiled
def rays_to(
    places: SingleFloats, starts: Ints, which: ShortInts, points: SingleFloats, normals: SingleFloats
) -> tuple[SingleFloats, SingleFloats, SingleFloats]:
    """Rays from every place to its targets `which[starts[p]:starts[p + 1]]`, a little above their sides."""
    n = starts[-1]
    origins, directions, lengths = np.empty((n, 3), np.float32), np.empty((n, 3), np.float32), np.empty(n, np.float32)
    for p in range(places.shape[0]):
        for e in range(starts[p], starts[p + 1]):
            t = which[e]
            x = points[t, 0] + LIFT_M * normals[t, 0] - places[p, 0]
            y = points[t, 1] + LIFT_M * normals[t, 1] - places[p, 1]
            z = points[t, 2] + LIFT_M * normals[t, 2] - places[p, 2]
            length = math.sqrt(x * x + y * y + z * z)
            directions[e, 0], directions[e, 1], directions[e, 2] = x / length, y / length, z / length
            lengths[e] = max(length - LAST_PIECE_M, 0.0)
            for k in range(3):
                origins[e, k] = places[p, k]
    return origins, directions, lengths


@compiled
def facing_targets(
    places: SingleFloats, points: SingleFloats, normals: SingleFloats, furthest: float, least_cosine: float
) -> tuple[Ints, ShortInts]:
    """Targets near enough to each place that face it: where each place's begin, and their numbers."""
    starts = np.zeros(places.shape[0] + 1, np.int64)
    which: ShortInts = np.empty(4096, np.int32)
    found = 0
    for p in range(places.shape[0]):
        which = grown(which, found + points.shape[0])
        for t in range(points.shape[0]):
            x, y, z = points[t, 0] - places[p, 0], points[t, 1] - places[p, 1], points[t, 2] - places[p, 2]
            if x * x + y * y + z * z <= furthest * furthest and faces(x, y, z, normals[t], least_cosine):
                which[found] = t
                found += 1
        starts[p + 1] = found
    return starts, which[:found].copy()


@compiled
def kept(starts: Ints, which: ShortInts, keep: Marks) -> tuple[Ints, ShortInts]:
    """Lists side by side without the entries that are not kept."""
    short = np.empty(which.shape[0], np.int32)
    new_starts = np.zeros(starts.shape[0], np.int64)
    found = 0
    for p in range(starts.shape[0] - 1):
        for e in range(starts[p], starts[p + 1]):
            if keep[e]:
                short[found] = which[e]
                found += 1
        new_starts[p + 1] = found
    return new_starts, short[:found].copy()


@compiled
def pictured_targets(
    places: SingleFloats,
    axes: Floats,
    focus: Floats,
    points: SingleFloats,
    normals: SingleFloats,
    tolerant: Marks,
    limits: PictureLimits,
) -> tuple[Ints, ShortInts]:
    """Targets that pictures (one a place) would show if nothing hid them: where each one's begin, and their numbers."""
    starts = np.zeros(places.shape[0] + 1, np.int64)
    which: ShortInts = np.empty(4096, np.int32)
    found = 0
    for p in range(places.shape[0]):
        which = grown(which, found + points.shape[0])
        near, far = sharp_depths(focus[p], limits)
        for t in range(points.shape[0]):
            x, y, z = points[t, 0] - places[p, 0], points[t, 1] - places[p, 1], points[t, 2] - places[p, 2]
            if depth_shown(x, y, z, axes[p], limits, near, far, tolerant[t]) > 0.0 and faces(
                x, y, z, normals[t], limits.least_cosine
            ):
                which[found] = t
                found += 1
        starts[p + 1] = found
    return starts, which[:found].copy()


@compiled
def _show(
    place: SingleFloats,
    axes: Floats,
    visible: ShortInts,
    points: SingleFloats,
    tolerant: Marks,
    limits: PictureLimits,
    near: float,
    far: float,
    shown: ShortInts,
) -> tuple[int, float]:
    """Put the visible targets that a picture shows in `shown`; how many they are, and their mean depth."""
    count = 0
    depths = 0.0
    for e in range(visible.shape[0]):
        t = visible[e]
        x, y, z = points[t, 0] - place[0], points[t, 1] - place[1], points[t, 2] - place[2]
        depth = depth_shown(x, y, z, axes, limits, near, far, tolerant[t])
        if depth > 0.0:
            shown[count] = t
            count += 1
            depths += depth
    return count, depths / max(count, 1)


@compiled
def _turn_to_middle(
    place: SingleFloats,
    shown: ShortInts,
    points: SingleFloats,
    weights: SingleFloats,
    limits: PictureLimits,
    axes: Floats,
) -> None:
    """Turn a camera to the weighted middle of what it shows (one step of mean shift)."""
    sx, sy, sz = 0.0, 0.0, 0.0
    for e in range(shown.shape[0]):
        t = shown[e]
        x, y, z = points[t, 0] - place[0], points[t, 1] - place[1], points[t, 2] - place[2]
        share = weights[t] / math.sqrt(x * x + y * y + z * z)
        sx += share * x
        sy += share * y
        sz += share * z
    if sx * sx + sy * sy + sz * sz > 0.0:
        point_camera(sx, sy, sz, limits, axes)


@compiled
def aim_pictures(
    places: SingleFloats,
    starts: Ints,
    visible: ShortInts,
    points: SingleFloats,
    tolerant: Marks,
    weights: SingleFloats,
    draws: SingleFloats,
    limits: PictureLimits,
) -> tuple[Ints, ShortInts, ShortInts, Floats, Floats]:
    """Pictures from each place: aimed at visible targets drawn by weight, every other one turned to what it shows.

    Args:
        places: shape (P, 3).
        starts: where each place's visible targets begin, shape (P + 1,).
        visible: their numbers.
        points: shape (T, 3).
        tolerant: targets that have to be shown with the position error allowed for, shape (T,).
        weights: how much each target counts, shape (T,).
        draws: uniform random numbers, a picture each, shape (P, A).
        limits: what is shown well enough.

    Returns:
        Where each picture's targets begin, their numbers, each picture's place, its axes (K, 9) and its focus (K,).
        Of pictures from one place that show the same only the first is there, and none that shows nothing.
    """
    most = draws.shape[0] * draws.shape[1]
    ends = np.zeros(most + 1, np.int64)
    of_place = np.empty(most, np.int32)
    axes = np.empty((most, 9))
    focus = np.empty(most)
    marks = np.empty((most, 2), np.int64)
    members: ShortInts = np.empty(65536, np.int32)
    shown = np.empty(points.shape[0], np.int32)
    camera = np.empty(9)
    made = 0
    for p in range(places.shape[0]):
        seen = visible[starts[p] : starts[p + 1]]
        if seen.shape[0] == 0:
            continue
        summed = np.empty(seen.shape[0])
        total = 0.0
        for e in range(seen.shape[0]):
            total += weights[seen[e]]
            summed[e] = total
        first = made
        for a in range(draws.shape[1]):
            t = seen[min(np.searchsorted(summed, draws[p, a] * total), seen.shape[0] - 1)]
            point_camera(
                points[t, 0] - places[p, 0], points[t, 1] - places[p, 1], points[t, 2] - places[p, 2], limits, camera
            )
            near, far = limits.nearest, limits.furthest
            count, depth = _show(places[p], camera, seen, points, tolerant, limits, near, far, shown)
            if a % 2 == 0 and count > 0:
                _turn_to_middle(places[p], shown[:count], points, weights, limits, camera)
                count, depth = _show(places[p], camera, seen, points, tolerant, limits, near, far, shown)
            if limits.hyperfocal > 0.0 and count > 0:
                near, far = sharp_depths(depth, limits)
                count, _ = _show(places[p], camera, seen, points, tolerant, limits, near, far, shown)
            if count == 0:
                continue
            mark = 0
            for e in range(count):
                mark += shown[e] * shown[e]
            again = False
            for other in range(first, made):
                again = again or (marks[other, 0] == count and marks[other, 1] == mark)
            if again:
                continue
            members = grown(members, ends[made] + count)
            members[ends[made] : ends[made] + count] = shown[:count]
            of_place[made] = p
            axes[made] = camera
            focus[made] = depth
            marks[made, 0] = count
            marks[made, 1] = mark
            made += 1
            ends[made] = ends[made - 1] + count
    return (
        ends[: made + 1].copy(),
        members[: ends[made]].copy(),
        of_place[:made].copy(),
        axes[:made].copy(),
        focus[:made].copy(),
    )
