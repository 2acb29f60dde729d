"""What a camera sees of sampled surface: in the image, near enough for the GSD, not too slanting, from its side."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from gcs.core.camera import Camera


def in_image(
    camera: Camera,
    position_m: ArrayLike,
    direction: ArrayLike,
    up: ArrayLike,
    points_m: NDArray[np.float64],
    max_depth_m: float,
    core: float = 1.0,
) -> NDArray[np.bool_]:
    """Which points lie in the picture and near enough.

    Args:
        camera: the pinhole camera; the image's width is across `up`.
        position_m: of the camera, shape (3,).
        direction: unit view direction, shape (3,).
        up: unit upward direction of the image, square to it, shape (3,).
        points_m: shape (N, 3).
        max_depth_m: largest depth along the axis; the GSD of a point is that of its depth.
        core: share of the image's width and height, about its middle, that counts.

    Returns:
        Shape (N,).
    """
    view, upward = np.asarray(direction, dtype=np.float64), np.asarray(up, dtype=np.float64)
    axes = np.stack([np.cross(view, upward), upward, view])
    x, y, depth = axes @ (points_m - np.asarray(position_m)).T
    wide = np.abs(x) <= core * camera.half_width_tangent * depth
    high = np.abs(y) <= core * camera.half_height_tangent * depth
    inside: NDArray[np.bool_] = (depth > 0) & (depth <= max_depth_m) & wide & high
    return inside


def sharp_in_image(
    camera: Camera,
    position_m: ArrayLike,
    direction: ArrayLike,
    up: ArrayLike,
    points_m: NDArray[np.float64],
    max_depth_m: float,
    focus_m: float,
    core: float = 1.0,
) -> NDArray[np.bool_]:
    """Which points lie in the picture, near enough, and within its depth of field, shape (N,).

    Args:
        camera: as for `in_image`, as are the next five and `core`.
        position_m: of the camera, shape (3,).
        direction: unit view direction, shape (3,).
        up: unit upward direction of the image, shape (3,).
        points_m: shape (N, 3).
        max_depth_m: largest depth along the axis.
        focus_m: depth that is focused on.
        core: share of the image that counts.
    """
    nearest, furthest = camera.sharp_between_m(focus_m)
    inside = in_image(camera, position_m, direction, up, points_m, min(max_depth_m, furthest), core)
    if nearest > 0:
        depth = (points_m - np.asarray(position_m)) @ np.asarray(direction, dtype=np.float64)
        inside &= depth >= nearest
    return inside


def faces_camera(
    position_m: ArrayLike, points_m: NDArray[np.float64], normals: NDArray[np.float64], max_incidence_rad: float
) -> NDArray[np.bool_]:
    """Which sides look at a position within the incidence limit.

    Args:
        position_m: one for all, shape (3,), or one a point, shape (N, 3).
        points_m: shape (N, 3).
        normals: unit, shape (N, 3).
        max_incidence_rad: largest angle between the normal and the line to the camera.
    """
    to_camera = np.asarray(position_m) - points_m
    along = np.einsum("ij,ij->i", to_camera, normals)
    length = np.sqrt(np.einsum("ij,ij->i", to_camera, to_camera))
    facing: NDArray[np.bool_] = along >= math.cos(max_incidence_rad) * length
    return facing


def furthest_in_image(camera: Camera, max_depth_m: float) -> float:
    """Distance (m) of the furthest point that the picture's corners show at that depth along the axis."""
    return max_depth_m * math.sqrt(1 + camera.half_width_tangent**2 + camera.half_height_tangent**2)


def footprint_area(camera: Camera, depth_m: float) -> float:
    """Area (m²) that the picture shows of a plane square to its axis."""
    return 4 * camera.half_width_tangent * camera.half_height_tangent * depth_m**2
