"""Lines of sight past triangles and cables, by embree's ray casting (single precision)."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

from gcs.planning.numerics.compiled import compiled
from gcs.planning.numerics.worker_threads import in_threads

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from gcs.core.structure import Structure

CABLE_SIDES = 12
"""A cable blocks sight as the prism around it: 3.5 % thicker than it is."""

LAST_PIECE_M = 1e-3
"""The last piece before a target is not looked at."""

LINES_AT_A_TIME = 16384

Floats = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
SingleFloats = np.ndarray[tuple[int, ...], np.dtype[np.float32]]


class Rays(NamedTuple):
    """Lines as embree takes them, about the structure's middle.

    Attributes:
        origins: shape (N, 3), float32.
        directions: unit, shape (N, 3), float32.
        lengths: how far to look, shape (N,), float32.
    """

    origins: NDArray[np.float32]
    directions: NDArray[np.float32]
    lengths: NDArray[np.float32]


class SightLines:
    """Tests whether straight lines are blocked.

    Coordinates are kept about the structure's middle, so that single precision means about 10 micrometres on a
    structure of 100 m. May be used from several threads at once.

    Args:
        structure: what blocks sight, cables included.

    Attributes:
        middle_m: what rays are counted from, scene ENU, shape (3,).
    """

    def __init__(self, structure: Structure) -> None:
        self.middle_m = structure.bounds_m.mean(axis=0)
        triangles = [structure.triangles_m] + [
            _prism(a, b, r) for (a, b), r in zip(structure.cable_ends_m, structure.cable_radii_m, strict=True)
        ]
        self._scene = EmbreeScene()
        # the scene does not keep its mesh alive
        self._mesh = TriangleMesh(self._scene, (np.concatenate(triangles) - self.middle_m).astype(np.float32))
        self.clear_rays(
            Rays(*(np.ones((1, 3), dtype=np.float32),) * 2, np.ones(1, dtype=np.float32))
        )  # builds the tree

    def clear(self, origins: ArrayLike, targets: ArrayLike, tolerance: float = LAST_PIECE_M) -> NDArray[np.bool_]:
        """Whether nothing lies between; many lines are looked along in several threads.

        Args:
            origins: where from, scene ENU (m), shape (N, 3) or (3,).
            targets: where to, shape (N, 3).
            tolerance: the last piece (m) before the target is not looked at.

        Returns:
            Shape (N,).
        """
        to = np.asarray(targets, dtype=np.float64).reshape(-1, 3)
        start = np.broadcast_to(np.asarray(origins, dtype=np.float64), to.shape)

        def look(first: int) -> NDArray[np.bool_]:
            part = slice(first, first + LINES_AT_A_TIME)
            return self.clear_rays(Rays(*_rays(start[part], to[part], self.middle_m, tolerance)))

        if len(to) <= LINES_AT_A_TIME:
            return look(0)
        return np.concatenate(in_threads(look, range(0, len(to), LINES_AT_A_TIME)))

    def clear_rays(self, rays: Rays) -> NDArray[np.bool_]:
        """Whether nothing lies along rays, shape (N,); in the caller's thread, without the interpreter lock."""
        blocked = self._scene.run(rays.origins, rays.directions, dists=rays.lengths, query="OCCLUDED")
        return np.asarray(blocked == -1, dtype=np.bool_)

    def free_lengths(self, rays: Rays) -> NDArray[np.float64]:
        """How far (m) rays go before they hit something, at most their lengths, shape (N,); in the caller's thread."""
        hit = self._scene.run(rays.origins, rays.directions, query="DISTANCE")
        return np.asarray(np.minimum(hit, rays.lengths), dtype=np.float64)


@compiled
def _rays(
    origins: Floats, targets: Floats, middle: Floats, tolerance: float
) -> tuple[SingleFloats, SingleFloats, SingleFloats]:
    n = targets.shape[0]
    starts, directions, lengths = np.empty((n, 3), np.float32), np.empty((n, 3), np.float32), np.empty(n, np.float32)
    for i in range(n):
        x, y, z = targets[i, 0] - origins[i, 0], targets[i, 1] - origins[i, 1], targets[i, 2] - origins[i, 2]
        length = max(math.sqrt(x * x + y * y + z * z), 1e-12)
        directions[i, 0], directions[i, 1], directions[i, 2] = x / length, y / length, z / length
        lengths[i] = max(length - tolerance, 0.0)
        for k in range(3):
            starts[i, k] = origins[i, k] - middle[k]
    return starts, directions, lengths


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
