"""Points spread evenly over the surface; both sides of a point are targets of their own."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.errors import InputError
from gcs.planning.views.picture_kernels import LIFT_M

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from gcs.core.inspection import Region
    from gcs.core.structure import Structure

MOST_ROUNDS = 20
AREA_PROBES = 4000

MORTON_BITS = 12
"""Bits of each coordinate along the curve: cells of a 4096th of the extent."""


@dataclass(frozen=True, eq=False)
class SurfaceSamples:
    """Sides of surface points.

    Attributes:
        points_m: shape (N, 3), scene ENU.
        normals: the side, unit, shape (N, 3).
    """

    points_m: NDArray[np.float64]
    normals: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.points_m)

    def __getitem__(self, which: NDArray[np.bool_] | NDArray[np.int64]) -> SurfaceSamples:
        return SurfaceSamples(self.points_m[which], self.normals[which])

    @property
    def lifted_m(self) -> NDArray[np.float64]:
        """The points a little above their side, shape (N, 3)."""
        return self.points_m + LIFT_M * self.normals


def surface_area(structure: Structure, regions: tuple[Region, ...]) -> float:
    """Area (m²) of one side of the surface, in the regions if there are any.

    In regions it is estimated from points of the triangles that touch them, and never 0 when there are such.
    """
    triangles = structure.triangles_m
    area, _ = _areas_and_normals(triangles)
    touching = _touches(triangles, regions)
    whole = float(area[touching].sum())
    if not regions or whole == 0:
        return whole
    rng = np.random.default_rng(0)
    face = rng.choice(np.flatnonzero(touching), size=AREA_PROBES, p=area[touching] / whole)
    inside = int(_inside(_points_on(triangles[face], rng), regions).sum())
    return whole * (inside + 1) / (AREA_PROBES + 1)


def sample_surface(
    structure: Structure, points: int, rng: np.random.Generator, regions: tuple[Region, ...] = ()
) -> SurfaceSamples:
    """Sample points evenly by area.

    Args:
        structure: whose triangles are sampled.
        points: how many; twice as many sides come back. In regions that hold little of the triangles that touch them
            there may be fewer.
        rng: the source of randomness.
        regions: boxes that select surface; empty for all of it.

    Raises:
        InputError: there is no surface in the regions.
    """
    triangles = structure.triangles_m
    area, normals = _areas_and_normals(triangles)
    share = np.where(_touches(triangles, regions), area, 0.0)
    found: list[NDArray[np.float64]] = []
    sides: list[NDArray[np.float64]] = []
    missing = points if share.sum() > 0 else 0
    for _ in range(MOST_ROUNDS):
        if missing <= 0:
            break
        face = rng.choice(len(share), size=points, p=share / share.sum())
        p = _points_on(triangles[face], rng)
        keep = np.flatnonzero(_inside(p, regions))[:missing]
        found.append(p[keep])
        sides.append(normals[face[keep]])
        missing -= len(keep)
    if not sum(len(p) for p in found):
        raise InputError("no surface of the structure lies in them", field="inspection.surface.regions")
    p, n = np.concatenate(found), np.concatenate(sides)
    return SurfaceSamples(np.concatenate([p, p]), np.concatenate([n, -n]))


def in_spatial_order(samples: SurfaceSamples) -> SurfaceSamples:
    """The same sides, neighbours near each other (along a Morton curve): rays to them run alike."""
    low, high = samples.points_m.min(axis=0), samples.points_m.max(axis=0)
    cell = ((samples.points_m - low) * ((1 << MORTON_BITS) - 1) / max(float((high - low).max()), 1e-9)).astype(np.int64)
    code = np.zeros(len(samples), dtype=np.int64)
    for bit in range(MORTON_BITS):
        for axis in range(3):
            code |= (cell[:, axis] >> bit & 1) << (3 * bit + axis)
    return samples[np.argsort(code, kind="stable")]


def _points_on(triangles: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.float64]:
    """A point on each triangle, evenly by area, shape (F, 3, 3) -> (F, 3)."""
    u, w = rng.random(len(triangles)), rng.random(len(triangles))
    outside = u + w > 1
    u[outside], w[outside] = 1 - u[outside], 1 - w[outside]
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    return np.asarray(a + u[:, None] * (b - a) + w[:, None] * (c - a))


def _areas_and_normals(triangles: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    cross = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    length = np.linalg.norm(cross, axis=1)
    return length / 2, cross / np.maximum(length, 1e-300)[:, None]


def _touches(triangles: NDArray[np.float64], regions: tuple[Region, ...]) -> NDArray[np.bool_]:
    if not regions:
        return np.ones(len(triangles), dtype=np.bool_)
    low, high = triangles.min(axis=1), triangles.max(axis=1)
    result = np.zeros(len(triangles), dtype=np.bool_)
    for region in regions:
        result |= ((high >= region.min_m) & (low <= region.max_m)).all(axis=1)
    return result


def _inside(points: NDArray[np.float64], regions: tuple[Region, ...]) -> NDArray[np.bool_]:
    if not regions:
        return np.ones(len(points), dtype=np.bool_)
    result = np.zeros(len(points), dtype=np.bool_)
    for region in regions:
        result |= ((points >= region.min_m) & (points <= region.max_m)).all(axis=1)
    return result
