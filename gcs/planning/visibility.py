"""Lines of sight past triangles and cables, by embree's ray casting (single precision)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from gcs.core.structure import Structure

CABLE_SIDES = 12
"""A cable blocks sight as the prism around it: 3.5 % thicker than it is."""


class SightLines:
    """Tests whether straight lines are blocked.

    Coordinates are kept about the structure's middle, so that single precision means about 10 micrometres on a
    structure of 100 m.

    Args:
        structure: what blocks sight, cables included.
    """

    def __init__(self, structure: Structure) -> None:
        self._origin = structure.bounds_m.mean(axis=0)
        triangles = [structure.triangles_m] + [
            _prism(a, b, r) for (a, b), r in zip(structure.cable_ends_m, structure.cable_radii_m, strict=True)
        ]
        self._scene = EmbreeScene()
        # the scene does not keep its mesh alive
        self._mesh = TriangleMesh(self._scene, (np.concatenate(triangles) - self._origin).astype(np.float32))

    def clear(self, origins: ArrayLike, targets: ArrayLike, tolerance: float = 1e-3) -> NDArray[np.bool_]:
        """Whether nothing lies between.

        Args:
            origins: where from, scene ENU (m), shape (N, 3) or (3,).
            targets: where to, shape (N, 3).
            tolerance: the last piece (m) before the target is not looked at.

        Returns:
            Shape (N,).
        """
        to = np.asarray(targets, dtype=np.float64).reshape(-1, 3)
        start = np.broadcast_to(np.asarray(origins, dtype=np.float64), to.shape)
        ray = to - start
        length = np.sqrt(np.einsum("ij,ij->i", ray, ray))
        safe = np.maximum(length, 1e-12)
        reach = np.maximum(length - tolerance, 0.0)
        blocked = self._scene.run(
            (start - self._origin).astype(np.float32),
            (ray / safe[:, None]).astype(np.float32),
            dists=reach.astype(np.float32),
            query="OCCLUDED",
        )
        return np.asarray(blocked == -1, dtype=np.bool_)


def _prism(a: NDArray[np.float64], b: NDArray[np.float64], radius: float) -> NDArray[np.float64]:
    """The sides of a prism that holds a cylinder, shape (2 CABLE_SIDES, 3, 3)."""
    along = (b - a) / np.linalg.norm(b - a)
    side = np.cross(along, np.eye(3)[np.argmin(np.abs(along))])
    side /= np.linalg.norm(side)
    angle = 2 * np.pi * np.arange(CABLE_SIDES) / CABLE_SIDES
    ring = np.cos(angle)[:, None] * side + np.sin(angle)[:, None] * np.cross(along, side)
    ring *= radius / np.cos(np.pi / CABLE_SIDES)
    after = np.roll(ring, -1, axis=0)
    return np.concatenate([np.stack([a + ring, a + after, b + after], 1), np.stack([a + ring, b + after, b + ring], 1)])
