"""The fixed grid of cells on a rectangular face, as in the tower paper's environment matrix."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.errors import InputError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from gcs.core.inspection import FaceTask
    from gcs.core.scenario import Scenario
    from gcs.planning.scene.point_distance import SceneDistance

ON_SURFACE_M = 0.3
"""What is asked about may lie this far from any surface: paint, bolts, fittings and a rounded position."""

INSET = 0.01
"""Samples keep this share of the half cell from its edge, where the surface ends or another one begins."""

LIFT_M = 0.01
"""Samples are looked at this far above the surface."""


@dataclass(frozen=True, eq=False)
class FaceCell:
    """One cell of a face.

    Attributes:
        name: of the cell and of its viewpoint.
        middle_m: shape (3,).
        along_m: from the middle to the edge along the row, shape (3,).
        up_m: from the middle to the edge up the column, shape (3,).
    """

    name: str
    middle_m: NDArray[np.float64]
    along_m: NDArray[np.float64]
    up_m: NDArray[np.float64]

    def at(self, shares: NDArray[np.float64]) -> NDArray[np.float64]:
        """Points of the cell, shape (K, 3), by their shares (-1 to 1) of the half sides, shape (K, 2)."""
        return np.asarray(self.middle_m + shares[:, :1] * self.along_m + shares[:, 1:] * self.up_m)


def face_cells(face: FaceTask) -> list[FaceCell]:
    """The cells, row by row from `origin_m`; the last row and column end at the face's edge."""
    origin, along, up = (np.asarray(v, dtype=np.float64) for v in (face.origin_m, face.along_m, face.up_m))
    width, height = float(np.linalg.norm(along)), float(np.linalg.norm(up))
    across, upward = _edges(width, face.cell_m, face.columns), _edges(height, face.cell_m, face.rows)
    along, up = along / width, up / height
    return [
        FaceCell(
            name=face.cell_name(row, column),
            middle_m=origin + (across[column : column + 2].mean() * along + upward[row : row + 2].mean() * up),
            along_m=(across[column + 1] - across[column]) / 2 * along,
            up_m=(upward[row + 1] - upward[row]) / 2 * up,
        )
        for row in range(face.rows)
        for column in range(face.columns)
    ]


def outward_normal(face: FaceTask) -> NDArray[np.float64]:
    """Unit normal of the rectangle itself on the side that the face's normal names, shape (3,)."""
    normal = np.cross(np.asarray(face.along_m, dtype=np.float64), np.asarray(face.up_m, dtype=np.float64))
    normal /= np.linalg.norm(normal)
    return np.asarray(normal * np.sign(normal @ np.asarray(face.normal)))


def sample_shares(rng: np.random.Generator, along: int) -> NDArray[np.float64]:
    """Where a cell is looked at: its corners, its middle, and one random place in each of `along`² equal parts.

    Returns:
        Shares of the half sides, shape (K, 2).
    """
    edge = 1 - INSET
    fixed = [[0, 0], [-edge, -edge], [edge, -edge], [edge, edge], [-edge, edge]]
    part = np.stack(np.meshgrid(np.arange(along), np.arange(along), indexing="ij"), axis=-1).reshape(-1, 2)
    spread = 2 * (part + rng.random(part.shape)) / along - 1
    return np.concatenate([np.array(fixed, dtype=np.float64), edge * spread])


def surface_tolerance_m(scenario: Scenario) -> float:
    """How far (m) what is asked about may lie from any surface; more where the model itself is less exact."""
    return max(ON_SURFACE_M, scenario.safety.model_m)


def lifted_onto_surface(
    points_m: NDArray[np.float64], normal: NDArray[np.float64], distance: SceneDistance, within_m: float
) -> NDArray[np.float64] | None:
    """Points of a cell a little above the surface, also where that covers the face by a coat or a plate.

    All are lifted by as much as the one that is furthest from the surface: near an edge of the structure the nearest
    surface is the one round the corner.

    Args:
        points_m: shape (K, 3).
        normal: of the face, shape (3,).
        distance: exact distances; the ground does not count.
        within_m: how far from the surface the face may lie.

    Returns:
        Shape (K, 3); None where a point lies further from any surface.
    """
    depth = float(distance.distance(points_m, ground=False, limit=2 * within_m).max())
    return None if depth > within_m else np.asarray(points_m + (depth + LIFT_M) * normal)


def require_on_surface(
    points_m: NDArray[np.float64], distance: SceneDistance, within_m: float, what: str, field: str
) -> None:
    """Check that points lie on the structure.

    Args:
        points_m: shape (K, 3).
        distance: exact distances; the ground does not count.
        within_m: how far from a triangle or a cable they may lie.
        what: subject of the message.
        field: the scenario's field.

    Raises:
        InputError: one does not; says how far the furthest of them is from everything, and where.
    """
    near = distance.distance(points_m, ground=False, limit=2 * within_m) <= within_m
    if near.all():
        return
    off = points_m[~near]
    found = distance.distance(off, ground=False)
    place = ", ".join(f"{c:.2f}" for c in off[found.argmax()])
    far = f"{'up to ' if len(off) > 1 else ''}{found.max():.2f} m"
    raise InputError(
        f"{what} lies {far} from any surface (at {place}), and {within_m:.2f} m are allowed: "
        "move it onto the structure, or check the mesh's scale and position",
        field=field,
    )


def _edges(side_m: float, cell_m: float, pieces: int) -> NDArray[np.float64]:
    return np.append(np.arange(pieces) * cell_m, side_m)
