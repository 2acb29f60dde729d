"""Which part of a surface nobody outside can see."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.structure import Structure
from gcs.planning.scene.visibility import SightLines
from gcs.planning.views.surface_samples import sample_surface

if TYPE_CHECKING:
    from numpy.typing import NDArray

SAMPLED_POINTS = 10_000
DIRECTIONS = 128
SEED = 7
LIFT_SHARE = 1e-5
"""Lines start this share of the structure's size above their side."""

GRAZING = 0.05


def inner_share(vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> float:
    """Share of the surface whose two sides are both inside.

    A side is outside if a straight line leads from it to far away, in one of 128 directions spread evenly. It is looked
    at in 10,000 points spread evenly over the surface.

    Args:
        vertices: any unit, shape (V, 3).
        faces: shape (F, 3), not degenerate.
    """
    structure = Structure(vertices, faces)
    size = float(np.linalg.norm(np.diff(structure.bounds_m, axis=0)))
    sides = sample_surface(structure, SAMPLED_POINTS, np.random.default_rng(SEED))
    sight = SightLines(structure)
    starts = sides.points_m + LIFT_SHARE * size * sides.normals
    seen = np.zeros(len(sides), dtype=np.bool_)
    for direction in _sphere(DIRECTIONS):
        tried = np.flatnonzero(~seen & (sides.normals @ direction > GRAZING))
        if len(tried):
            seen[tried] = sight.clear(starts[tried], starts[tried] + 1.1 * size * direction)
    half = len(sides) // 2
    return float((~seen[:half] & ~seen[half:]).mean())


def _sphere(count: int) -> NDArray[np.float64]:
    """Unit vectors spread evenly by the golden angle, shape (count, 3)."""
    k = np.arange(count)
    z = 1 - (2 * k + 1) / count
    angle = k * math.pi * (3 - math.sqrt(5))
    ring = np.sqrt(1 - z * z)
    return np.stack([ring * np.cos(angle), ring * np.sin(angle), z], axis=1)
