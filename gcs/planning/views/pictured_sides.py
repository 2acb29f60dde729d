"""Which sides of a surface pictures show: sides in blocks, so that most are never looked at."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np

from gcs.planning.numerics.compiled import compiled

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from gcs.core.camera import Camera
    from gcs.core.inspection import SurfaceTask
    from gcs.core.progress import Progress
    from gcs.core.scenario import Scenario
    from gcs.planning.scene.visibility import SightLines

Floats = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Longs = np.ndarray[tuple[int, ...], np.dtype[np.int64]]
Marks = np.ndarray[tuple[int, ...], np.dtype[np.bool_]]

SIDES_PER_BLOCK = 64


class View(Protocol):
    """What a picture needs; both poses and planned viewpoints have it."""

    @property
    def position_m(self) -> NDArray[np.float64]:
        """Camera position, shape (3,)."""
        ...

    @property
    def direction(self) -> NDArray[np.float64]:
        """Unit view direction, shape (3,)."""
        ...

    @property
    def up(self) -> NDArray[np.float64]:
        """Unit upward direction of the image, shape (3,)."""
        ...

    @property
    def gsd_m(self) -> float:
        """Ground sampling distance (m a pixel) where it is focused."""
        ...


class Shown(NamedTuple):
    """What counts as shown.

    Attributes:
        camera: its image, and how sharp it is.
        furthest_m: largest depth along the axis.
        steepest_rad: largest incidence.
        drift_m_s: speed at which the vehicle drifts while a picture is taken.
    """

    camera: Camera
    furthest_m: float
    steepest_rad: float
    drift_m_s: float

    @classmethod
    def as_asked(cls, task: SurfaceTask, scenario: Scenario) -> Shown:
        """What a surface task counts as shown."""
        return cls(
            scenario.camera,
            scenario.camera.distance_for_gsd(task.gsd_mm / 1000),
            math.radians(task.max_incidence_deg),
            scenario.vehicle.hover_speed_m_s,
        )


class _Blocks(NamedTuple):
    """Sides that lie together.

    Attributes:
        order: numbers of the sides, block after block, shape (N,).
        starts: where each block begins in `order`, shape (B + 1,).
        middles: centre of each block's sphere, shape (B, 3).
        radii: radius of each block's sphere, shape (B,).
    """

    order: NDArray[np.int64]
    starts: NDArray[np.int64]
    middles: NDArray[np.float64]
    radii: NDArray[np.float64]


class _Picture(NamedTuple):
    """Position, axes (right, up, view direction), tangents of half the view, depth limits, cosine of the incidence."""

    position: NDArray[np.float64]
    axes: NDArray[np.float64]
    half_width: float
    half_height: float
    near: float
    far: float
    least_cosine: float


def pictured_sides(
    points_m: NDArray[np.float64],
    normals: NDArray[np.float64],
    lifted_m: NDArray[np.float64],
    views: Sequence[View],
    shown: Shown,
    sight: SightLines,
    progress: Progress,
    stage: str,
) -> NDArray[np.bool_]:
    """Which sides at least one picture shows: near enough, sharp, within the incidence limit, with clear sight.

    Args:
        points_m: shape (N, 3).
        normals: of the sides, unit, shape (N, 3).
        lifted_m: where the sides are looked at, shape (N, 3).
        views: the pictures.
        shown: what counts.
        sight: what hides sides.
        progress: told about the stage, up to 0.3 of it.
        stage: its name.

    Returns:
        Shape (N,).
    """
    seen = np.zeros(len(points_m), dtype=np.bool_)
    if not len(points_m):
        return seen
    blocks = _blocks(points_m)
    for done, view in enumerate(views):
        picture = _picture(view, shown)
        if picture.near <= picture.far:
            which = _in_picture(points_m, normals, seen, blocks, picture)
            seen[which[sight.clear(picture.position, lifted_m[which])]] = True
        if done % 8 == 0:
            progress.report(stage, 0.3 * done / len(views))
    return seen


def _picture(view: View, shown: Shown) -> _Picture:
    camera = shown.camera
    near, far = camera.sharp_between_m(camera.distance_for_gsd(view.gsd_m))
    still = shown.drift_m_s / camera.fastest_m_s(1.0)  # blur and skew in pixels grow with the inverse of the depth
    direction, up = np.asarray(view.direction, dtype=np.float64), np.asarray(view.up, dtype=np.float64)
    return _Picture(
        position=np.ascontiguousarray(view.position_m, dtype=np.float64),
        axes=np.stack([np.cross(direction, up), up, direction]),
        half_width=camera.half_width_tangent,
        half_height=camera.half_height_tangent,
        near=max(near, still),
        far=min(far, shown.furthest_m),
        least_cosine=math.cos(shown.steepest_rad),
    )


def _blocks(points_m: NDArray[np.float64]) -> _Blocks:
    """Sides in cubes, as many as give about `SIDES_PER_BLOCK` sides each if half of the cubes' layers are surface."""
    low = points_m.min(axis=0)
    size = np.maximum(points_m.max(axis=0) - low, 1e-6)
    edge = float(size.max()) * math.sqrt(SIDES_PER_BLOCK / len(points_m))
    cell = np.floor((points_m - low) / edge).astype(np.int64)
    counts = cell.max(axis=0) + 1
    key = (cell[:, 0] * counts[1] + cell[:, 1]) * counts[2] + cell[:, 2]
    order = np.argsort(key, kind="stable")
    starts = np.concatenate([[0], np.flatnonzero(np.diff(key[order])) + 1, [len(order)]]).astype(np.int64)
    sorted_points = points_m[order]
    lowest = np.minimum.reduceat(sorted_points, starts[:-1])
    highest = np.maximum.reduceat(sorted_points, starts[:-1])
    return _Blocks(order, starts, (lowest + highest) / 2, np.linalg.norm(highest - lowest, axis=1) / 2)


@compiled
def _in_picture(points: Floats, normals: Floats, seen: Marks, blocks: _Blocks, picture: _Picture) -> Longs:
    """Numbers of the unseen sides that a picture shows when nothing hides them."""
    result = np.empty(points.shape[0], np.int64)
    count = 0
    px, py, pz = picture.position[0], picture.position[1], picture.position[2]
    right, up, view = picture.axes[0], picture.axes[1], picture.axes[2]
    w, h = picture.half_width, picture.half_height
    # distance from the plane through a picture's edge is (half width times depth less offset) over this
    slant_w, slant_h = math.sqrt(1.0 + w * w), math.sqrt(1.0 + h * h)
    for b in range(blocks.radii.shape[0]):
        x, y, z = blocks.middles[b, 0] - px, blocks.middles[b, 1] - py, blocks.middles[b, 2] - pz
        r = blocks.radii[b] + 1e-9
        depth = view[0] * x + view[1] * y + view[2] * z
        if depth + r <= 0.0 or depth + r < picture.near or depth - r > picture.far:
            continue
        if abs(right[0] * x + right[1] * y + right[2] * z) - w * depth > r * slant_w:
            continue
        if abs(up[0] * x + up[1] * y + up[2] * z) - h * depth > r * slant_h:
            continue
        for e in range(blocks.starts[b], blocks.starts[b + 1]):
            t = blocks.order[e]
            if seen[t]:
                continue
            x, y, z = points[t, 0] - px, points[t, 1] - py, points[t, 2] - pz
            depth = view[0] * x + view[1] * y + view[2] * z
            if depth <= 0.0 or depth < picture.near or depth > picture.far:
                continue
            if abs(right[0] * x + right[1] * y + right[2] * z) > w * depth:
                continue
            if abs(up[0] * x + up[1] * y + up[2] * z) > h * depth:
                continue
            along = -(x * normals[t, 0] + y * normals[t, 1] + z * normals[t, 2])
            if along >= picture.least_cosine * math.sqrt(x * x + y * y + z * z):
                result[count] = t
                count += 1
    return result[:count].copy()
