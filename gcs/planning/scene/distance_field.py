"""Euclidean distance field of a structure on a grid of cubes: a lower bound of the distance, cheap to look up."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.errors import InputError
from gcs.core.progress import SilentProgress
from gcs.planning.numerics.compiled import compiled
from gcs.planning.scene.distance_transform import squared_distance_transform

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from gcs.core.progress import Progress
    from gcs.core.structure import Structure

HALF_DIAGONAL = math.sqrt(3.0) / 2
"""Distance from a unit cube's centre to its corners."""

SAMPLE_GAP = 0.25
"""Every surface point lies this close (in pitches) to a sample that marks its cell."""

FINEST_PITCH_M = 0.25
COARSEST_PITCH_M = 1.0
TYPICAL_CELLS = 4e6
MOST_CELLS = 12e6
TRIANGLES_AT_A_TIME = 20000

Floats = np.ndarray[tuple[int, ...], np.dtype[np.float64]]
Marks = np.ndarray[tuple[int, ...], np.dtype[np.bool_]]


@dataclass(frozen=True, eq=False)
class DistanceField:
    """A lower bound of the distance to triangles and cable hulls (not to the ground).

    Attributes:
        structure: what the distances are to.
        origin_m: lowest corner of the grid, scene ENU, shape (3,); the centre of cell `i` is
            `origin_m + (i + 1/2) pitch_m`.
        pitch_m: edge of the cubes.
        distance_m: shape (nx, ny, nz), float32: for each cell's centre, at most the true distance and at least the
            true distance less `looseness_m`.
    """

    structure: Structure
    origin_m: NDArray[np.float64]
    pitch_m: float
    distance_m: NDArray[np.float32]

    @property
    def looseness_m(self) -> float:
        """How much larger than `distance_m` the true distance of a centre may be (m)."""
        return (2 * HALF_DIAGONAL + SAMPLE_GAP) * self.pitch_m

    @property
    def high_m(self) -> NDArray[np.float64]:
        """Highest corner of the grid, shape (3,)."""
        return self.origin_m + self.pitch_m * np.array(self.distance_m.shape)

    def at(self, points: ArrayLike) -> NDArray[np.float64]:
        """Lower bound of the distance (m) of any points, shape (N, 3) -> (N,); 0 outside the grid.

        The distance changes by at most the way from the cell's centre to the point.
        """
        p = np.asarray(points, dtype=np.float64).reshape(-1, 3)
        cell = np.floor((p - self.origin_m) / self.pitch_m).astype(np.int64)
        inside = ((cell >= 0) & (cell < self.distance_m.shape)).all(axis=1)
        result = np.zeros(len(p))
        c, q = cell[inside], p[inside]
        off = np.linalg.norm(q - (self.origin_m + (c + 0.5) * self.pitch_m), axis=1)
        result[inside] = np.maximum(self.distance_m[c[:, 0], c[:, 1], c[:, 2]] - off, 0.0)
        return result


def choose_pitch(low_m: ArrayLike, high_m: ArrayLike, clearance_m: float) -> float:
    """Edge of the grid's cubes (m) for a box: as fine as a few million cells allow.

    At most a third of the clearance and 1 m, unless that would need more than 12 million cells; never below 0.25 m.
    A coarse grid is still safe; it only loses the narrowest passages.
    """
    volume = float(np.prod(np.asarray(high_m, dtype=np.float64) - np.asarray(low_m, dtype=np.float64)))
    wanted = min(max(math.cbrt(volume / TYPICAL_CELLS), FINEST_PITCH_M), clearance_m / 3, COARSEST_PITCH_M)
    return max(wanted, math.cbrt(volume / MOST_CELLS), FINEST_PITCH_M)


def build_distance_field(
    structure: Structure, low_m: ArrayLike, high_m: ArrayLike, pitch_m: float, progress: Progress | None = None
) -> DistanceField:
    """Mark the cells that hold surface and take the Euclidean distance transform of the rest.

    Args:
        structure: triangles and cables.
        low_m: lowest corner of the volume, scene ENU, shape (3,); the structure must lie inside the volume.
        high_m: highest corner; rounded up to whole cells.
        pitch_m: edge of the cubes.
        progress: told about the stage `distance_field`.

    Raises:
        InputError: the structure reaches out of the volume.
    """
    progress = progress or SilentProgress()
    low = np.asarray(low_m, dtype=np.float64)
    shape = np.maximum(np.ceil((np.asarray(high_m, dtype=np.float64) - low) / pitch_m - 1e-9).astype(np.int64), 1)
    bounds = structure.bounds_m
    if (bounds[0] < low).any() or (bounds[1] > low + shape * pitch_m).any():
        raise InputError("the structure reaches out of the planning volume", field="structure")
    progress.report("distance_field", 0.0)

    occupied = np.zeros(shape, dtype=np.bool_)
    for first in range(0, len(structure.faces), TRIANGLES_AT_A_TIME):
        faces = structure.faces[first : first + TRIANGLES_AT_A_TIME]
        _mark_triangles(occupied, (structure.vertices_m[faces] - low) / pitch_m)
        progress.report("distance_field", 0.4 * first / len(structure.faces))
    if structure.cables:
        _mark_capsules(occupied, (structure.cable_ends_m - low) / pitch_m, structure.cable_radii_m / pitch_m)
    progress.report("distance_field", 0.4)
    distance = squared_distance_transform(occupied)
    progress.report("distance_field", 0.9)
    # the surface lies in the nearest marked cell or up to the sample gap outside it
    np.sqrt(distance, out=distance)
    distance -= np.float32(HALF_DIAGONAL + SAMPLE_GAP)
    np.maximum(distance, 0.0, out=distance)
    distance *= np.float32(pitch_m * (1 - 1e-6))  # rounding to float32 must not round up past the bound
    progress.report("distance_field", 1.0)
    return DistanceField(structure, low, float(pitch_m), distance)


@compiled
def _mark_triangles(occupied: Marks, triangles: Floats) -> None:
    """Mark the cells of samples on the triangles (in pitches): rows along the longest edge, both gaps bounded."""
    nx, ny, nz = occupied.shape
    for f in range(triangles.shape[0]):
        longest = -1.0
        a = 0
        for k in range(3):
            edge = 0.0
            for c in range(3):
                edge += (triangles[f, (k + 1) % 3, c] - triangles[f, k, c]) ** 2
            if edge > longest:
                longest, a = edge, k
        longest = math.sqrt(longest)
        base, tip, apex = triangles[f, a], triangles[f, (a + 1) % 3], triangles[f, (a + 2) % 3]
        # rows are `row` apart at most along the sides; a point is within half a row and half a step of a sample
        left, right = 0.0, 0.0
        for c in range(3):
            left += (apex[c] - base[c]) ** 2
            right += (apex[c] - tip[c]) ** 2
        rows = math.ceil(math.sqrt(max(left, right)) / SAMPLE_GAP) + 1
        for i in range(rows + 1):
            share = i / rows
            steps = math.ceil(longest * (1.0 - share) / SAMPLE_GAP) + 1
            for j in range(steps + 1):
                along = (1.0 - share) * j / steps
                x = base[0] + share * (apex[0] - base[0]) + along * (tip[0] - base[0])
                y = base[1] + share * (apex[1] - base[1]) + along * (tip[1] - base[1])
                z = base[2] + share * (apex[2] - base[2]) + along * (tip[2] - base[2])
                # a surface on the grid's highest face belongs to the last cell
                cx, cy, cz = (
                    min(math.floor(x), nx - 1),
                    min(math.floor(y), ny - 1),
                    min(math.floor(z), nz - 1),
                )
                occupied[max(cx, 0), max(cy, 0), max(cz, 0)] = True


@compiled
def _mark_capsules(occupied: Marks, ends: Floats, radii: Floats) -> None:
    """Mark every cell whose cube a capsule (in pitches) may touch: its centre is within a half diagonal of it."""
    nx, ny, nz = occupied.shape
    for c in range(ends.shape[0]):
        a, b = ends[c, 0], ends[c, 1]
        steps = math.ceil(np.linalg.norm(b - a)) + 1
        reach = radii[c] + 1.0 + HALF_DIAGONAL  # samples of the axis are at most one pitch apart
        near = math.ceil(reach) + 1
        for i in range(steps + 1):
            p = a + (b - a) * (i / steps)
            cx, cy, cz = math.floor(p[0]), math.floor(p[1]), math.floor(p[2])
            for x in range(max(cx - near, 0), min(cx + near + 1, nx)):
                for y in range(max(cy - near, 0), min(cy + near + 1, ny)):
                    for z in range(max(cz - near, 0), min(cz + near + 1, nz)):
                        if _distance_to_axis(x + 0.5, y + 0.5, z + 0.5, a, b) <= radii[c] + HALF_DIAGONAL:
                            occupied[x, y, z] = True


@compiled
def _distance_to_axis(x: float, y: float, z: float, a: Floats, b: Floats) -> float:
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    wx, wy, wz = x - a[0], y - a[1], z - a[2]
    uu = ux * ux + uy * uy + uz * uz
    t = 0.0
    if uu > 0.0:
        t = min(max((wx * ux + wy * uy + wz * uz) / uu, 0.0), 1.0)
    return math.sqrt((wx - t * ux) ** 2 + (wy - t * uy) ** 2 + (wz - t * uz) ** 2)
