"""A lattice mast of any number of triangles, for benchmarks that grow."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gcs.core.structure import Structure

BAYS = 70
BAY_M = 1.2
HALF_WIDTH_M = 1.5
BEAM_M = 0.12
CORNERS = ((-1, -1), (1, -1), (1, 1), (-1, 1))

_SIDES = ((0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7), (3, 2, 1, 0), (4, 5, 6, 7))
_BOX = np.array([t for a, b, c, d in _SIDES for t in ((a, b, c), (a, c, d))], dtype=np.int64)


def lattice_mast(split: int = 1) -> Structure:
    """A square mast of 84 m with posts, braces and rungs of square section.

    Args:
        split: every edge of its 10,080 triangles is cut into this many, which makes `split`² times as many triangles
            of the same surface.
    """
    boxes = []
    for bay in range(BAYS):
        low, high = bay * BAY_M, (bay + 1) * BAY_M
        for k in range(4):
            (x, y), (u, v) = (HALF_WIDTH_M * np.array(CORNERS[m % 4], dtype=np.float64) for m in (k, k + 1))
            boxes.append(_beam([x, y, low], [x, y, high]))
            boxes.append(_beam([x, y, low], [u, v, high] if bay % 2 else [u, v, low]))
            boxes.append(_beam([x, y, high], [u, v, high]))
    corners = np.concatenate(boxes)
    first = 8 * np.arange(len(boxes))
    faces = (_BOX[None] + first[:, None, None]).reshape(-1, 3)
    return _split(corners, faces, split)


def _beam(start: list[float], end: list[float]) -> NDArray[np.float64]:
    """The corners of a beam of square section, shape (8, 3): around its start, then around its end."""
    a, b = np.array(start, dtype=np.float64), np.array(end, dtype=np.float64)
    along = (b - a) / np.linalg.norm(b - a)
    side = np.cross(along, [0.0, 0.0, 1.0] if abs(along[2]) < 0.9 else [1.0, 0.0, 0.0])
    side /= np.linalg.norm(side)
    other = np.cross(along, side)
    ring = np.array([i * side + j * other for i, j in CORNERS]) * BEAM_M / 2
    return np.concatenate([a + ring, b + ring])


def _split(vertices: NDArray[np.float64], faces: NDArray[np.int64], n: int) -> Structure:
    """Every triangle as n² of the same shape; vertices are shared within what was one triangle."""
    index = {(i, j): k for k, (i, j) in enumerate((i, j) for i in range(n + 1) for j in range(n + 1 - i))}
    weights = np.array([(n - i - j, i, j) for i, j in index], dtype=np.float64) / n
    upright = [(index[i, j], index[i + 1, j], index[i, j + 1]) for i in range(n) for j in range(n - i)]
    inverted = [(index[i + 1, j], index[i + 1, j + 1], index[i, j + 1]) for i in range(n - 1) for j in range(n - 1 - i)]
    pattern = np.array(upright + inverted, dtype=np.int64)
    points = np.einsum("pk,fkx->fpx", weights, vertices[faces])
    first = len(weights) * np.arange(len(faces))
    return Structure(points.reshape(-1, 3), (pattern[None] + first[:, None, None]).reshape(-1, 3))
