"""How a mesh is put into the scene: by hand, or by surveyed points."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gcs.core.errors import InputError
from gcs.core.rigid_alignment import RigidAlignment, are_on_one_line, fit_alignment

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from gcs.core.structure_source import Alignment, MeshSource

MOST_RESIDUAL_SHARE = 0.05
"""Of the surveyed points' extent: a residual over it is a mistake, not a measuring error."""

MOST_RESIDUAL_M = 2.0
SCALE_HINT_SHARE = 0.02
USUAL_SCALES = (0.001, 0.01, 0.0254, 0.1, 0.3048, 1.0, 10.0, 25.0, 50.0, 100.0, 200.0, 1000.0)


@dataclass(frozen=True, eq=False)
class PlacedVertices:
    """Vertices in the scene.

    Attributes:
        vertices_m: scene ENU, shape (V, 3).
        error_m: by how much surface may be off because of the placement; 0 for a placement by hand, whose error is the
            user's `model_m`.
        scale: file units to metres.
        notes: what was found, in plain words.
    """

    vertices_m: NDArray[np.float64]
    error_m: float
    scale: float
    notes: tuple[str, ...] = ()

    @property
    def bounds_m(self) -> NDArray[np.float64]:
        """Lowest and highest corner, shape (2, 3)."""
        return np.stack([self.vertices_m.min(axis=0), self.vertices_m.max(axis=0)])


def place(vertices: NDArray[np.float64], source: MeshSource, field: str) -> PlacedVertices:
    """Put vertices of a file into the scene.

    Args:
        vertices: in the file's units and axes, shape (V, 3), V > 0.
        source: how the mesh stands.
        field: of `source` in the scenario.

    Raises:
        InputError: the surveyed points do not say how it stands.
    """
    if source.align is None:
        return PlacedVertices(_by_hand(vertices, source), 0.0, source.scale)
    fit = _survey_fit(source.align, source.scale, f"{field}.align")
    placed = fit.apply(vertices * source.scale)
    low, high = placed.min(axis=0), placed.max(axis=0)
    corners = np.array(list(itertools.product(*zip(low, high, strict=True))))
    error = max(fit.worst_m, float(fit.expected_error_m(corners).max()))
    found = f", scale {fit.scale:.6g}" if fit.with_scale else ""
    note = (
        f"placed by {len(fit.residuals_m)} surveyed points{found}: residual {fit.rms_m:.3f} m rms, {fit.worst_m:.3f} m "
        f"at worst (point {int(fit.residuals_m.argmax()) + 1}); {error:.3f} m come on top of safety.model_m"
    )
    return PlacedVertices(placed, error, source.scale * fit.scale, (note,))


def _by_hand(vertices: NDArray[np.float64], source: MeshSource) -> NDArray[np.float64]:
    v = vertices * source.scale
    if source.up == "y":
        v = np.column_stack([v[:, 0], -v[:, 2], v[:, 1]])
    if source.rotation_deg:
        angle = math.radians(source.rotation_deg)
        c, s = math.cos(angle), math.sin(angle)
        v = np.column_stack([c * v[:, 0] - s * v[:, 1], s * v[:, 0] + c * v[:, 1], v[:, 2]])
    return np.asarray(v + np.asarray(source.position_m))


def _survey_fit(align: Alignment, scale: float, field: str) -> RigidAlignment:
    """The fit of scaled mesh points to the world, if it is one."""
    points = np.array([p.mesh for p in align.points]) * scale
    world = np.array([p.world_m for p in align.points])
    for name, places in (("mesh", points), ("world_m", world)):
        if are_on_one_line(places):
            raise InputError(
                f"the `{name}` places are on one line, or in one place: give three points that make a triangle",
                field=f"{field}.points",
            )
    fit = fit_alignment(points, world, with_scale=align.find_scale)
    extent = float(np.linalg.norm(world - world.mean(axis=0), axis=1).max())
    limit = min(MOST_RESIDUAL_SHARE * extent, MOST_RESIDUAL_M)
    if fit.worst_m <= limit:
        return fit
    raise InputError(_what_is_wrong(points, world, fit, scale, limit), field=f"{field}.points")


def _what_is_wrong(
    points: NDArray[np.float64], world: NDArray[np.float64], fit: RigidAlignment, scale: float, limit_m: float
) -> str:
    """The likeliest mistake behind points that do not fit."""
    found = f"the points do not fit: {fit.worst_m:.2f} m at point {int(fit.residuals_m.argmax()) + 1}"
    scaled = fit_alignment(points, world, with_scale=True)
    if not fit.with_scale and scaled.worst_m <= limit_m:
        return f"{found}; with `scale: {_usual(scale * scaled.scale):g}` they would"
    if fit_alignment(points, world, with_scale=fit.with_scale, may_mirror=True).worst_m <= limit_m:
        return f"{found}; their mirror image would: are two axes exchanged, or is one turned round?"
    if len(points) > 3:
        for k in range(len(points)):
            others = np.delete(np.arange(len(points)), k)
            if are_on_one_line(points[others]) or are_on_one_line(world[others]):
                continue
            if fit_alignment(points[others], world[others], with_scale=fit.with_scale).worst_m <= limit_m:
                return f"{found}; the others fit without point {k + 1}: look at that one"
    return f"{found}: look at their order, units and axes"


def _usual(scale: float) -> float:
    """The usual scale that is meant, if it is near one."""
    nearest = min(USUAL_SCALES, key=lambda usual: abs(math.log(scale / usual)))
    return nearest if abs(scale / nearest - 1) <= SCALE_HINT_SHARE else float(f"{scale:.4g}")
