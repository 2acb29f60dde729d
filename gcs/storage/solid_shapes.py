"""Simple closed solids as triangles, facing outwards: hexahedra, boxes, beams and tubes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

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


def tube(start: ArrayLike, end: ArrayLike, radius: float, sides: int = 8) -> NDArray[np.float64]:
    """A closed prism with `sides` sides about an axis (m); triangles of shape (4 sides, 3, 3)."""
    a, b = np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64)
    side, up = _across(a, b)
    angle = 2 * np.pi * np.arange(sides) / sides
    ring = radius * (np.cos(angle)[:, None] * side + np.sin(angle)[:, None] * up)
    after = np.roll(ring, -1, axis=0)
    start_cap = np.stack([np.broadcast_to(a, ring.shape), a + after, a + ring], axis=1)
    end_cap = np.stack([np.broadcast_to(b, ring.shape), b + ring, b + after], axis=1)
    first = np.stack([a + ring, a + after, b + after], axis=1)
    second = np.stack([a + ring, b + after, b + ring], axis=1)
    return np.concatenate([start_cap, end_cap, first, second])
