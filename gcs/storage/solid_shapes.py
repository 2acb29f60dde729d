"""Simple closed solids as triangles, facing outwards: hexahedra, boxes, beams, tubes and extruded profiles."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.structure import Structure

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike, NDArray

    from gcs.core.inspection import NamedPoint
    from gcs.core.structure_source import Cable

_HEXAHEDRON_QUADS = np.array([[0, 3, 2, 1], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]])


def hexahedron(corners: ArrayLike) -> NDArray[np.float64]:
    """Six quadrilaterals as triangles.

    Args:
        corners: shape (8, 3): a loop of four, counter-clockwise as seen from the four that follow, which lie beyond
            the first four in the same order.

    Returns:
        Triangles, shape (12, 3, 3).
    """
    quads = np.asarray(corners, dtype=np.float64)[_HEXAHEDRON_QUADS]
    return np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])


def box(low: ArrayLike, high: ArrayLike) -> NDArray[np.float64]:
    """An axis-aligned box between two corners; triangles of shape (12, 3, 3)."""
    (x0, y0, z0), (x1, y1, z1) = np.asarray(low, dtype=np.float64), np.asarray(high, dtype=np.float64)
    loop = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
    return hexahedron([(x, y, z0) for x, y in loop] + [(x, y, z1) for x, y in loop])


def _across(start: NDArray[np.float64], end: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Unit vectors square to an axis: sideways (level, if it can be) and upwards; side x up is along the axis."""
    along = (end - start) / np.linalg.norm(end - start)
    reference = np.array([0.0, 0.0, 1.0]) if abs(along[2]) < 0.99 else np.array([1.0, 0.0, 0.0])
    side = np.cross(reference, along)
    side /= np.linalg.norm(side)
    return side, np.cross(along, side)


def beam(start: ArrayLike, end: ArrayLike, width: float, height: float) -> NDArray[np.float64]:
    """A box along an axis (m), `width` sideways and `height` in the upward direction; triangles (12, 3, 3)."""
    a, b = np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64)
    side, up = _across(a, b)
    offsets = [sx * width / 2 * side + sy * height / 2 * up for sx, sy in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    return hexahedron([a + o for o in offsets] + [b + o for o in offsets])


def tube(
    start: ArrayLike, end: ArrayLike, radius: float, sides: int = 8, end_radius: float | None = None
) -> NDArray[np.float64]:
    """A closed prism with `sides` sides about an axis (m), or a frustum; triangles of shape (4 sides, 3, 3)."""
    a, b = np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64)
    side, up = _across(a, b)
    angle = 2 * np.pi * np.arange(sides) / sides
    circle = np.cos(angle)[:, None] * side + np.sin(angle)[:, None] * up
    first, last = a + radius * circle, b + (radius if end_radius is None else end_radius) * circle
    first_next, last_next = np.roll(first, -1, axis=0), np.roll(last, -1, axis=0)
    start_cap = np.stack([np.broadcast_to(a, first.shape), first_next, first], axis=1)
    end_cap = np.stack([np.broadcast_to(b, last.shape), last, last_next], axis=1)
    mantle = [np.stack([first, first_next, last_next], axis=1), np.stack([first, last_next, last], axis=1)]
    return np.concatenate([start_cap, end_cap, *mantle])


def profile_along(profile: ArrayLike, start: ArrayLike, end: ArrayLike, pieces: int = 1) -> NDArray[np.float64]:
    """A symmetric cross section drawn along a level axis, such as a rail or a bridge girder.

    Args:
        profile: half width and height above the axis (m) from the lowest level to the highest, shape (N, 2); heights
            ascend and half widths are above 0.
        start: first point of the axis, scene ENU, shape (3,).
        end: its last point, at the same height.
        pieces: how many stretches of equal length the sides are cut into, so that triangles do not get too long.

    Returns:
        Triangles, shape (4 (N - 1) + 4 N pieces, 3, 3).
    """
    half, height = np.asarray(profile, dtype=np.float64).T
    a, b = np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64)
    side, up = _across(a, b)
    right = half[:, None] * side + height[:, None] * up
    left = -half[:, None] * side + height[:, None] * up
    outline = np.concatenate([right, left[::-1]])
    after = np.roll(outline, -1, axis=0)
    parts = [_quads(left[:-1], left[1:], right[1:], right[:-1]) + a]
    stations = np.linspace(a, b, pieces + 1)
    parts += [_quads(outline + p, after + p, after + q, outline + q) for p, q in pairwise(stations)]
    parts.append(_quads(left[:-1], right[:-1], right[1:], left[1:]) + b)
    return np.concatenate(parts)


def structure_of_solids(
    solids: Sequence[NDArray[np.float64]],
    cables: tuple[Cable, ...] = (),
    named_points: tuple[NamedPoint, ...] = (),
    notes: tuple[str, ...] = (),
) -> Structure:
    """A structure of closed solids; where two have the same triangle from both sides, they are joined.

    Args:
        solids: triangles of each, shape (F, 3, 3), facing outwards.
        cables: straight capsules.
        named_points: the scene's own inspection points.
        notes: what the user is to know.
    """
    vertices, inverse = np.unique(np.concatenate(solids).reshape(-1, 3), axis=0, return_inverse=True)
    faces = inverse.reshape(-1, 3).astype(np.int64)
    turned = (faces.argmin(axis=1)[:, None] + np.arange(3)) % 3
    faces = np.unique(np.take_along_axis(faces, turned, axis=1), axis=0)
    both_ways = np.concatenate([faces, faces[:, [0, 2, 1]]])
    _, group, count = np.unique(both_ways, axis=0, return_inverse=True, return_counts=True)
    faces = faces[count[group.ravel()[: len(faces)]] == 1]  # a face from both sides lies inside
    return Structure(vertices, faces, cables, named_points, notes)


def _quads(
    a: NDArray[np.float64], b: NDArray[np.float64], c: NDArray[np.float64], d: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Quadrilaterals a-b-c-d as triangles, (N, 3) each -> (2 N, 3, 3)."""
    return np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
